kl_test(test_kernel_sampling SOURCES test_kernel_sampling.c LINK kl_base m)
kl_test(test_kernel_gradients SOURCES test_kernel_gradients.c LINK kl_device m)
kl_test(test_kernel_lights SOURCES test_kernel_lights.c LINK kl_trace m)
kl_test(test_kernel_bsdf SOURCES test_kernel_bsdf.c LINK kl_trace m)
