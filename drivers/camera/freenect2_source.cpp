#include "drivers/camera/freenect2_source.hpp"

#if TELETACT_FREENECT2
#include <libfreenect2/frame_listener_impl.h>
#include <libfreenect2/packet_pipeline.h>
#include <libfreenect2/registration.h>
#include <libfreenect2/libfreenect2.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#endif

namespace drivers {

void Freenect2Config::describe(config::Section& s) {
  s.text("serial", serial, {}, "serial number; empty: the first one that is found");
  s.flag("colour", colour, "read the colour camera too");
}

#if !TELETACT_FREENECT2

bool has_freenect2() noexcept { return false; }

rt::Result<std::unique_ptr<FrameSource>> open_freenect2(rt::NonRealtime&, const Freenect2Config&,
                                                        const perception::Intrinsics&) {
  return rt::Error{
      "camera.kind = freenect2: this program was built without libfreenect2 (no Debian package: "
      "build "
      "it from github.com/OpenKinect/libfreenect2, give its place to CMAKE_PREFIX_PATH and "
      "configure "
      "again)"};
}

#else

bool has_freenect2() noexcept { return true; }

namespace {

using libfreenect2::Frame;
using perception::RgbdFrame;

constexpr int kWidth = 512, kHeight = 424;

std::uint16_t to_mm(float depth) noexcept {
  return depth > 0.5F && depth < 65534.5F ? static_cast<std::uint16_t>(std::lround(depth))
                                          : std::uint16_t{0};
}

class Freenect2Source final : public FrameSource {
 public:
  explicit Freenect2Source(const perception::Intrinsics& lens) : lens_(lens) {}
  ~Freenect2Source() override {
    if (device_ == nullptr) return;
    device_->stop();
    device_->close();
  }
  Freenect2Source(const Freenect2Source&) = delete;
  Freenect2Source& operator=(const Freenect2Source&) = delete;

  // Empty: it runs.
  std::string start(const Freenect2Config& config) {
    const int count = library_.enumerateDevices();
    std::string seen;
    for (int i = 0; i < count; ++i)
      seen += (i == 0 ? "" : ", ") + library_.getDeviceSerialNumber(i);
    const std::string serial =
        config.serial.empty() ? library_.getDefaultDeviceSerialNumber() : config.serial;
    // The library keeps the pipeline, and deletes it where it does not open.
    if (count > 0) device_ = library_.openDevice(serial, new libfreenect2::CpuPacketPipeline());
    if (device_ == nullptr) {
      return "camera.kind = freenect2: no device" +
             (config.serial.empty() ? std::string() : " '" + config.serial + "'") +
             "; found: " + (seen.empty() ? "none (USB 3 is needed, and the right to it)" : seen);
    }
    unsigned int types = Frame::Depth;
    if (config.colour) types |= Frame::Color;
    listener_ = std::make_unique<libfreenect2::SyncMultiFrameListener>(types);
    device_->setIrAndDepthFrameListener(listener_.get());
    if (config.colour) device_->setColorFrameListener(listener_.get());
    colour_ = config.colour;
    if (!device_->startStreams(config.colour, true))
      return "camera.kind = freenect2: " + serial + " does not start";
    const auto ir = device_->getIrCameraParams();
    registration_ =
        std::make_unique<libfreenect2::Registration>(ir, device_->getColorCameraParams());
    char text[128];
    std::snprintf(text, sizeof text,
                  "Kinect v2 %s, its lens: fx %.2f, fy %.2f, cx %.2f, cy %.2f px", serial.c_str(),
                  static_cast<double>(ir.fx), static_cast<double>(ir.fy),
                  static_cast<double>(ir.cx), static_cast<double>(ir.cy));
    description_ = text;
    return {};
  }

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return lens_; }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  [[nodiscard]] std::string description() const override { return description_; }

  [[nodiscard]] CameraStatus wait_frame(int timeout_ms, RgbdFrame& out) override {
    libfreenect2::FrameMap frames;
    if (!listener_->waitForNewFrame(frames, timeout_ms)) return CameraStatus::kNoFrame;
    const Frame* depth = frames[Frame::Depth];
    const bool good = depth != nullptr && depth->status == 0 && depth->width == kWidth &&
                      depth->height == kHeight;
    if (good && colour_ && frames[Frame::Color] != nullptr) {
      registration_->apply(frames[Frame::Color], depth, &undistorted_, &registered_);
      copy_colour(out);
    } else if (good) {
      registration_->undistortDepth(depth, &undistorted_);
      out.has_colour = false;
    }
    if (good) copy_depth(out);
    listener_->release(frames);
    // A frame that came damaged is as good as none.
    return good ? CameraStatus::kFrame : CameraStatus::kNoFrame;
  }

 private:
  void copy_depth(RgbdFrame& out) const {
    out.intrinsics = lens_;
    const auto* depth = reinterpret_cast<const float*>(undistorted_.data);
    std::transform(depth, depth + kWidth * kHeight, out.depth_mm.begin(), to_mm);
  }
  void copy_colour(RgbdFrame& out) const {
    out.has_colour = true;
    // B, G, R, unused. The library writes zeros where the colour camera does not see the pixel,
    // which is the sign of no_colour.hpp. Exactly black pixels, which a sensor hardly gives, then
    // have no colour either.
    const unsigned char* p = registered_.data;
    for (std::size_t i = 0; i < std::size_t{kWidth} * kHeight; ++i, p += 4)
      out.colour[i] = {p[2], p[1], p[0]};
  }

  perception::Intrinsics lens_;
  std::string description_;
  bool colour_ = false;
  libfreenect2::Freenect2 library_;
  libfreenect2::Freenect2Device* device_ = nullptr;  // of library_
  std::unique_ptr<libfreenect2::SyncMultiFrameListener> listener_;
  std::unique_ptr<libfreenect2::Registration> registration_;
  Frame undistorted_{kWidth, kHeight, 4}, registered_{kWidth, kHeight, 4};
};

}  // namespace

rt::Result<std::unique_ptr<FrameSource>> open_freenect2(rt::NonRealtime&,
                                                        const Freenect2Config& config,
                                                        const perception::Intrinsics& lens) {
  if (lens.width != kWidth || lens.height != kHeight) {
    return rt::Error{"camera.lens: " + std::to_string(lens.width) + " x " +
                     std::to_string(lens.height) + " px, a Kinect v2 has 512 x 424"};
  }
  auto source = std::make_unique<Freenect2Source>(lens);
  if (std::string error = source->start(config); !error.empty()) return rt::Error{error};
  return std::unique_ptr<FrameSource>(std::move(source));
}

#endif

}  // namespace drivers
