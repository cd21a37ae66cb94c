add_library(kl_test_hard STATIC ${CMAKE_CURRENT_LIST_DIR}/hard_scene.c)
target_include_directories(kl_test_hard PUBLIC ${CMAKE_CURRENT_LIST_DIR})
target_link_libraries(kl_test_hard PUBLIC kl_render kl_flags cmocka m)

kl_test(test_hard_scale SOURCES test_hard_scale.c LINK kl_test_hard)
kl_test(test_hard_surfaces SOURCES test_hard_surfaces.c LINK kl_test_hard)
kl_test(test_hard_light SOURCES test_hard_light.c LINK kl_test_hard)
kl_test(test_hard_records SOURCES test_hard_records.c LINK kl_test_hard)
kl_test(test_hard_motion SOURCES test_hard_motion.c LINK kl_test_hard)
kl_test(test_hard_shutter SOURCES test_hard_shutter.c LINK kl_test_hard)
set_tests_properties(hard.test_hard_surfaces PROPERTIES TIMEOUT 900)
# Sanitizers slow rendering down eightfold: these take minutes then.
if(KL_SANITIZE)
  set_tests_properties(hard.test_hard_scale hard.test_hard_surfaces hard.test_hard_light
                       hard.test_hard_motion
                       PROPERTIES LABELS "hard;nightly" TIMEOUT 3600)
endif()
