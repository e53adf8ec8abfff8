# The OpenCV modules in use, from their own Debian packages. Debian's OpenCVConfig.cmake comes only
# with the metapackage libopencv-dev (300 packages); headers and libraries of one module do not need
# it.
find_path(OpenCVModules_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4)
set(OpenCVModules_required OpenCVModules_INCLUDE_DIR)
foreach(module ${OpenCVModules_FIND_COMPONENTS})
  find_library(OpenCVModules_${module}_LIBRARY opencv_${module})
  list(APPEND OpenCVModules_required OpenCVModules_${module}_LIBRARY)
  if(OpenCVModules_${module}_LIBRARY AND NOT TARGET opencv::${module})
    add_library(opencv::${module} UNKNOWN IMPORTED GLOBAL)
    set_target_properties(opencv::${module} PROPERTIES
      IMPORTED_LOCATION ${OpenCVModules_${module}_LIBRARY}
      INTERFACE_INCLUDE_DIRECTORIES ${OpenCVModules_INCLUDE_DIR})
  endif()
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCVModules REQUIRED_VARS ${OpenCVModules_required})
