#include "drivers/camera/synthetic_camera.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/effect_count.hpp"

#include <numbers>

namespace drivers {

using perception::Intrinsics;
using perception::Pose;
using perception::Vec3;

void TrueMountConfig::describe(config::Section& s) {
  s.flag("differs", differs,
         "effect: the synthetic camera is mounted as said here, not as mount_* says");
  s.numbers("position_m", position_m, -2, 2, "lens in the base's frame");
  s.number("yaw_deg", yaw_deg, -180, 180, "positive: looks to the left");
  s.number("pitch_deg", pitch_deg, -90, 90, "positive: looks down");
  s.number("roll_deg", roll_deg, -180, 180, "positive: clockwise, seen from behind the camera");
}

void SyntheticCameraConfig::describe(config::Section& s) {
  s.text("resolution", resolution, {"full", "half"}, "full 512 x 424, half 256 x 212");
  s.number("exposure_ms", exposure_ms, 0.1, 30, "time the shutter is open");
  s.number("phase_ms", phase_ms, 0, 33.3,
           "own clock: its first frame so long after the box's epoch");
  s.number("clock_ppm", clock_ppm, -1000, 1000, "own clock: slower than the box's by so much");
  s.number("range_min_m", range_min_m, 0.05, 5, "nearer things give no reading");
  s.number("range_max_m", range_max_m, 0.1, 60, "farther things give no reading");
  s.seed("seed", seed, "of the noise");
  s.numbers("mount_position_m", mount_position_m, -2, 2, "lens in the base's frame");
  s.number("mount_yaw_deg", mount_yaw_deg, -180, 180, "positive: looks to the left");
  s.number("mount_pitch_deg", mount_pitch_deg, -90, 90, "positive: looks down");
  s.number("mount_roll_deg", mount_roll_deg, -180, 180,
           "about the line of sight, positive: clockwise, seen from behind the camera");
  true_mount.describe(s.section("true_mount", "effect: where the synthetic camera truly is"));
  noise.describe(s.section("noise", "effects on the depth; none is on by itself"));
}

Intrinsics SyntheticCameraConfig::intrinsics() const noexcept {
  if (stands_in_for) return *stands_in_for;
  if (resolution == "half") return {182.5, 182.5, 127.5, 105.5, 256, 212};
  return {365.0, 365.0, 255.5, 211.5, 512, 424};
}

namespace {

Pose mount(const std::array<double, 3>& p, double yaw_deg, double pitch_deg, double roll_deg) {
  constexpr double kDeg = std::numbers::pi / 180.0;
  // Camera axes (right, down, forward) in a base that looks along its own x.
  perception::Mat3 R_forward;
  R_forward << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  Pose X = Pose::Identity();
  X.linear() = Eigen::AngleAxisd(yaw_deg * kDeg, Vec3::UnitZ()).toRotationMatrix() *
               Eigen::AngleAxisd(pitch_deg * kDeg, Vec3::UnitY()).toRotationMatrix();
  // A product with the identity would cost zeros their sign.
  if (roll_deg != 0)
    X.linear() = X.linear() * Eigen::AngleAxisd(roll_deg * kDeg, Vec3::UnitX()).toRotationMatrix();
  X.linear() = X.linear() * R_forward;
  X.translation() = Vec3(p[0], p[1], p[2]);
  return X;
}

}  // namespace

Pose SyntheticCameraConfig::X_BC() const noexcept {
  return mount(mount_position_m, mount_yaw_deg, mount_pitch_deg, mount_roll_deg);
}

Pose SyntheticCameraConfig::true_X_BC() const noexcept {
  if (!true_mount.differs) return X_BC();
  return mount(true_mount.position_m, true_mount.yaw_deg, true_mount.pitch_deg,
               true_mount.roll_deg);
}

SyntheticCamera::SyntheticCamera(rt::NonRealtime& nrt, const SyntheticCameraConfig& config,
                                 const World& world, PoseSource& pose, rt::Time t0)
    : world_(world),
      pose_(pose),
      intrinsics_(config.intrinsics()),
      range_{config.range_min_m, config.range_max_m},
      noise_(nrt, config.noise),
      scratch_(nrt, world.shapes().size()),
      X_CB_(config.true_X_BC().inverse()),
      seed_(config.seed),
      first_(t0 + rt::nanos_from_seconds(config.phase_ms * 1e-3)),
      clock_ppm_(config.clock_ppm),
      exposure_(rt::nanos_from_seconds(config.exposure_ms * 1e-3)) {
  mount_off_ = config.true_mount.differs;
  if (mount_off_) rt::effect_built(rt::Effect::kTrueMount);
}

void SyntheticCamera::carry(rt::NonRealtime&, std::unique_ptr<ScriptedArm> arm) {
  arm_ = std::move(arm);
  const std::size_t shapes = world_.shapes().size() + arm_->shapes();
  scratch_.seen.reserve(shapes);
  scratch_.in_tile.reserve(shapes);
}

rt::Time SyntheticCamera::shutter_opens(std::uint64_t f) const noexcept {
  const rt::Nanos own = kCameraRate.release(f);
  return first_ + own +
         rt::Nanos{static_cast<std::int64_t>(static_cast<double>(own.count()) * clock_ppm_ * 1e-6)};
}

rt::Time SyntheticCamera::complete(std::uint64_t f) const noexcept {
  return shutter_opens(f) + exposure_;
}

rt::Time SyntheticCamera::mid_exposure(std::uint64_t f) const noexcept {
  return shutter_opens(f) + exposure_ / 2;
}

void SyntheticCamera::expose(std::uint64_t f, perception::RgbdFrame& out) noexcept {
  const std::int64_t begin = rt::thread_cpu_ns();
  const rt::Time middle = mid_exposure(f);
  if (mount_off_) rt::effect_ran(rt::Effect::kTrueMount);
  const Pose X_WC = pose_.X_WC_at(middle);
  std::span<const Shape> carried;
  out.joints = {};
  if (arm_ != nullptr) {
    carried = arm_->place(middle, X_WC * X_CB_);
    out.joints = arm_->reported(middle);
  }
  render(world_, intrinsics_, X_WC, range_, noise_, seed_, f, scratch_, out, middle, carried);
  out.exposure = middle;
  twin_cpu_ns_ += rt::thread_cpu_ns() - begin;
  ++rendered_;
}

CameraStatus SyntheticCamera::poll(rt::Time now, perception::RgbdFrame& out) noexcept {
  if (now < complete(next_)) return CameraStatus::kNoFrame;
  // Newest complete frame: the estimate by division is corrected by the exact formula.
  const auto own = static_cast<std::int64_t>(
      static_cast<double>((now - first_ - exposure_).count()) / (1 + clock_ppm_ * 1e-6));
  auto f = static_cast<std::uint64_t>(own * kCameraRate.num / (1000000000 * kCameraRate.den));
  while (complete(f + 1) <= now) ++f;
  while (f > next_ && complete(f) > now) --f;
  expose(f, out);
  next_ = f + 1;
  return CameraStatus::kFrame;
}

}  // namespace drivers
