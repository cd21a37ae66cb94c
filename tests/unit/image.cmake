kl_test(test_image_exr SOURCES ${PROJECT_SOURCE_DIR}/tests/unit/test_image_exr.c LINK kl_image)
