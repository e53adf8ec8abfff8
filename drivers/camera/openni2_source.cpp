#include "drivers/camera/openni2_source.hpp"

#include <dlfcn.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>
#include <type_traits>
#include <vector>

#include "perception/geometry/no_colour.hpp"

namespace drivers {

using openni2::Frame;
using openni2::VideoMode;
using perception::RgbdFrame;

void OpenNi2Config::describe(config::Section& s) {
  s.text("uri", uri, {}, "device or .oni file; empty: the first device that is found");
  s.text("library", library, {}, "file of the library; empty: where the loader finds it");
  s.flag("colour", colour, "read the colour camera too");
}

namespace {

std::string resolve(void* handle, openni2::Api& api) {
  std::string missing;
  const auto get = [&](auto& function, const char* name) {
    using Function = std::remove_reference_t<decltype(function)>;
    function = reinterpret_cast<Function>(::dlsym(handle, name));
    if (function == nullptr && missing.empty()) missing = name;
  };
  get(api.initialize, "oniInitialize");
  get(api.shutdown, "oniShutdown");
  get(api.extended_error, "oniGetExtendedError");
  get(api.device_list, "oniGetDeviceList");
  get(api.release_device_list, "oniReleaseDeviceList");
  get(api.device_open, "oniDeviceOpen");
  get(api.device_close, "oniDeviceClose");
  get(api.device_set, "oniDeviceSetProperty");
  get(api.registration_supported, "oniDeviceIsImageRegistrationModeSupported");
  get(api.create_stream, "oniDeviceCreateStream");
  get(api.destroy_stream, "oniStreamDestroy");
  get(api.start, "oniStreamStart");
  get(api.stop, "oniStreamStop");
  get(api.wait_for_any, "oniWaitForAnyStream");
  get(api.read_frame, "oniStreamReadFrame");
  get(api.release_frame, "oniFrameRelease");
  get(api.stream_set, "oniStreamSetProperty");
  get(api.stream_get, "oniStreamGetProperty");
  return missing;
}

}  // namespace

// What went wrong, with the library's own words behind, in one line.
std::string OpenNi2Source::failed(const std::string& what) const {
  std::string said = api_.extended_error != nullptr ? api_.extended_error() : "";
  for (char& c : said) c = c == '\n' || c == '\t' || c == '\r' ? ' ' : c;
  while (!said.empty() && said.back() == ' ') said.pop_back();
  while (!said.empty() && said.front() == ' ') said.erase(said.begin());
  return "camera.kind = openni2: " + what + (said.empty() ? "" : " (" + said + ")");
}

std::string OpenNi2Source::load(const OpenNi2Config& config) {
  std::vector<std::string> names{config.library};
  if (config.library.empty()) names = {"libOpenNI2.so.0", "libOpenNI2.so"};
  std::string why;
  for (const std::string& name : names) {
    handle_ = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (handle_ != nullptr) {
      const std::string missing = resolve(handle_, api_);
      return missing.empty() ? ""
                             : "camera.kind = openni2: " + name + " lacks the function " + missing;
    }
    why += (why.empty() ? "" : "; ") + std::string(::dlerror());
  }
  return "camera.kind = openni2: the library is missing (Debian package libopenni2-0): " + why;
}

std::string OpenNi2Source::open_device(const OpenNi2Config& config) {
  if (api_.initialize(openni2::kApiVersion) != openni2::kStatusOk)
    return failed("the library does not start");
  initialised_ = true;
  openni2::DeviceInfo* found = nullptr;
  int count = 0;
  std::string seen;
  if (api_.device_list(&found, &count) == openni2::kStatusOk) {
    for (int i = 0; i < count; ++i) {
      const std::string uri(found[i].uri, ::strnlen(found[i].uri, sizeof found[i].uri));
      const std::string name(found[i].name, ::strnlen(found[i].name, sizeof found[i].name));
      seen += (seen.empty() ? "" : ", ") + uri;
      if (uri == config.uri || (config.uri.empty() && i == 0)) description_ = name + ", " + uri;
    }
    api_.release_device_list(found);
  }
  const char* uri = config.uri.empty() ? nullptr : config.uri.c_str();
  if (api_.device_open(uri, &device_) == openni2::kStatusOk) {
    if (description_.empty()) description_ = config.uri;
    return {};
  }
  device_ = nullptr;
  const std::string who = config.uri.empty() ? "no device" : "no device '" + config.uri + "'";
  return failed(who + "; found: " + (seen.empty() ? "none" : seen));
}

std::string OpenNi2Source::start_depth() {
  if (api_.create_stream(device_, openni2::kSensorDepth, &depth_) != openni2::kStatusOk) {
    depth_ = nullptr;
    return failed("the device has no depth");
  }
  VideoMode mode{openni2::kFormatDepth1mm, lens_.width, lens_.height, 30};
  VideoMode has{};
  int size = sizeof has;
  const bool told = api_.stream_get(depth_, openni2::kStreamVideoMode, &has, &size) == 0;
  if (!told || has.width != mode.width || has.height != mode.height ||
      has.pixel_format != mode.pixel_format) {
    static_cast<void>(api_.stream_set(depth_, openni2::kStreamVideoMode, &mode, sizeof mode));
    size = sizeof has;
    if (api_.stream_get(depth_, openni2::kStreamVideoMode, &has, &size) != openni2::kStatusOk)
      has = {};
  }
  const bool format = has.pixel_format == openni2::kFormatDepth1mm ||
                      has.pixel_format == openni2::kFormatDepth100um;
  if (!format || has.width != lens_.width || has.height != lens_.height) {
    return failed("depth of " + std::to_string(lens_.width) + " x " + std::to_string(lens_.height) +
                  " is asked for (camera.lens), the device gives " + std::to_string(has.width) +
                  " x " + std::to_string(has.height) + " in format " +
                  std::to_string(has.pixel_format));
  }
  if (has.fps > 0) rate_hz_ = has.fps;
  const int mirrored = 0;
  static_cast<void>(api_.stream_set(depth_, openni2::kStreamMirroring, &mirrored, sizeof mirrored));
  float fov[2] = {0, 0};
  for (int axis = 0; axis < 2; ++axis) {
    size = sizeof(float);
    if (api_.stream_get(depth_,
                        axis == 0 ? openni2::kStreamHorizontalFov : openni2::kStreamVerticalFov,
                        fov + axis, &size) != openni2::kStatusOk)
      fov[axis] = 0;
  }
  if (fov[0] > 0 && fov[1] > 0) {
    char text[96];
    std::snprintf(text, sizeof text, ", its lens by the field of view: fx %.1f, fy %.1f px",
                  0.5 * has.width / std::tan(0.5 * static_cast<double>(fov[0])),
                  0.5 * has.height / std::tan(0.5 * static_cast<double>(fov[1])));
    description_ += text;
  }
  if (api_.start(depth_) != openni2::kStatusOk) return failed("depth does not start");
  return {};
}

// Without colour the camera still serves.
void OpenNi2Source::start_colour() {
  const int mode = openni2::kRegistrationDepthToColour;
  if (api_.registration_supported(device_, mode) == 0 ||
      api_.device_set(device_, openni2::kDeviceImageRegistration, &mode, sizeof mode) != 0 ||
      api_.create_stream(device_, openni2::kSensorColour, &colour_) != openni2::kStatusOk) {
    colour_ = nullptr;
    description_ += ", no colour registered to depth";
    return;
  }
  const VideoMode wanted{openni2::kFormatRgb888, lens_.width, lens_.height, 30};
  const int mirrored = 0;
  static_cast<void>(
      api_.stream_set(colour_, openni2::kStreamMirroring, &mirrored, sizeof mirrored));
  if (api_.stream_set(colour_, openni2::kStreamVideoMode, &wanted, sizeof wanted) != 0 ||
      api_.start(colour_) != openni2::kStatusOk) {
    api_.destroy_stream(colour_);
    colour_ = nullptr;
    description_ += ", no colour of this size";
    return;
  }
  newest_colour_ = std::make_unique<RgbdFrame>();
}

rt::Result<std::unique_ptr<OpenNi2Source>> OpenNi2Source::open(rt::NonRealtime&,
                                                               const OpenNi2Config& config,
                                                               const perception::Intrinsics& lens) {
  std::unique_ptr<OpenNi2Source> source(new OpenNi2Source());
  source->lens_ = lens;
  if (std::string error = source->load(config); !error.empty()) return rt::Error{error};
  if (std::string error = source->open_device(config); !error.empty()) return rt::Error{error};
  if (std::string error = source->start_depth(); !error.empty()) return rt::Error{error};
  if (config.colour) source->start_colour();
  return source;
}

OpenNi2Source::~OpenNi2Source() {
  for (const openni2::Stream stream : {colour_, depth_})
    if (stream != nullptr) api_.stop(stream);
  // Some drivers (the library's own dummy) do not wait for their thread when a stream stops. That
  // thread would then use a stream, or code, that is gone.
  if (depth_ != nullptr) std::this_thread::sleep_for(std::chrono::milliseconds(200));
  for (const openni2::Stream stream : {colour_, depth_})
    if (stream != nullptr) api_.destroy_stream(stream);
  if (device_ != nullptr) api_.device_close(device_);
  if (initialised_) api_.shutdown();
  if (handle_ != nullptr) ::dlclose(handle_);
}

bool OpenNi2Source::copy_depth(const Frame& frame, RgbdFrame& out) const {
  const int unit = frame.mode.pixel_format == openni2::kFormatDepth100um ? 10 : 1;
  if (frame.width != lens_.width || frame.height != lens_.height ||
      frame.stride < 2 * frame.width || frame.data == nullptr ||
      frame.data_size < frame.stride * (frame.height - 1) + 2 * frame.width)
    return false;
  const auto* bytes = static_cast<const std::uint8_t*>(frame.data);
  out.intrinsics = lens_;
  out.has_colour = false;
  for (int v = 0; v < frame.height; ++v) {
    std::uint16_t* row = out.depth().row(v);
    std::memcpy(row, bytes + static_cast<std::ptrdiff_t>(v) * frame.stride,
                2 * static_cast<std::size_t>(frame.width));
    for (int u = 0; unit > 1 && u < frame.width; ++u)
      row[u] = static_cast<std::uint16_t>((row[u] + unit / 2) / unit);
  }
  return true;
}

void OpenNi2Source::keep_colour(const Frame& frame) {
  if (frame.mode.pixel_format != openni2::kFormatRgb888 || frame.width != lens_.width ||
      frame.height != lens_.height || frame.stride < 3 * frame.width || frame.data == nullptr ||
      frame.data_size < frame.stride * (frame.height - 1) + 3 * frame.width)
    return;
  static_assert(sizeof(perception::Rgb) == 3);
  newest_colour_->intrinsics = lens_;
  newest_colour_->has_colour = true;
  const auto* bytes = static_cast<const std::uint8_t*>(frame.data);
  for (int v = 0; v < frame.height; ++v)
    std::memcpy(newest_colour_->rgb().row(v), bytes + static_cast<std::ptrdiff_t>(v) * frame.stride,
                3 * static_cast<std::size_t>(frame.width));
  // The device looks depth up in the colour camera's view: every pixel has a colour, black ones
  // too.
  perception::lift_black(newest_colour_->rgb());
}

// A frame is complete with its depth; the newest colour goes with it.
CameraStatus OpenNi2Source::wait_frame(int timeout_ms, RgbdFrame& out) {
  std::array<openni2::Stream, 2> streams{depth_, colour_};
  const int count = colour_ != nullptr ? 2 : 1;
  for (;;) {
    int index = -1;
    const int status = api_.wait_for_any(streams.data(), count, &index, timeout_ms);
    if (status == openni2::kStatusTimeOut) return CameraStatus::kNoFrame;
    if (status != openni2::kStatusOk || index < 0 || index >= count) return CameraStatus::kFault;
    Frame* frame = nullptr;
    if (api_.read_frame(streams[static_cast<std::size_t>(index)], &frame) != openni2::kStatusOk ||
        frame == nullptr)
      return CameraStatus::kFault;
    const bool depth = index == 0;
    const bool good = depth && copy_depth(*frame, out);
    if (!depth) keep_colour(*frame);
    api_.release_frame(frame);
    if (!depth) continue;
    if (!good) return CameraStatus::kFault;
    if (newest_colour_ != nullptr && newest_colour_->has_colour) {
      out.has_colour = true;
      std::memcpy(
          out.colour.data(), newest_colour_->colour.data(),
          3 * static_cast<std::size_t>(lens_.width) * static_cast<std::size_t>(lens_.height));
    }
    return CameraStatus::kFrame;
  }
}

}  // namespace drivers
