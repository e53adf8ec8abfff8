# Build functions of the project: its libraries. How they are compiled: compile.cmake; tests:
# testing.cmake.

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

include(compile)
teletact_install(options)

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
  if(sources)
    set(reads READS tools/cmake/geometry.hpp)
    if(name STREQUAL "tasks_graph")
      set(reads READS tools/cmake/graph.hpp PACKAGES teletact_rt_fault)
    elseif(name MATCHES "^(rt|config)")
      set(reads)
    endif()
    teletact_compile(teletact_${name} ${reads})
  endif()
  add_library(teletact::${name} ALIAS teletact_${name})
  foreach(header ${A_PRIVATE})
    cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE top)
    cmake_path(SET path NORMALIZE ${top}/${A_FOLDER}/${header})
    set_property(GLOBAL APPEND PROPERTY teletact_private_headers ${path})
  endforeach()
  teletact_install(${name})
endfunction()

include(testing)
