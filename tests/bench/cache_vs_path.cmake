kl_bench(bench_cache_vs_path SOURCES bench_cache_vs_path.c LINK kl_render kl_import kl_image m)
