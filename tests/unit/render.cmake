kl_test(test_render_camera SOURCES test_render_camera.c LINK kl_render m)
kl_test(test_render_ledger SOURCES test_render_ledger.c LINK kl_render m)
kl_test(test_render_moved SOURCES test_render_moved.c LINK kl_render m)
kl_test(test_render_reference SOURCES test_render_reference.c LINK kl_render m)
