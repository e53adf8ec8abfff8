# libgpiod, version 1.6 or 2.x, as one imported target, libgpiod::libgpiod. Debian's package brings
# a pkg-config file only.
find_path(LibGpiod_INCLUDE_DIR gpiod.h)
find_library(LibGpiod_LIBRARY gpiod)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LibGpiod REQUIRED_VARS LibGpiod_LIBRARY LibGpiod_INCLUDE_DIR)
if(LibGpiod_FOUND AND NOT TARGET libgpiod::libgpiod)
  add_library(libgpiod::libgpiod UNKNOWN IMPORTED GLOBAL)
  set_target_properties(libgpiod::libgpiod PROPERTIES
    IMPORTED_LOCATION ${LibGpiod_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${LibGpiod_INCLUDE_DIR})
endif()
