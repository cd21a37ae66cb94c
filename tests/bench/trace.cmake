kl_bench(bench_trace SOURCES bench_trace.c LINK kl_device kl_test_trace_scenes OpenMP::OpenMP_C)
