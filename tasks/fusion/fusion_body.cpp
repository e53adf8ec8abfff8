#include "tasks/fusion/fusion_body.hpp"

#include <algorithm>
#include <cstring>

#include "perception/motion/motion_mask.hpp"
#include "tasks/fusion/fusion_config.hpp"

namespace tasks {

using perception::Capsule;
using perception::JointAngles;
using perception::RgbdFrame;

void BodyConfig::describe(config::Section& s) {
  s.number("oldest_joints_ms", oldest_joints_ms, 0, 1000,
           "joint angles that may be older than that: the frame is not fused")
      .number("pad_px", pad_px, 0, 20, "added to the body's outline")
      .number("pad_sigmas", pad_sigmas, 0, 10, "standard deviations of a reading, added too")
      .number("pad_m", pad_m, 0, 0.2, "what the description of the robot may be wrong by");
}

FusionBody::FusionBody(rt::NonRealtime& nrt, const BodyConfig& config,
                       const perception::RobotDescription& robot,
                       const perception::TrackerConfig& noise, const Pose& X_BC,
                       const perception::Intrinsics& camera)
    : config_(config),
      body_(robot),
      padding_{config.pad_px, config.pad_sigmas,  config.pad_m,
               noise.noise_m, noise.noise_per_m2, noise.noise_from_m},
      X_CB_(X_BC.inverse()),
      camera_(camera),
      mask_(nrt, camera.width, camera.height),
      copy_(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height)),
      shown_(copy_.size(), static_cast<std::uint8_t>(perception::PixelOf::kPlace)) {}

void FusionBody::add(const Capsule& c_B, int link, const JointAngles& joints) noexcept {
  if (count_ == capsules_C_.size()) return;
  const double off =
      body_.reach_of_error(c_B, link, X_BL_, speed_, static_cast<double>(joints.error),
                           static_cast<double>(joints.age_s));
  Capsule c{X_CB_ * c_B.a, X_CB_ * c_B.b, c_B.radius};
  c.radius += perception::pad_of(c, off, padding_, camera_);
  capsules_C_[count_++] = c;
}

bool FusionBody::see(const RgbdFrame& frame,
                     const std::optional<perception::HeldObject>& held) noexcept {
  const JointAngles& joints = frame.joints;
  depth_ = frame.depth();
  pixels_ = 0;
  if (!joints.plausible() || joints.count < static_cast<int>(body_.joints().size()) ||
      static_cast<double>(joints.age_s) * 1e3 > config_.oldest_joints_ms)
    return false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(joints.count); ++i) {
    q_[i] = static_cast<double>(joints.position[i]);
    speed_[i] = static_cast<double>(joints.speed[i]);
  }
  body_.forward(q_, X_BL_);
  count_ = 0;
  for (int i = 0; i < body_.capsules(); ++i)
    add(body_.capsule_B(i, X_BL_), body_.link_of(i), joints);
  held_from_ = count_;
  const bool holds = held && held->plausible() && body_.gripper() >= 0;
  if (holds) {
    std::array<Capsule, perception::kCapsulesOfHeld> pieces;
    const int n = capsules_of(*held, pieces);
    const Pose& X_BG = X_BL_[static_cast<std::size_t>(body_.gripper())];
    for (int i = 0; i < n; ++i) {
      const Capsule& c = pieces[static_cast<std::size_t>(i)];
      add({X_BG * c.a, X_BG * c.b, c.radius}, body_.gripper(), joints);
    }
    grasped_ = grasped_ || !holds_ || held_id_ != held->id;
    held_id_ = held->id;
  }
  grasped_ = grasped_ && holds;
  holds_ = holds;

  std::memcpy(copy_.data(), frame.depth_mm.data(), copy_.size() * sizeof copy_[0]);
  pixels_ = mask_.mark({capsules_C_.data(), count_}, camera_,
                       {copy_.data(), camera_.width, camera_.height, camera_.width},
                       {shown_.data(), camera_.width, camera_.height, camera_.width});
  if (pixels_ > 0) depth_ = {copy_.data(), camera_.width, camera_.height, camera_.width};
  return true;
}

void FusionBody::show(perception::ImageView<std::uint8_t> mask) const noexcept {
  constexpr auto kBody = static_cast<std::uint8_t>(perception::PixelOf::kBody);
  constexpr auto kPlace = static_cast<std::uint8_t>(perception::PixelOf::kPlace);
  for (int v = 0; v < camera_.height; ++v) {
    const std::uint8_t* own = shown_.data() + static_cast<std::ptrdiff_t>(v) * camera_.width;
    std::uint8_t* row = mask.row(v);
    for (int u = 0; u < camera_.width; ++u) {
      const std::uint8_t rest = row[u] == kBody ? kPlace : row[u];
      row[u] = own[u] == kBody ? kBody : rest;
    }
  }
}

std::optional<Eigen::AlignedBox3d> FusionBody::take_grasp_W(const Pose& X_WC) noexcept {
  if (!grasped_) return std::nullopt;
  grasped_ = false;
  Eigen::AlignedBox3d box;
  for (std::size_t i = held_from_; i < count_; ++i) {
    const Capsule& c = capsules_C_[i];
    for (const Vec3& end : {c.a, c.b}) {
      const Vec3 p = X_WC * end;
      box.extend(Vec3(p.array() - c.radius)).extend(Vec3(p.array() + c.radius));
    }
  }
  return box;
}

perception::GroundPrior ground_prior(const FusionSetup& setup) {
  perception::GroundPrior prior = setup.ground;
  prior.X_BC = setup.X_BC;
  if (setup.robot == nullptr) return prior;
  for (const perception::BaseBoxConfig& box : setup.robot->base_boxes) {
    const Eigen::Vector2d centre(box.centre_m[0], box.centre_m[1]),
        half(box.size_m[0] / 2, box.size_m[1] / 2);
    prior.body_B.emplace_back(centre - half, centre + half);
  }
  return prior;
}

}  // namespace tasks
