kl_test(test_store SOURCES test_store.c LINK kl_cache_io)
kl_test(test_segment_values SOURCES test_segment_values.c LINK kl_cache_io m)
