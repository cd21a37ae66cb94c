# Sanitizers slow rendering down eightfold: one scene, both ways, shows them all the code.
if(KL_SANITIZE)
  set(selection few)
endif()
kl_test(test_references SOURCES test_references.c LINK kl_test_property kl_image m ARGS ${selection})
if(NOT KL_SANITIZE)
  add_test(NAME golden.test_references_moving COMMAND test_references moving)
  set_tests_properties(golden.test_references_moving PROPERTIES LABELS golden TIMEOUT 300)
endif()
# The figures of the reference renderer itself: minutes of path tracing.
add_test(NAME golden.test_references_many COMMAND test_references many)
add_test(NAME golden.test_references_many_moving COMMAND test_references many-moving)
set_tests_properties(golden.test_references_many golden.test_references_many_moving
                     PROPERTIES LABELS nightly TIMEOUT 3600)
