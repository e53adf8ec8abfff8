// The C functions of OpenNI 2.2 that the driver uses, with the layouts of the library's own headers
// (OniCTypes.h, OniCEnums.h, OniCProperties.h). Tests compare them with those headers where they
// are installed. The library is loaded at run time and is not needed to build.
#pragma once

#include <cstdint>

namespace drivers::openni2 {

inline constexpr int kApiVersion = 2 * 1000 + 2;
inline constexpr int kSensorColour = 2, kSensorDepth = 3;
inline constexpr int kFormatDepth1mm = 100, kFormatDepth100um = 101, kFormatRgb888 = 200;
inline constexpr int kStatusOk = 0, kStatusNoDevice = 6, kStatusTimeOut = 102;
inline constexpr int kRegistrationDepthToColour = 1;
inline constexpr int kDeviceImageRegistration = 5;
inline constexpr int kStreamHorizontalFov = 1, kStreamVerticalFov = 2, kStreamVideoMode = 3,
                     kStreamMirroring = 7;

struct VideoMode {
  int pixel_format, width, height, fps;
};

struct Frame {
  int data_size;
  void* data;
  int sensor_type;
  std::uint64_t timestamp_us;
  int frame_index;
  int width, height;
  VideoMode mode;
  int cropping_enabled, crop_x, crop_y;
  int stride;  // bytes from row to row
};

struct DeviceInfo {
  char uri[256], vendor[256], name[256];
  std::uint16_t usb_vendor, usb_product;
};

using Device = struct DeviceTag*;
using Stream = struct StreamTag*;

struct Api {
  int (*initialize)(int api_version);
  void (*shutdown)();
  const char* (*extended_error)();
  int (*device_list)(DeviceInfo** devices, int* count);
  int (*release_device_list)(DeviceInfo* devices);
  int (*device_open)(const char* uri, Device* device);
  int (*device_close)(Device device);
  int (*device_set)(Device device, int property, const void* data, int size);
  int (*registration_supported)(Device device, int mode);
  int (*create_stream)(Device device, int sensor, Stream* stream);
  void (*destroy_stream)(Stream stream);
  int (*start)(Stream stream);
  void (*stop)(Stream stream);
  int (*wait_for_any)(Stream* streams, int count, int* index, int timeout_ms);
  int (*read_frame)(Stream stream, Frame** frame);
  void (*release_frame)(Frame* frame);
  int (*stream_set)(Stream stream, int property, const void* data, int size);
  int (*stream_get)(Stream stream, int property, void* data, int* size);
};

}  // namespace drivers::openni2
