# OMPL as one imported target, ompl::ompl. OMPL's own config file also names libraries that the
# planner does not use, and by absolute paths, which an installed package of ours must not carry
# along.
find_path(OmplLibrary_INCLUDE_DIR ompl/config.h PATH_SUFFIXES ompl-1.7 ompl-1.6 ompl-1.5)
find_library(OmplLibrary_LIBRARY ompl)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OmplLibrary REQUIRED_VARS OmplLibrary_LIBRARY OmplLibrary_INCLUDE_DIR)
if(OmplLibrary_FOUND AND NOT TARGET ompl::ompl)
  add_library(ompl::ompl UNKNOWN IMPORTED GLOBAL)
  set_target_properties(ompl::ompl PROPERTIES
    IMPORTED_LOCATION ${OmplLibrary_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${OmplLibrary_INCLUDE_DIR})
endif()
