kl_fuzz(fuzz_segment SOURCES fuzz_segment.c LINK kl_cache_io)
