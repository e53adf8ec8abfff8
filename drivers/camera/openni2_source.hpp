// A depth camera through OpenNI 2 (Debian: libopenni2-0): Primesense, Asus Xtion, Orbbec and others
// with an OpenNI driver; also recordings (uri = a .oni file). Depth in mm, with colour registered
// to it where the device can.
#pragma once

#include <memory>
#include <string>

#include "config/schema.hpp"
#include "drivers/camera/grabbed_camera.hpp"
#include "drivers/camera/openni2_api.hpp"
#include "rt/result.hpp"

namespace drivers {

// Section [camera.openni2].
struct OpenNi2Config {
  std::string uri;      // empty: the first device that is found
  std::string library;  // empty: libOpenNI2.so.0, libOpenNI2.so, wherever the loader finds them
  bool colour = true;
  void describe(config::Section& s);
};

class OpenNi2Source final : public FrameSource {
 public:
  // Opens and starts the device with images of `lens`' size. An error is one line that says what is
  // missing.
  [[nodiscard]] static rt::Result<std::unique_ptr<OpenNi2Source>> open(
      rt::NonRealtime&, const OpenNi2Config& config, const perception::Intrinsics& lens);
  ~OpenNi2Source() override;
  OpenNi2Source(const OpenNi2Source&) = delete;
  OpenNi2Source& operator=(const OpenNi2Source&) = delete;

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return lens_; }
  [[nodiscard]] double rate_hz() const noexcept override { return rate_hz_; }
  [[nodiscard]] std::string description() const override { return description_; }
  [[nodiscard]] CameraStatus wait_frame(int timeout_ms, perception::RgbdFrame& out) override;

 private:
  OpenNi2Source() = default;
  [[nodiscard]] std::string load(const OpenNi2Config& config);
  [[nodiscard]] std::string open_device(const OpenNi2Config& config);
  [[nodiscard]] std::string start_depth();
  void start_colour();
  [[nodiscard]] std::string failed(const std::string& what) const;
  [[nodiscard]] bool copy_depth(const openni2::Frame& frame, perception::RgbdFrame& out) const;
  void keep_colour(const openni2::Frame& frame);

  void* handle_ = nullptr;
  openni2::Api api_{};
  bool initialised_ = false;
  openni2::Device device_ = nullptr;
  openni2::Stream depth_ = nullptr, colour_ = nullptr;
  perception::Intrinsics lens_{};
  double rate_hz_ = 30;
  std::string description_;
  std::unique_ptr<perception::RgbdFrame> newest_colour_;  // depth is void in it
};

}  // namespace drivers
