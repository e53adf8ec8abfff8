// Selects the camera of the robot's box: the synthetic one (or a recording, which a scene names
// elsewhere), an OpenNI 2 device or a Kinect v2. Also the settings that all of them share: lens,
// delay, depth bias.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "config/schema.hpp"
#include "drivers/camera/camera.hpp"
#include "drivers/camera/depth_bias.hpp"
#include "drivers/camera/freenect2_source.hpp"
#include "drivers/camera/openni2_source.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [camera.lens], for a real camera. 0: the usual value of its kind.
struct LensConfig {
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  void describe(config::Section& s);
};

// Section [camera], beside the keys of the synthetic one.
struct CameraChoice {
  std::string kind = "synthetic";
  LensConfig lens;
  double delay_ms = 20;  // from the middle of an exposure to the frame's arrival
  OpenNi2Config openni2;
  Freenect2Config freenect2;
  DepthBiasTable bias;

  void describe(config::Section& s);
  [[nodiscard]] bool in_process() const { return kind == "synthetic"; }
  // Of a real camera.
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept;
};

// Opens the real camera that `choice` names. Throws std::runtime_error with one line that says what
// is missing. `said`: the device's description of itself.
[[nodiscard]] std::unique_ptr<Camera> open_camera(rt::NonRealtime&, const CameraChoice& choice,
                                                  std::function<rt::Time()> now, std::string& said);
// The camera with its depth bias removed; without a table the camera itself.
[[nodiscard]] std::unique_ptr<Camera> without_bias(rt::NonRealtime&, std::unique_ptr<Camera> camera,
                                                   const DepthBiasTable& table);

}  // namespace drivers
