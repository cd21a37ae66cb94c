kl_test(test_references SOURCES test_references.c LINK kl_test_property kl_image m)
