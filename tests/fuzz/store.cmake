kl_fuzz(fuzz_segment SOURCES fuzz_segment.c LINK kl_cache_io)
kl_fuzz(fuzz_use SOURCES fuzz_use.c LINK kl_cache_io)
