# Every scene file there is, valid or broken: hundreds.
add_test(NAME golden.scenes COMMAND ${CMAKE_CURRENT_LIST_DIR}/scenes.sh $<TARGET_FILE:keeplight>
                                    ${CMAKE_BINARY_DIR}/tests/golden/scenes)
set_tests_properties(golden.scenes PROPERTIES LABELS nightly TIMEOUT 3600 SKIP_RETURN_CODE 77)
