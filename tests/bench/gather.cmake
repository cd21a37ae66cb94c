kl_bench(bench_gather SOURCES bench_gather.c LINK kl_test_gallery_batch)
