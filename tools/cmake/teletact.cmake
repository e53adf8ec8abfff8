# Build functions of the project: one place for warnings, sanitizers and floating-point rules.

add_library(teletact_options INTERFACE)
target_include_directories(teletact_options INTERFACE ${PROJECT_SOURCE_DIR})
# -ffp-contract=off: the same bytes from every instruction set; an FMA would round once less.
target_compile_options(teletact_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wold-style-cast
  -Wdouble-promotion -ffp-contract=off $<$<BOOL:${TELETACT_WERROR}>:-Werror>)
# Large test rigs and Eigen: a little debug information keeps stacks readable.
target_compile_options(teletact_options INTERFACE $<$<CONFIG:Release>:-O3>)
if(TELETACT_SANITIZE)
  target_compile_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE}
    -fno-omit-frame-pointer -g)
  target_link_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE})
endif()
# Eigen must not start threads, and its assertions would throw out of a step().
target_compile_definitions(teletact_options INTERFACE EIGEN_DONT_PARALLELIZE)
target_link_libraries(teletact_options INTERFACE Threads::Threads)
target_include_directories(teletact_options SYSTEM INTERFACE
  $<TARGET_PROPERTY:Eigen3::Eigen,INTERFACE_INCLUDE_DIRECTORIES>)

# teletact_library(<module>_<folder> [FOLDER dir] [DEPS ours...] [PACKAGES imported...])
# Takes every .cpp of the folder; a folder of headers only becomes an interface library.
function(teletact_library name)
  cmake_parse_arguments(A "" "FOLDER" "DEPS;PACKAGES" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${A_FOLDER}/*.cpp)
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
  add_library(teletact::${name} ALIAS teletact_${name})
endfunction()

# teletact_test(<name> [DEPS ours...] [PACKAGES ...] [LABELS ...] [TIMEOUT s] [NO_GUARD])
# Every .cpp of the calling folder becomes one GoogleTest program test_<name>. The allocation and
# lock guard is linked in unless NO_GUARD or a sanitizer is on.
function(teletact_test name)
  cmake_parse_arguments(A "NO_GUARD" "TIMEOUT" "DEPS;PACKAGES;LABELS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  add_executable(test_${name} ${sources})
  target_link_libraries(test_${name} PRIVATE teletact_options GTest::gtest_main GTest::gmock
    ${A_PACKAGES})
  foreach(dep ${A_DEPS})
    target_link_libraries(test_${name} PRIVATE teletact_${dep})
  endforeach()
  target_compile_definitions(test_${name} PRIVATE
    TELETACT_SOURCE_DIR="${PROJECT_SOURCE_DIR}" TELETACT_BINARY_DIR="${PROJECT_BINARY_DIR}")
  if(NOT A_NO_GUARD AND NOT TELETACT_SANITIZE AND TARGET teletact_rt_guard)
    target_link_libraries(test_${name} PRIVATE teletact_rt_guard)
  endif()
  if(NOT A_TIMEOUT)
    set(A_TIMEOUT 300)
  endif()
  add_test(NAME ${name} COMMAND test_${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT ${A_TIMEOUT} LABELS "unit;${A_LABELS}")
endfunction()
