kl_test(test_device_layout SOURCES test_device_layout.c LINK kl_device)
kl_test(test_device_trace SOURCES test_device_trace.c LINK kl_device kl_test_trace_scenes)
kl_test(test_device_gather SOURCES test_device_gather.c LINK kl_device kl_test_trace_scenes)
