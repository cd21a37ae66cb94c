kl_bench(bench_lookup SOURCES bench_lookup.c LINK kl_cache_io kl_cache kl_trace kl_import m)
