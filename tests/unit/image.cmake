kl_test(test_image_exr SOURCES test_image_exr.c LINK kl_image)
kl_test(test_image_metrics SOURCES test_image_metrics.c LINK kl_image)
