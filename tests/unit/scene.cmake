kl_test(test_scene_pose SOURCES test_scene_pose.c LINK kl_scene m)
kl_test(test_scene_deform SOURCES test_scene_deform.c LINK kl_scene m)
kl_test(test_scene_parts SOURCES test_scene_parts.c LINK kl_scene m)
kl_test(test_scene_motion SOURCES test_scene_motion.c LINK kl_trace m)
