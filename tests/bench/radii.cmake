kl_bench(bench_radii SOURCES bench_radii.c LINK kl_render kl_import m)
