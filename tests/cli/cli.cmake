# Each NAME.sh here is a test: run.sh runs it in a folder of its own and compares what it says with the
# files beside it (docs/testing.md). `scenes` writes the input first.
set(cli_scenes ${CMAKE_BINARY_DIR}/tests/scenes)
find_program(PYTHON3 python3 REQUIRED)

add_test(NAME cli.scenes COMMAND ${PYTHON3} ${PROJECT_SOURCE_DIR}/tests/data/make_scenes.py
                                 ${cli_scenes})
set_tests_properties(cli.scenes PROPERTIES LABELS cli FIXTURES_SETUP kl_scenes TIMEOUT 60)

file(GLOB cli_scripts CONFIGURE_DEPENDS ${CMAKE_CURRENT_LIST_DIR}/test_*.sh)
foreach(script IN LISTS cli_scripts)
  get_filename_component(name ${script} NAME_WE)
  string(REGEX REPLACE "^test_" "" name ${name})
  add_test(NAME cli.${name} COMMAND ${CMAKE_CURRENT_LIST_DIR}/run.sh ${script}
                                    ${CMAKE_BINARY_DIR}/tests/cli/${name})
  set_tests_properties(
    cli.${name}
    PROPERTIES LABELS cli
               TIMEOUT 300
               FIXTURES_REQUIRED kl_scenes
               ENVIRONMENT
               "KEEPLIGHT=$<TARGET_FILE:keeplight>;SCENES=${cli_scenes};ROOT=${PROJECT_SOURCE_DIR}")
endforeach()
