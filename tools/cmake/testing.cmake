# Build functions of the tests.

# teletact_files_of(<test> <library> <file>...): files of a library that stands above what the test
# needs. The library's own objects are linked; a sanitizer, which would have to build all that is
# below it, compiles the files alone.
function(teletact_files_of test library)
  if(NOT TELETACT_SANITIZE)
    target_link_libraries(test_${test} PRIVATE teletact_${library})
    return()
  endif()
  foreach(file ${ARGN})
    target_sources(test_${test} PRIVATE ${PROJECT_SOURCE_DIR}/${file})
  endforeach()
endfunction()

# Built alone by tools/test --all: the programs with the label sanitize, and those with threads; by
# --ci: those with bytes.
add_custom_target(sanitize_tests)
add_custom_target(threads_tests)
add_custom_target(bytes_tests)

# teletact_test(<name> [DEPS ours...] [PACKAGES ...] [LABELS ...] [TIMEOUT s] [COST s] [WAITS]
#               [NO_GUARD] [NO_SANITIZE] [NEEDS_FAULTS] [LONG] [LONG_TESTS pattern...]
#               [ALONE_TESTS pattern...] [WHOLE_TESTS pattern...] [LATER_TESTS pattern...])
# Every .cpp of the calling folder becomes one GoogleTest program test_<name>. The allocation and
# lock guard is linked in unless NO_GUARD or a sanitizer is on. A sanitizer gets five times the
# TIMEOUT.
#
# Labels: unit; sanitize (run by tools/test --all with AddressSanitizer and UBSan) unless
#   NO_SANITIZE, which is for what takes minutes or runs the whole program, or LABELS timing.
#   LABELS threads: run with ThreadSanitizer too. LABELS bytes: readers of bytes from outside, and
#   rings: quick ones, that CI runs with AddressSanitizer and UBSan on every change. LABELS timing:
#   nothing runs beside it.
# COST: about how many seconds it takes, from 10 on: ctest begins with the longest, so that none
#   runs alone at the end.
# WAITS: most of its time it waits, for sockets, timers or a program on the real clock. ctest runs
#   two jobs a core; such a program is one job, each other one two.
# NEEDS_FAULTS: not declared when TELETACT_FAULTS is OFF, for it runs a planned executor.
# LONG: takes hours; run by tools/test --long, that is ctest -C long -L long, and by no other ctest.
# LONG_TESTS: tests that repeat for minutes what others do once; a sanitizer, which takes ten times
#   as long, runs the program without them.
# ALONE_TESTS: tests that compare CPU times; what another core does changes them (shared cache,
#   shared execution units), so each is a test of its own with nothing beside it; a sanitizer, under
#   which a CPU time is not the product's, runs them with the others.
# WHOLE_TESTS: tests that take few of their samples (tests/support/whole.hpp); <name>.whole runs them
#   with all, by tools/test --all, that is ctest -C all, and by no other.
# LATER_TESTS: tests that only <name>.whole runs: further cases of what another test holds, each of
#   many seconds.
function(teletact_test name)
  cmake_parse_arguments(A "NO_GUARD;NO_SANITIZE;NEEDS_FAULTS;LONG;WAITS" "TIMEOUT;COST"
    "DEPS;PACKAGES;LABELS;LONG_TESTS;ALONE_TESTS;WHOLE_TESTS;LATER_TESTS"
    ${ARGN})
  if(A_NEEDS_FAULTS AND NOT TELETACT_FAULTS)
    return()
  endif()
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  add_executable(test_${name} ${sources})
  # What they test is in the libraries; a test that counts or times what is in headers has that
  # compiled as the product has it.
  set(cold)
  set(header precompiled)
  set(below)
  if(NOT "timing" IN_LIST A_LABELS AND NOT A_ALONE_TESTS)
    set(cold COLD)
    # Most files of these read the graph of a box, which takes GCC 8 s.
    foreach(above program tool_host tool_desk tasks_graph)
      if(above IN_LIST A_DEPS)
        set(header precompiled_graph)
        set(below teletact_program)
      endif()
    endforeach()
  endif()
  target_link_libraries(test_${name} PRIVATE teletact_options teletact_test_paths GTest::gtest_main GTest::gmock
    ${A_PACKAGES})
  foreach(dep ${A_DEPS})
    target_link_libraries(test_${name} PRIVATE teletact_${dep})
  endforeach()
  teletact_compile(test_${name} ${cold} GROUPS READS tests/support/${header}.hpp
    PACKAGES GTest::gtest_main GTest::gmock ${below})
  if(NOT A_NO_GUARD AND NOT TELETACT_SANITIZE AND TARGET teletact_rt_guard)
    target_link_libraries(test_${name} PRIVATE teletact_rt_guard)
  endif()
  if(NOT A_TIMEOUT)
    set(A_TIMEOUT 300)
  endif()
  if(TELETACT_SANITIZE)
    math(EXPR A_TIMEOUT "5 * ${A_TIMEOUT}")
  endif()
  set(labels unit ${A_LABELS})
  if(NOT A_NO_SANITIZE AND NOT "timing" IN_LIST labels)
    list(APPEND labels sanitize)
  endif()
  foreach(label sanitize threads bytes)
    if(label IN_LIST labels)
      add_dependencies(${label}_tests test_${name})
    endif()
  endforeach()
  if(TELETACT_SANITIZE)
    set(without ${A_LONG_TESTS})
  else()
    set(without ${A_ALONE_TESTS} ${A_LATER_TESTS})
    foreach(pattern ${A_ALONE_TESTS})
      add_test(NAME ${name}.${pattern} COMMAND test_${name} --gtest_filter=${pattern})
      set_tests_properties(${name}.${pattern} PROPERTIES TIMEOUT ${A_TIMEOUT} LABELS "${labels}"
        RUN_SERIAL TRUE FAIL_REGULAR_EXPRESSION "Running 0 tests")
    endforeach()
  endif()
  set(filter)
  if(without)
    string(JOIN ":" filter ${without})
    set(filter --gtest_filter=-${filter})
  endif()
  if(A_LONG)
    add_test(NAME ${name} COMMAND test_${name} ${filter} CONFIGURATIONS long)
    set(labels long ${A_LABELS})
  else()
    add_test(NAME ${name} COMMAND test_${name} ${filter})
  endif()
  set(jobs 2)
  if(A_WAITS)
    set(jobs 1)
  endif()
  set_tests_properties(${name} PROPERTIES TIMEOUT ${A_TIMEOUT} LABELS "${labels}" PROCESSORS ${jobs})
  if("timing" IN_LIST labels)
    set_tests_properties(${name} PROPERTIES RUN_SERIAL TRUE)
  endif()
  if(A_COST)
    set_tests_properties(${name} PROPERTIES COST ${A_COST})
  endif()
  if((A_WHOLE_TESTS OR A_LATER_TESTS) AND NOT TELETACT_SANITIZE)
    string(JOIN ":" filter ${A_WHOLE_TESTS} ${A_LATER_TESTS})
    add_test(NAME ${name}.whole COMMAND test_${name} --gtest_filter=${filter} CONFIGURATIONS all)
    set_tests_properties(${name}.whole PROPERTIES TIMEOUT 1800 COST 1000 LABELS "${labels}" PROCESSORS ${jobs}
      ENVIRONMENT TELETACT_WHOLE=1 FAIL_REGULAR_EXPRESSION "Running 0 tests")
    if("timing" IN_LIST labels)
      set_tests_properties(${name}.whole PROPERTIES RUN_SERIAL TRUE)
    endif()
  endif()
endfunction()
