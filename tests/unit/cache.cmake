kl_test(test_cache_octree SOURCES test_cache_octree.c LINK kl_cache m)
kl_test(test_cache_falloff SOURCES test_cache_falloff.c LINK kl_cache m)
kl_test(test_cache_thin SOURCES test_cache_thin.c LINK kl_cache m)
