add_library(kl_test_property STATIC ${CMAKE_CURRENT_LIST_DIR}/property_scene.c)
target_include_directories(kl_test_property PUBLIC ${CMAKE_CURRENT_LIST_DIR})
target_compile_definitions(kl_test_property PRIVATE KL_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
target_link_libraries(kl_test_property PUBLIC kl_render kl_import kl_flags cmocka)

kl_test(test_furnace SOURCES test_furnace.c LINK kl_test_property m)
kl_test(test_leak SOURCES test_leak.c LINK kl_test_property m)
kl_test(test_same_image SOURCES test_same_image.c LINK kl_test_property OpenMP::OpenMP_C)
