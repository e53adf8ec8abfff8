# How sources become objects: warnings, optimisation, precompiled headers, files compiled together,
# ccache. docs/build.md says how to change one flag.
#
# TELETACT_COLD, a property of a target, chooses between two levels of optimisation: code that runs
# once for a person's command, and tests, at -O1, which takes the compiler a third less; all else at
# the product's -O3.

option(TELETACT_WERROR "Warnings are errors, with the compiler of Debian 12" OFF)
option(TELETACT_UNITY "Compile files of a library together" OFF)
option(TELETACT_PRECOMPILE "Precompile the headers that many files share" OFF)
set(TELETACT_SANITIZE "" CACHE STRING "Sanitizers, e.g. address,undefined or thread")

# A second build, in this folder or in another clone, takes what the first one compiled. Paths below
# the source tree count relative to the build folder. CCACHE_DISABLE=1 switches it off.
find_program(TELETACT_CCACHE ccache)
if(TELETACT_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=1
    CCACHE_SLOPPINESS=pch_defines,time_macros ${TELETACT_CCACHE})
endif()

# Another compiler may warn of more.
set(werror OFF)
if(TELETACT_WERROR AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION MATCHES "^12\\.")
  set(werror ON)
endif()

add_library(teletact_options INTERFACE)
target_include_directories(teletact_options INTERFACE
  $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:${TELETACT_INSTALL_INCLUDE}>)
# -ffp-contract=off: the same bytes from every instruction set; an FMA would round once less. Some
# of the algorithms live in headers, so a consumer gets it too; warnings and optimisation stay ours.
# -Wno-restrict: GCC 12 warns falsely of overlapping copies in std::string + "literal" (PR 105329);
# -Wno-maybe-uninitialized: at -O1 of an empty std::optional.
target_compile_options(teletact_options INTERFACE
  "$<BUILD_INTERFACE:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wconversion;-Wno-sign-conversion>"
  "$<BUILD_INTERFACE:-Wold-style-cast;-Wdouble-promotion;-Wno-restrict>"
  -ffp-contract=off
  "$<BUILD_INTERFACE:$<$<BOOL:${werror}>:-Werror>>"
  "$<BUILD_INTERFACE:$<$<CONFIG:Release>:$<IF:$<BOOL:$<TARGET_PROPERTY:TELETACT_COLD>>,-O1;-Wno-maybe-uninitialized,-O3>>>")
if(TELETACT_PRECOMPILE)
  # Files compiled together need up to 1.6 GB. GCC's own threshold makes it collect garbage again and
  # again on the way there, which takes a tenth of its time. It also takes a precompiled std::string
  # for ours and warns falsely in `"literal" + std::string` (as above).
  target_compile_options(teletact_options INTERFACE
    "$<BUILD_INTERFACE:$<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=800000>>"
    "$<BUILD_INTERFACE:-Wno-stringop-overflow;-Wno-stringop-overread;-Wno-array-bounds>")
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
  # Without no-recover UBSan prints its findings and the test passes. What the tests spend their time
  # in is optimised, the tests themselves hardly.
  target_compile_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE}
    -fno-sanitize-recover=all -fno-omit-frame-pointer
    $<IF:$<BOOL:$<TARGET_PROPERTY:TELETACT_COLD>>,-O1,-O2>)
  target_link_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE})
endif()
# Eigen must not start threads, and its assertions would throw out of a step().
target_compile_definitions(teletact_options INTERFACE EIGEN_DONT_PARALLELIZE)
target_link_libraries(teletact_options INTERFACE Threads::Threads $<INSTALL_INTERFACE:Eigen3::Eigen>)
target_include_directories(teletact_options SYSTEM INTERFACE
  $<BUILD_INTERFACE:$<TARGET_PROPERTY:Eigen3::Eigen,INTERFACE_INCLUDE_DIRECTORIES>>)

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

# Precompiles HEADER once for all targets of one kind that name it: kinds differ in the level of
# optimisation, which GCC takes from the precompiled header, and in position-independent code.
# teletact_precompile(<target> <header> [PACKAGES imported...])
function(teletact_precompile target header)
  if(NOT TELETACT_PRECOMPILE)
    return()
  endif()
  cmake_parse_arguments(A "" "" "PACKAGES" ${ARGN})
  get_target_property(type ${target} TYPE)
  get_target_property(cold ${target} TELETACT_COLD)
  string(MAKE_C_IDENTIFIER "${header}" owner)
  string(REGEX REPLACE "_hpp$" "" owner "teletact_pch_${owner}")
  if(cold)
    string(APPEND owner "_cold")
  endif()
  if(type STREQUAL "EXECUTABLE")
    string(APPEND owner "_program")
  endif()
  if(NOT TARGET ${owner})
    set(empty ${PROJECT_BINARY_DIR}/${owner}.cpp)
    file(CONFIGURE OUTPUT ${empty} CONTENT "int main() {}\n")
    if(type STREQUAL "EXECUTABLE")
      add_executable(${owner} EXCLUDE_FROM_ALL ${empty})
    else()
      add_library(${owner} OBJECT EXCLUDE_FROM_ALL ${empty})
    endif()
    if(cold)
      set_target_properties(${owner} PROPERTIES TELETACT_COLD ON)
    endif()
    target_link_libraries(${owner} PRIVATE teletact_options ${A_PACKAGES})
    # In quotes CMake takes the name as it is: the generated file is then the same in every folder.
    target_precompile_headers(${owner} PRIVATE "\"${header}\"")
  endif()
  target_precompile_headers(${target} REUSE_FROM ${owner})
endfunction()

# Makes one source of several: files of a target that have no options of their own. Their names stand
# relative to the source tree, so that the generated file is the same in every folder.
# teletact_together(<target> [GROUPS])   GROUPS: files of tests and measurements have names of their
# own that others have too; tools/unity_groups.py finds, when the build is configured, who can come
# together. After an edit that gives a file a name of its group, run cmake again.
function(teletact_together target)
  if(NOT TELETACT_UNITY)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  set(kept)
  set(names)
  foreach(source ${sources})
    cmake_path(ABSOLUTE_PATH source OUTPUT_VARIABLE whole)
    get_source_file_property(alone ${source} SKIP_UNITY_BUILD_INCLUSION)
    get_source_file_property(options ${source} COMPILE_OPTIONS)
    get_source_file_property(definitions ${source} COMPILE_DEFINITIONS)
    cmake_path(IS_PREFIX PROJECT_BINARY_DIR ${whole} generated)
    set(name)
    if(NOT (alone OR options OR definitions OR generated))
      set(name files)
      if("GROUPS" IN_LIST ARGN)
        teletact_group_of(${whole} name)
      endif()
    endif()
    if(name)
      list(APPEND names ${name})
      cmake_path(RELATIVE_PATH whole BASE_DIRECTORY ${PROJECT_SOURCE_DIR})
      list(APPEND in_${name} ${whole})
    else()
      list(APPEND kept ${source})
    endif()
  endforeach()
  list(REMOVE_DUPLICATES names)
  foreach(name ${names})
    list(LENGTH in_${name} count)
    set(most 8)
    get_target_property(cold ${target} TELETACT_COLD)
    if(cold)
      set(most 16)
    endif()
    if("GROUPS" IN_LIST ARGN)
      set(most ${count})
    endif()
    # Of equal size: none has to be waited for alone.
    math(EXPR pieces "(${count} + ${most} - 1) / ${most}")
    foreach(piece RANGE 1 ${pieces})
      math(EXPR from "(${count} * (${piece} - 1)) / ${pieces}")
      math(EXPR size "(${count} * ${piece}) / ${pieces} - ${from}")
      list(SUBLIST in_${name} ${from} ${size} part)
      list(TRANSFORM part PREPEND "#include \"")
      list(TRANSFORM part APPEND "\"\n")
      string(JOIN "" text "// Written by CMake: files of ${target} that are compiled together.\n" ${part})
      set(file ${CMAKE_CURRENT_BINARY_DIR}/together/${target}_${name}_${piece}.cpp)
      file(CONFIGURE OUTPUT ${file} CONTENT "${text}" @ONLY)
      list(APPEND kept ${file})
    endforeach()
  endforeach()
  set_property(TARGET ${target} PROPERTY SOURCES ${kept})
endfunction()

# The group of a file among the tests and measurements, or nothing: it stays alone.
function(teletact_group_of file out)
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
  get_property(group GLOBAL PROPERTY "teletact_group_${file}")
  set(${out} "${group}" PARENT_SCOPE)
endfunction()

# teletact_compile(<target> [COLD] [GROUPS] [READS header] [PACKAGES imported...]): the last word on a
# target of ours, when its sources are known. READS: the header that is precompiled for it.
function(teletact_compile target)
  cmake_parse_arguments(A "COLD;GROUPS" "READS" "PACKAGES" ${ARGN})
  if(A_COLD)
    set_target_properties(${target} PROPERTIES TELETACT_COLD ON)
  endif()
  # A precompiled header is of the target's options: not for files with some of their own.
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    get_source_file_property(own ${source} COMPILE_OPTIONS)
    get_source_file_property(alone ${source} SKIP_UNITY_BUILD_INCLUSION)
    if(own OR alone)
      set_source_files_properties(${source} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
    endif()
  endforeach()
  if(A_GROUPS)
    teletact_together(${target} GROUPS)
  else()
    teletact_together(${target})
  endif()
  if(A_READS)
    teletact_precompile(${target} ${A_READS} PACKAGES ${A_PACKAGES})
  endif()
endfunction()
