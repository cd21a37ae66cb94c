add_library(kl_test_hard STATIC ${CMAKE_CURRENT_LIST_DIR}/hard_scene.c)
target_include_directories(kl_test_hard PUBLIC ${CMAKE_CURRENT_LIST_DIR})
target_link_libraries(kl_test_hard PUBLIC kl_render kl_flags cmocka m)

kl_test(test_hard_scale SOURCES test_hard_scale.c LINK kl_test_hard)
