# libturbojpeg as one imported target, turbojpeg::turbojpeg. Debian's package has no CMake file.
find_path(TurboJpeg_INCLUDE_DIR turbojpeg.h)
find_library(TurboJpeg_LIBRARY turbojpeg)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(TurboJpeg REQUIRED_VARS TurboJpeg_LIBRARY TurboJpeg_INCLUDE_DIR)
if(TurboJpeg_FOUND AND NOT TARGET turbojpeg::turbojpeg)
  add_library(turbojpeg::turbojpeg UNKNOWN IMPORTED GLOBAL)
  set_target_properties(turbojpeg::turbojpeg PROPERTIES
    IMPORTED_LOCATION ${TurboJpeg_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${TurboJpeg_INCLUDE_DIR})
endif()
