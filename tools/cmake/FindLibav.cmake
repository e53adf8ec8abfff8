# libavcodec with libavutil as one imported target, libav::avcodec. Debian's packages bring
# pkg-config files only.
find_path(Libav_INCLUDE_DIR libavcodec/avcodec.h PATH_SUFFIXES ffmpeg)
find_library(Libav_avcodec_LIBRARY avcodec)
find_library(Libav_avutil_LIBRARY avutil)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Libav
  REQUIRED_VARS Libav_avcodec_LIBRARY Libav_avutil_LIBRARY Libav_INCLUDE_DIR)
if(Libav_FOUND AND NOT TARGET libav::avcodec)
  add_library(libav::avutil UNKNOWN IMPORTED GLOBAL)
  set_target_properties(libav::avutil PROPERTIES IMPORTED_LOCATION ${Libav_avutil_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${Libav_INCLUDE_DIR})
  add_library(libav::avcodec UNKNOWN IMPORTED GLOBAL)
  set_target_properties(libav::avcodec PROPERTIES IMPORTED_LOCATION ${Libav_avcodec_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${Libav_INCLUDE_DIR} INTERFACE_LINK_LIBRARIES libav::avutil)
endif()
