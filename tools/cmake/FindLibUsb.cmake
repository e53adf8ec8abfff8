# libusb-1.0 as one imported target, libusb::libusb. Debian's package brings a pkg-config file only.
find_path(LibUsb_INCLUDE_DIR libusb.h PATH_SUFFIXES libusb-1.0)
find_library(LibUsb_LIBRARY usb-1.0)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LibUsb REQUIRED_VARS LibUsb_LIBRARY LibUsb_INCLUDE_DIR)
if(LibUsb_FOUND AND NOT TARGET libusb::libusb)
  add_library(libusb::libusb UNKNOWN IMPORTED GLOBAL)
  set_target_properties(libusb::libusb PROPERTIES
    IMPORTED_LOCATION ${LibUsb_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${LibUsb_INCLUDE_DIR})
endif()
