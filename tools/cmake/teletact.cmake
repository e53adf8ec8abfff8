# Build functions of the project: one place for warnings, sanitizers and floating-point rules.

# What is installed: include/teletact/<module>/<folder>/*.hpp, found as "<module>/<folder>/x.hpp".
include(GNUInstallDirs)
set(TELETACT_INSTALL_INCLUDE ${CMAKE_INSTALL_INCLUDEDIR}/teletact)
set(TELETACT_INSTALL_CMAKE ${CMAKE_INSTALL_LIBDIR}/cmake/teletact)

# teletact_install(<module>_<folder>): exports teletact_x as teletact::x. The parts that can be
# installed and found apart are the top folders; config goes with rt, which everything needs.
function(teletact_install name)
  string(REGEX REPLACE "_.*" "" part ${name})
  if(part MATCHES "^(config|options)$")
    set(part rt)
  endif()
  set_target_properties(teletact_${name} PROPERTIES EXPORT_NAME ${name})
  install(TARGETS teletact_${name} EXPORT teletact_${part}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/teletact COMPONENT ${part})
endfunction()

add_library(teletact_options INTERFACE)
target_include_directories(teletact_options INTERFACE
  $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:${TELETACT_INSTALL_INCLUDE}>)
# -ffp-contract=off: the same bytes from every instruction set; an FMA would round once less. Some
# of the algorithms live in headers, so a consumer gets it too; warnings and optimisation stay ours.
# -Wno-restrict: GCC 12 warns falsely of overlapping copies in std::string + "literal" (PR 105329).
target_compile_options(teletact_options INTERFACE
  "$<BUILD_INTERFACE:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wconversion;-Wno-sign-conversion>"
  "$<BUILD_INTERFACE:-Wold-style-cast;-Wdouble-promotion;-Wno-restrict>"
  -ffp-contract=off
  "$<BUILD_INTERFACE:$<$<BOOL:${TELETACT_WERROR}>:-Werror>>"
  "$<BUILD_INTERFACE:$<$<CONFIG:Release>:$<IF:$<BOOL:$<TARGET_PROPERTY:TELETACT_TEST_CODE>>,-O1,-O3>>>")
if(TELETACT_PRECOMPILE)
  # Files compiled together need up to 1.6 GB. GCC's own threshold makes it collect garbage again and
  # again on the way there, which takes a tenth of its time.
  target_compile_options(teletact_options INTERFACE
    "$<BUILD_INTERFACE:$<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=800000>>")
endif()
if(TELETACT_PRECOMPILE AND NOT TELETACT_SANITIZE)
  # Of binutils, as ld is, and in a quarter of its time: 1.2 s for each of some 200 programs.
  find_program(TELETACT_GOLD ld.gold)
  if(TELETACT_GOLD)
    add_link_options(-fuse-ld=gold)
  endif()
endif()
target_compile_features(teletact_options INTERFACE cxx_std_20)
if(TELETACT_SANITIZE)
  # Without no-recover UBSan prints its findings and the test passes.
  target_compile_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE}
    -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE})
endif()
# Eigen must not start threads, and its assertions would throw out of a step().
target_compile_definitions(teletact_options INTERFACE EIGEN_DONT_PARALLELIZE)
target_link_libraries(teletact_options INTERFACE Threads::Threads $<INSTALL_INTERFACE:Eigen3::Eigen>)
target_include_directories(teletact_options SYSTEM INTERFACE
  $<BUILD_INTERFACE:$<TARGET_PROPERTY:Eigen3::Eigen,INTERFACE_INCLUDE_DIRECTORIES>>)
teletact_install(options)

# Kernels that Highway compiles once per instruction set include themselves again: never together
# with others.
function(teletact_alone)
  foreach(source ${ARGN})
    file(STRINGS ${source} found REGEX "HWY_TARGET_INCLUDE|include \"hwy/|vectors-inl.hpp" LIMIT_COUNT 1)
    if(found)
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
endfunction()

# Headers that many files of one kind include, precompiled once: for programs (tests), or for
# libraries that make position-independent code. The first call for a kind declares the target that
# owns them.
# teletact_reads(<target> <kind> <header> [PACKAGES imported...])
function(teletact_reads target kind header)
  if(NOT TELETACT_PRECOMPILE)
    return()
  endif()
  cmake_parse_arguments(A "" "" "PACKAGES" ${ARGN})
  set(owner teletact_precompiled_${kind})
  if(NOT TARGET ${owner})
    set(empty ${PROJECT_BINARY_DIR}/${owner}.cpp)
    file(CONFIGURE OUTPUT ${empty} CONTENT "int main() {}\n")
    get_target_property(type ${target} TYPE)
    if(type STREQUAL "EXECUTABLE")
      add_executable(${owner} ${empty})
    else()
      add_library(${owner} OBJECT ${empty})
    endif()
    # GCC takes the optimisation from the precompiled header: one for each.
    get_target_property(code ${target} TELETACT_TEST_CODE)
    if(code)
      set_target_properties(${owner} PROPERTIES TELETACT_TEST_CODE ON)
    endif()
    target_link_libraries(${owner} PRIVATE teletact_options ${A_PACKAGES})
    target_precompile_headers(${owner} PRIVATE ${PROJECT_SOURCE_DIR}/${header})
  endif()
  target_precompile_headers(${target} REUSE_FROM ${owner})
  # GCC 12 takes a precompiled std::string for ours and warns falsely in `"literal" + std::string`
  # (as above).
  target_compile_options(${target} PRIVATE -Wno-stringop-overflow -Wno-stringop-overread -Wno-array-bounds)
endfunction()

# The same for tests and measurements, whose files are compiled together too (above).
# teletact_precompiled(<target> <kind> <header> [PACKAGES imported...])
function(teletact_precompiled target)
  teletact_together(${target})
  teletact_reads(${target} ${ARGN})
endfunction()

# The headers of geometry for the product's own libraries; Eigen's take GCC 3 s. Not for files with
# options of their own, nor for a sanitizer, which optimises libraries otherwise than the rest.
function(teletact_reads_geometry target)
  if(TELETACT_SANITIZE)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    get_source_file_property(own ${source} COMPILE_OPTIONS)
    get_source_file_property(alone ${source} SKIP_UNITY_BUILD_INCLUSION)
    if(own OR alone)
      set_source_files_properties(${source} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
    endif()
  endforeach()
  teletact_reads(${target} libraries tools/cmake/precompiled.hpp)
endfunction()

# The same with the graph of a box, for what stands above it.
function(teletact_reads_graph target)
  if(TELETACT_SANITIZE)
    return()
  endif()
  teletact_reads(${target} graph_libraries tools/cmake/precompiled_graph.hpp)
endfunction()

# teletact_library(<module>_<folder> [FOLDER dir] [PARTS dir...] [DEPS ours...] [PACKAGES
# imported...] [PRIVATE header...]) Takes every .cpp of the folder, and of the folders in it that
# PARTS names; headers only become an interface library. PRIVATE: headers below the folder that are
# not installed. Only what is below the folder, and tests, may include them
# (tools/check_headers.py).
function(teletact_library name)
  cmake_parse_arguments(A "" "FOLDER" "PARTS;DEPS;PACKAGES;PRIVATE" ${ARGN})
  set(patterns ${CMAKE_CURRENT_SOURCE_DIR}/${A_FOLDER}/*.cpp)
  foreach(part ${A_PARTS})
    list(APPEND patterns ${CMAKE_CURRENT_SOURCE_DIR}/${A_FOLDER}/${part}/*.cpp)
  endforeach()
  file(GLOB sources CONFIGURE_DEPENDS ${patterns})
  teletact_alone(${sources})
  if(sources)
    add_library(teletact_${name} STATIC ${sources})
    set(kind PUBLIC)
  else()
    add_library(teletact_${name} INTERFACE)
    set(kind INTERFACE)
  endif()
  target_link_libraries(teletact_${name} ${kind} teletact_options ${A_PACKAGES})
  foreach(dep ${A_DEPS})
    target_link_libraries(teletact_${name} ${kind} teletact_${dep})
  endforeach()
  if(TELETACT_SANITIZE AND sources)
    # What the tests spend their time in; the tests themselves are compiled faster at -O1.
    target_compile_options(teletact_${name} PRIVATE -O2)
  endif()
  if(sources AND name MATCHES "^(perception|drivers|tasks)_")
    if(name STREQUAL "tasks_graph")
      teletact_reads_graph(teletact_${name})
    else()
      teletact_reads_geometry(teletact_${name})
    endif()
  endif()
  add_library(teletact::${name} ALIAS teletact_${name})
  foreach(header ${A_PRIVATE})
    cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE top)
    cmake_path(SET path NORMALIZE ${top}/${A_FOLDER}/${header})
    set_property(GLOBAL APPEND PROPERTY teletact_private_headers ${path})
  endforeach()
  teletact_install(${name})
endfunction()

# Compiles files of a test or a measurement together, in groups that tools/unity_groups.py finds
# when the build is configured. After an edit that gives a file a name of its group, run cmake
# again.
function(teletact_together target)
  if(NOT TELETACT_UNITY)
    return()
  endif()
  get_property(known GLOBAL PROPERTY teletact_groups)
  if(NOT known)
    find_package(Python3 QUIET COMPONENTS Interpreter)
    set(known none)
    if(Python3_FOUND)
      set(trees)
      foreach(tree tests/unit tests/fault tests/negative tests/stability tools/measure)
        list(APPEND trees ${PROJECT_SOURCE_DIR}/${tree})
      endforeach()
      execute_process(COMMAND ${Python3_EXECUTABLE} ${PROJECT_SOURCE_DIR}/tools/unity_groups.py ${trees}
        OUTPUT_VARIABLE lines COMMAND_ERROR_IS_FATAL ANY)
      string(REGEX REPLACE "\n+" ";" lines "${lines}")
      foreach(line ${lines})
        string(REGEX MATCH "^(.*) ([0-9]+)$" line "${line}")
        set_property(GLOBAL PROPERTY "teletact_group_${CMAKE_MATCH_1}" g${CMAKE_MATCH_2})
      endforeach()
      set(known found)
    endif()
    set_property(GLOBAL PROPERTY teletact_groups ${known})
  endif()
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    cmake_path(ABSOLUTE_PATH source OUTPUT_VARIABLE whole)
    get_property(group GLOBAL PROPERTY "teletact_group_${whole}")
    if(group)
      set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${group})
    endif()
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

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

# teletact_test(<name> [DEPS ours...] [PACKAGES ...] [LABELS ...] [TIMEOUT s] [NO_GUARD]
# [NO_SANITIZE]
#               [NEEDS_FAULTS] [COST s] [LONG] [LONG_TESTS pattern...] [ALONE_TESTS pattern...] [WHOLE_TESTS pattern...]
#               [LATER_TESTS pattern...])
# Every .cpp of the calling folder becomes one GoogleTest program test_<name>. The allocation and
# lock guard is linked in unless NO_GUARD or a sanitizer is on. Labels: unit; sanitize (run by
# tools/test --all with AddressSanitizer and UBSan) unless NO_SANITIZE, which is for what takes
# minutes or runs the whole program, or LABELS timing; LABELS threads: run with ThreadSanitizer too.
# LABELS bytes: readers of bytes from outside, and rings: quick ones, that CI runs with
# AddressSanitizer and UBSan on every change. NEEDS_FAULTS: not declared when TELETACT_FAULTS is
# OFF, for it runs a planned executor. Sanitizers get five times the TIMEOUT. LABELS timing: nothing
# runs beside it. COST: about how many seconds it takes, from 10 on: ctest begins with the longest,
# so that none runs alone at the end. LONG: takes hours; run by tools/test --long, that is ctest -C
# long -L long, and by no other ctest. LONG_TESTS: tests that repeat for minutes what others do
# once; a sanitizer, which takes ten times as long, runs the program without them. ALONE_TESTS:
# tests that compare CPU times; what another core does changes them (shared cache, shared execution
# units), so each is a test of its own with nothing beside it; a sanitizer, under which a CPU time
# is not the product's, runs them with the others. WHOLE_TESTS: tests that take few of their samples
# (tests/support/whole.hpp); <name>.whole runs them with all, by tools/test --all, that is ctest -C
# all, and by no other. LATER_TESTS: tests that only <name>.whole runs: further cases of what another
# test holds, each of many seconds.
function(teletact_test name)
  cmake_parse_arguments(A "NO_GUARD;NO_SANITIZE;NEEDS_FAULTS;LONG" "TIMEOUT;COST"
    "DEPS;PACKAGES;LABELS;LONG_TESTS;ALONE_TESTS;WHOLE_TESTS;LATER_TESTS"
    ${ARGN})
  if(A_NEEDS_FAULTS AND NOT TELETACT_FAULTS)
    return()
  endif()
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  add_executable(test_${name} ${sources})
  # At -O1 they take a third less to compile. What they test is in the libraries; a test that counts
  # or times what is in headers has that compiled as the product has it.
  set(kind timed_tests)
  set(header precompiled)
  set(below)
  if(TELETACT_PRECOMPILE AND NOT "timing" IN_LIST A_LABELS AND NOT A_ALONE_TESTS)
    set(kind tests)
    set_target_properties(test_${name} PROPERTIES TELETACT_TEST_CODE ON)
    # Most files of these read the graph of a box, which takes GCC 8 s.
    foreach(above program tool_host tool_desk tasks_graph)
      if(above IN_LIST A_DEPS)
        set(kind graph_tests)
        set(header precompiled_graph)
        set(below teletact_program)
      endif()
    endforeach()
  endif()
  target_link_libraries(test_${name} PRIVATE teletact_options GTest::gtest_main GTest::gmock
    ${A_PACKAGES})
  foreach(dep ${A_DEPS})
    target_link_libraries(test_${name} PRIVATE teletact_${dep})
  endforeach()
  target_compile_definitions(test_${name} PRIVATE
    TELETACT_SOURCE_DIR="${PROJECT_SOURCE_DIR}" TELETACT_BINARY_DIR="${PROJECT_BINARY_DIR}")
  teletact_precompiled(test_${name} ${kind} tests/support/${header}.hpp
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
  set_tests_properties(${name} PROPERTIES TIMEOUT ${A_TIMEOUT} LABELS "${labels}")
  if("timing" IN_LIST labels)
    set_tests_properties(${name} PROPERTIES RUN_SERIAL TRUE)
  endif()
  if(A_COST)
    set_tests_properties(${name} PROPERTIES COST ${A_COST})
  endif()
  if((A_WHOLE_TESTS OR A_LATER_TESTS) AND NOT TELETACT_SANITIZE)
    string(JOIN ":" filter ${A_WHOLE_TESTS} ${A_LATER_TESTS})
    add_test(NAME ${name}.whole COMMAND test_${name} --gtest_filter=${filter} CONFIGURATIONS all)
    set_tests_properties(${name}.whole PROPERTIES TIMEOUT 1800 COST 1000 LABELS "${labels}"
      ENVIRONMENT TELETACT_WHOLE=1 FAIL_REGULAR_EXPRESSION "Running 0 tests")
    if("timing" IN_LIST labels)
      set_tests_properties(${name}.whole PROPERTIES RUN_SERIAL TRUE)
    endif()
  endif()
endfunction()
