# Sanitizers slow rendering down eightfold: one scene, both ways, shows them all the code.
if(KL_SANITIZE)
  set(selection few)
endif()
kl_test(test_references SOURCES test_references.c LINK kl_test_property kl_image m ARGS ${selection})
# The figures of the reference renderer itself: minutes of path tracing.
add_test(NAME golden.test_references_many COMMAND test_references many)
set_tests_properties(golden.test_references_many PROPERTIES LABELS nightly TIMEOUT 3600)
