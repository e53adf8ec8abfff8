// An RGB-D camera that looks into a World: Kinect v2 geometry (512 x 424, f 365 px, 30 Hz).
//
// Frame f exposes from t0 + f/30 s (on a clock of its own: phase_ms later, clock_ppm longer apart)
// for the exposure time; it shows the world, from the pose, in the
// middle of it (no motion blur, no rolling) and is complete at its end. Frames nobody polled are
// lost, as with a real camera: their numbers are missing.
//
// Twin: its CPU time is counted apart (twin_cpu_ns) and is no part of any task's budget.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "config/schema.hpp"
#include "drivers/camera/camera.hpp"
#include "drivers/camera/pose_source.hpp"
#include "drivers/camera/render.hpp"
#include "drivers/camera/scripted_arm.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [camera.true_mount], an effect: the synthetic camera is not where mount_* says. Only the
// twin knows.
struct TrueMountConfig {
  bool differs = false;
  std::array<double, 3> position_m{-0.20, 0.0, 0.95};  // as SyntheticCameraConfig's mount_*
  double yaw_deg = 0, pitch_deg = 30, roll_deg = 0;
  void describe(config::Section& s);
};

// Section [camera] of a scene.
struct SyntheticCameraConfig {
  std::string resolution = "full";  // full: 512 x 424, f 365; half: 256 x 212, f 182.5
  double exposure_ms = 10;
  double phase_ms = 0, clock_ppm = 0;  // of a clock of its own; both 0: it counts from the box's
  double range_min_m = 0.4, range_max_m = 5.0;
  std::uint64_t seed = 1;                                    // of the noise
  std::array<double, 3> mount_position_m{-0.20, 0.0, 0.95};  // of the lens in B
  double mount_yaw_deg = 0;                                  // positive: to the left
  double mount_pitch_deg = 30;                               // positive: looks down
  double mount_roll_deg = 0;  // about its line of sight, positive: clockwise, seen from behind it
  TrueMountConfig true_mount;
  DepthNoiseConfig noise;
  // The lens of the real camera that it replaces, if any.
  std::optional<perception::Intrinsics> stands_in_for;
  void describe(config::Section& s);

  [[nodiscard]] bool own_clock() const noexcept { return phase_ms != 0 || clock_ppm != 0; }
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept;
  [[nodiscard]] perception::Pose X_BC() const noexcept;       // the mount as a pose, as stated
  [[nodiscard]] perception::Pose true_X_BC() const noexcept;  // of the synthetic camera
};

inline constexpr rt::Rate kCameraRate{30, 1};

class SyntheticCamera : public Camera {
 public:
  // `world` and `pose` must outlive the camera. Frame 0 begins its exposure phase_ms after t0.
  SyntheticCamera(rt::NonRealtime&, const SyntheticCameraConfig& config, const World& world,
                  PoseSource& pose, rt::Time t0);

  // Effect: the robot that carries the camera has an arm. Before the first frame.
  void carry(rt::NonRealtime&, std::unique_ptr<ScriptedArm> arm);
  [[nodiscard]] const ScriptedArm* arm() const noexcept { return arm_.get(); }

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return intrinsics_; }
  [[nodiscard]] double rate_hz() const noexcept override { return kCameraRate.hz(); }
  // Renders on demand, in the caller's thread: for the virtual clock and for tests.
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;

  // Instant at which the exposure of frame f begins, its middle, and the end, when f is complete.
  [[nodiscard]] rt::Time shutter_opens(std::uint64_t f) const noexcept;
  [[nodiscard]] rt::Time complete(std::uint64_t f) const noexcept;
  [[nodiscard]] rt::Time mid_exposure(std::uint64_t f) const noexcept;
  // Renders frame f whatever the time is.
  void expose(std::uint64_t f, perception::RgbdFrame& out) noexcept;

  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_; }
  [[nodiscard]] std::uint64_t rendered() const noexcept { return rendered_; }
  [[nodiscard]] const DepthNoise& noise() const noexcept { return noise_; }

 private:
  const World& world_;
  PoseSource& pose_;
  perception::Intrinsics intrinsics_;
  DepthRange range_;
  DepthNoise noise_;
  RenderScratch scratch_;
  std::unique_ptr<ScriptedArm> arm_;  // null: none
  perception::Pose X_CB_;
  bool mount_off_ = false;
  std::uint64_t seed_;
  rt::Time first_;  // when frame 0 begins its exposure
  double clock_ppm_;
  rt::Nanos exposure_;
  std::uint64_t next_ = 0;  // first frame not handed out and not passed over
  std::int64_t twin_cpu_ns_ = 0;
  std::uint64_t rendered_ = 0;
};

}  // namespace drivers
