add_library(kl_test_trace_scenes STATIC ${CMAKE_CURRENT_LIST_DIR}/test_trace_scenes.c)
target_include_directories(kl_test_trace_scenes PUBLIC ${CMAKE_CURRENT_LIST_DIR})
target_link_libraries(kl_test_trace_scenes PUBLIC kl_base kl_flags)

kl_test(test_trace SOURCES test_trace.c LINK kl_trace kl_test_trace_scenes)
kl_test(test_trace_bvh SOURCES test_trace_bvh.c LINK kl_trace kl_test_trace_scenes)
