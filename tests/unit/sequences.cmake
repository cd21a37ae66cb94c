kl_test(test_sequence_text SOURCES test_sequence_text.c LINK kl_sequences)
kl_test(test_sequence_camera SOURCES test_sequence_camera.c LINK kl_sequences)
kl_test(test_sequence_plan SOURCES test_sequence_plan.c LINK kl_sequences)
kl_test(test_sequence_coherence SOURCES test_sequence_coherence.c LINK kl_sequences m)
