kl_bench(bench_store SOURCES bench_store.c ../crash/batch.c LINK kl_cache_io kl_cache m)
