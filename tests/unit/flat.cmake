kl_test(test_flat SOURCES test_flat.c LINK kl_trace m)
