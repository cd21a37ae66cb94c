kl_test(test_kernel_sampling SOURCES test_kernel_sampling.c LINK kl_base m)
