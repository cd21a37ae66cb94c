kl_test(test_store SOURCES test_store.c LINK kl_cache_io)
kl_test(test_segment_values SOURCES test_segment_values.c LINK kl_cache_io m)
kl_test(test_store_use SOURCES test_store_use.c LINK kl_cache_io)
