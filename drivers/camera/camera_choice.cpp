#include "drivers/camera/camera_choice.hpp"

#include <stdexcept>
#include <utility>

namespace drivers {

void LensConfig::describe(config::Section& s) {
  s.integer("width_px", width_px, 0, perception::RgbdFrame::kMaxWidth, "0: 640, Kinect v2 512");
  s.integer("height_px", height_px, 0, perception::RgbdFrame::kMaxHeight, "0: 480, Kinect v2 424");
  s.number("fx_px", fx_px, 0, 5000, "focal length; 0: 570.3 at 640 columns, Kinect v2 365");
  s.number("fy_px", fy_px, 0, 5000, "0: as fx_px");
  s.number("cx_px", cx_px, 0, 5000, "principal point; 0: the middle");
  s.number("cy_px", cy_px, 0, 5000, "0: the middle");
}

void CameraChoice::describe(config::Section& s) {
  s.text("kind", kind, {"synthetic", "openni2", "freenect2"}, "what the robot's box looks through");
  lens.describe(
      s.section("lens", "of a real camera, as calibrated; 0: what is usual for its kind"));
  s.number("delay_ms", delay_ms, 0, 500,
           "of a real camera: from the middle of an exposure to the frame's arrival");
  openni2.describe(s.section("openni2", "Primesense, Xtion, Orbbec ... by OpenNI 2"));
  freenect2.describe(s.section("freenect2", "Kinect v2 by libfreenect2"));
  s.list(
      "bias", [this](config::Section& item) { bias.emplace_back().describe(item); },
      "a point of the depth bias table; readings rise");
}

perception::Intrinsics CameraChoice::intrinsics() const noexcept {
  const bool kinect2 = kind == "freenect2";
  const auto either = [](auto given, auto usual) { return given > 0 ? given : usual; };
  perception::Intrinsics k{};
  k.width = either(lens.width_px, kinect2 ? 512 : 640);
  k.height = either(lens.height_px, kinect2 ? 424 : 480);
  k.fx = either(lens.fx_px, kinect2 ? 365.0 : 570.3 * k.width / 640);
  k.fy = either(lens.fy_px, k.fx);
  k.cx = either(lens.cx_px, 0.5 * (k.width - 1));
  k.cy = either(lens.cy_px, 0.5 * (k.height - 1));
  return k;
}

std::unique_ptr<Camera> open_camera(rt::NonRealtime& nrt, const CameraChoice& choice,
                                    std::function<rt::Time()> now, std::string& said) {
  std::unique_ptr<FrameSource> source;
  if (choice.kind == "openni2") {
    auto opened = OpenNi2Source::open(nrt, choice.openni2, choice.intrinsics());
    if (!opened) throw std::runtime_error(opened.error());
    source = std::move(opened).value();
  } else {
    auto opened = open_freenect2(nrt, choice.freenect2, choice.intrinsics());
    if (!opened) throw std::runtime_error(opened.error());
    source = std::move(opened).value();
  }
  said = source->description();
  return std::make_unique<GrabbedCamera>(nrt, std::move(source), std::move(now),
                                         rt::nanos_from_seconds(1e-3 * choice.delay_ms));
}

std::unique_ptr<Camera> without_bias(rt::NonRealtime& nrt, std::unique_ptr<Camera> camera,
                                     const DepthBiasTable& table) {
  if (table.empty()) return camera;
  return std::make_unique<BiasedCamera>(nrt, std::move(camera), table);
}

}  // namespace drivers
