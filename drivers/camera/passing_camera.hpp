// A camera before which somebody walks to and fro from an instant on: put into the images of any camera, rendered or
// recorded. For calibration: what fusion costs and whether it tracks while something moves.
//
// A cylinder of 0.48 m with a head, 1.75 m high, walks at 1.5 m/s (50 mm an image) across the view at 1.3 m and back at 1.0 m, and so on,
// in the frame of the floor under the camera: where the camera moves, it goes along. True order in depth: a pixel shows
// them where they are nearer than the camera's reading, or where that has none; with the noise of a Kinect v2 (axial,
// lateral, drop-out and flying pixels at their outline). Images before that instant are the camera's, bit for bit.
#pragma once

#include <memory>

#include "drivers/camera/camera.hpp"
#include "drivers/camera/render.hpp"
#include "drivers/world/world.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

class PassingCamera final : public Camera {
 public:
  // X_BC: the camera above the floor; B has its origin on the floor, x forward and z up. `from`: of exposures.
  PassingCamera(rt::NonRealtime&, std::unique_ptr<Camera> camera, const perception::Pose& X_BC,
                rt::Time from);
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return camera_->intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return camera_->rate_hz(); }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;

  // Puts them into an image that was exposed then. Returns how many pixels show them.
  int add_to(perception::RgbdFrame& out) noexcept;

 private:
  std::unique_ptr<Camera> camera_;
  perception::Pose X_BC_;
  rt::Time from_;
  World world_;
  DepthNoise noise_;
  RenderScratch scratch_;
  std::unique_ptr<perception::RgbdFrame> alone_;
};

}  // namespace drivers
