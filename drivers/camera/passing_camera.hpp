// Adds a walking person to the images of any camera, rendered or recorded, from a given instant on.
// Calibration uses it to measure what fusion costs, and whether it tracks, while something moves.
//
// The person is a cylinder of 0.48 m diameter with a head, 1.75 m high. It walks at 1.5 m/s (50 mm
// an image) across the view at 1.3 m, back at 1.0 m, and so on, in the frame of the floor under the
// camera; it moves along with the camera. A pixel shows the person where it is nearer than the
// camera's reading, or where there is none. The person's pixels have the noise of a Kinect v2
// (axial, lateral, drop-out and flying pixels at the outline). Earlier images are the camera's, bit
// for bit.
#pragma once

#include <memory>

#include "drivers/camera/camera.hpp"
#include "drivers/camera/render.hpp"
#include "drivers/world/world.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

class PassingCamera final : public Camera {
 public:
  // X_BC: the camera above the floor; B has its origin on the floor, x forward and z up. `from`: of
  // exposures.
  PassingCamera(rt::NonRealtime&, std::unique_ptr<Camera> camera, const perception::Pose& X_BC,
                rt::Time from);
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return camera_->intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return camera_->rate_hz(); }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;

  // Draws the person into an image that was exposed then. Returns the number of their pixels.
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
