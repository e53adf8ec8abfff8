// The robot's own body in the fusion task: masked from its joints before anything looks at the
// image (docs/body.md). Nothing of this exists for a robot without an arm.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "config/schema.hpp"
#include "perception/body/body_mask.hpp"
#include "perception/body/held_object.hpp"
#include "perception/geometry/articulated_body.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/ground_map.hpp"
#include "perception/icp/tracker.hpp"
#include "rt/memory/non_realtime.hpp"

namespace tasks {

// Section [fusion.body].
struct BodyConfig {
  double oldest_joints_ms = 100;  // stated age beyond which a frame is not fused
  double pad_px = 2;
  double pad_sigmas = 3;  // of a reading
  double pad_m = 0;       // what the description is wrong by
  void describe(config::Section& s);
};

class FusionBody {
 public:
  FusionBody(rt::NonRealtime&, const BodyConfig& config, const perception::RobotDescription& robot,
             const perception::TrackerConfig& noise, const perception::Pose& X_BC,
             const perception::Intrinsics& camera);

  // Finds the frame's pixels of the body. False: the joints can not say where it is (none, damaged,
  // too old).
  [[nodiscard]] bool see(const perception::RgbdFrame& frame,
                         const std::optional<perception::HeldObject>& held) noexcept;
  // Sets the pixels of the last see() to kBody; what was kBody before and is not now becomes
  // kPlace. Apart, for what moves is found in between, and the body is shown on top.
  void show(perception::ImageView<std::uint8_t> mask) const noexcept;
  // Of the last see(): the frame's, or a copy of it without the body.
  [[nodiscard]] const perception::ImageView<const std::uint16_t>& depth() const noexcept {
    return depth_;
  }
  [[nodiscard]] int pixels() const noexcept { return pixels_; }  // of the body, in the last see()
  [[nodiscard]] std::uint64_t work() const noexcept { return mask_.work(); }
  // Once a grasp: the box in C of what was taken up. Its readings are in the map from before.
  [[nodiscard]] std::optional<Eigen::AlignedBox3d> take_grasp_W(
      const perception::Pose& X_WC) noexcept;

 private:
  void add(const perception::Capsule& c_B, int link,
           const perception::JointAngles& joints) noexcept;

  BodyConfig config_;
  perception::ArticulatedBody body_;
  perception::BodyPadding padding_;
  perception::Pose X_CB_;
  perception::Intrinsics camera_;
  perception::BodyMask mask_;
  std::vector<std::uint16_t> copy_;
  std::vector<std::uint8_t> shown_;  // kBody and kPlace
  perception::ImageView<const std::uint16_t> depth_{};
  int pixels_ = 0;
  std::array<double, perception::JointAngles::kMost> q_{}, speed_{};
  perception::ArticulatedBody::Links X_BL_;
  std::array<perception::Capsule, perception::BodyMask::kMost> capsules_C_;  // padded
  std::size_t count_ = 0, held_from_ = 0;
  std::uint64_t held_id_ = 0;
  bool holds_ = false, grasped_ = false;
};

struct FusionSetup;
// What the setup says of the ground, and where of it the robot's own base stands.
[[nodiscard]] perception::GroundPrior ground_prior(const FusionSetup& setup);

}  // namespace tasks
