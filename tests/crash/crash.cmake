# The cache on disk under faults: calls that fail, power cuts, damage, kills, many writers. Files lie
# in memory where they can: nothing here asks how fast a disk is.
if(EXISTS /dev/shm)
  set(crash_folder /dev/shm)
else()
  set(crash_folder /tmp)
endif()

# crash_test(NAME ...): a test that works in crash_folder. crash_many(NAME TARGET ARGS...): its
# full counts.
function(crash_test name)
  kl_test(${name} SOURCES ${name}.c batch.c ${ARGN} LINK kl_cache_io kl_cache m)
  set_tests_properties(crash.${name} PROPERTIES ENVIRONMENT TMPDIR=${crash_folder})
endfunction()
function(crash_many name)
  add_test(NAME crash.${name}_many COMMAND ${name} ${ARGN})
  set_tests_properties(crash.${name}_many PROPERTIES LABELS nightly TIMEOUT 3600
                                                     ENVIRONMENT TMPDIR=${crash_folder})
endfunction()

crash_test(test_commit faults.c)
crash_test(test_upkeep faults.c)
crash_test(test_damage)
crash_many(test_damage all)
crash_test(test_records)
crash_test(test_kill)
crash_many(test_kill 1000)
crash_test(test_writers)
crash_many(test_writers 60)

# The program itself.
set(kill_bake ${CMAKE_CURRENT_LIST_DIR}/kill_bake.sh $<TARGET_FILE:keeplight>
              ${CMAKE_BINARY_DIR}/tests/scenes/cornell.glb ${CMAKE_BINARY_DIR}/tests/crash)
add_test(NAME crash.kill_bake COMMAND ${kill_bake}/few 8)
add_test(NAME crash.kill_bake_many COMMAND ${kill_bake}/many 1000)
set_tests_properties(crash.kill_bake PROPERTIES LABELS crash TIMEOUT 300 FIXTURES_REQUIRED kl_scenes)
set_tests_properties(crash.kill_bake_many PROPERTIES LABELS nightly TIMEOUT 7200 FIXTURES_REQUIRED
                                                                            kl_scenes)
