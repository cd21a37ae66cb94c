kl_test(test_store SOURCES test_store.c LINK kl_cache_io)
