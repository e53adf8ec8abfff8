// A room as a Kinect v2 sees it, a box in it that moves, and the fusion task that looks at it:
// windows for a hand on the box as the product makes them, from tracking and motion mask to
// smoothing.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "drivers/camera/render.hpp"
#include "drivers/world/world.hpp"
#include "perception/patch/surface_patch.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace fused_hand {

using perception::Pose;
using perception::SurfacePatch;
using perception::Vec3;

// Middle of the box's face, which looks along -x: at the camera, 1.1 m off it.
inline const Vec3 kFace_W(1.7, 0.05, 0.85);
inline constexpr double kEdge_m = 0.5;

struct Setting {
  double voxel_m = 0.02;
  bool carried = false;        // the camera goes by hand; else it stands
  Vec3 step_m = Vec3::Zero();  // of the box, a frame
  int first = 60;              // frame that shows it displaced first
  double way_m = 0.5;          // after which it stands
  double passer_m = 0;         // a forearm passes so far before the face; 0: nobody
  std::uint64_t seed = 1;
};

class Place {
 public:
  static constexpr double kFrame_s = 1.0 / 30;

  explicit Place(const Setting& s)
      : setting_(s),
        room_(room_of(s)),
        world_(startup_.token(), room_.world, kBegin),
        noise_(startup_.token(), room_.noise),
        scratch_(startup_.token(), world_.shapes().size()),
        box_(world_.find("box")) {
    tasks::FusionConfig config;
    config.tsdf.voxel_size_m = s.voxel_m;
    config.view_period_frames = 0;
    tasks::FusionSetup setup;
    setup.camera = room_.camera;
    setup.X_WC0 = camera(0);
    task_ = std::make_unique<tasks::FusionTask>(startup_.token(), config, setup);
    feed_ = std::make_unique<teletact::FusionFeed>(*task_);
  }

  [[nodiscard]] int frames() const { return frames_; }
  [[nodiscard]] int claimed() const { return claimed_; }
  [[nodiscard]] double worst_pose_m() const { return worst_pose_m_; }
  [[nodiscard]] static double time_of(int frame) { return frame * kFrame_s; }
  // How far the box is from where it began, at an image.
  [[nodiscard]] Vec3 moved(int frame) const {
    const auto& box = world_.shapes()[static_cast<std::size_t>(box_)];
    return world_.X_WS_at(box_, exposure(frame)).translation() - box.X_WS.translation();
  }

  // The next image, a hand being where it is; its window goes to `out`.
  void see(const tasks::HapticState& hand, SurfacePatch& out) {
    const int i = frames_++;
    const Pose X_WC = camera(i);
    drivers::render(world_, room_.camera, X_WC, {room_.range_min_m, room_.range_max_m}, noise_,
                    setting_.seed, static_cast<std::uint64_t>(i), scratch_, feed_->frame(),
                    exposure(i));
    feed_->frame().exposure = exposure(i);
    feed_->in.hand = hand;
    const auto& o = feed_->step(&out);
    if (!o.camera_written || !o.camera.claimed) return;
    ++claimed_;
    worst_pose_m_ =
        std::max(worst_pose_m_, (o.camera.X_WC.translation() - X_WC.translation()).norm());
  }

 private:
  static constexpr rt::Time kBegin = rt::Time{} + rt::Nanos{1'000'000'000};
  [[nodiscard]] static rt::Time exposure(int frame) {
    return kBegin + rt::nanos_from_seconds(time_of(frame));
  }
  [[nodiscard]] Pose camera(int frame) const {
    const double t = setting_.carried ? time_of(frame) : 0;
    const Vec3 eye(0.62 + 0.05 * std::sin(1.9 * t), -0.15 + 0.08 * std::sin(1.3 * t),
                   1.15 + 0.04 * std::sin(2.3 * t));
    return teletact::looking(eye, 0.17 + 0.04 * std::sin(1.1 * t), 0.3 + 0.03 * std::sin(1.7 * t));
  }
  static teletact::SyntheticRoom room_of(const Setting& s) {
    teletact::SyntheticRoom room = teletact::furnished_room();
    auto& b = room.world.boxes.emplace_back();
    b.name = "box";
    b.size_m = {kEdge_m, kEdge_m, kEdge_m};
    b.position_m = {kFace_W.x() + kEdge_m / 2, kFace_W.y(), kFace_W.z()};
    const double step = s.step_m.norm();
    if (step > 0) {
      auto& m = room.world.movers.emplace_back();
      m.name = "goes", m.shapes = "box", m.kind = "line";
      m.start_s = time_of(s.first - 1);
      m.duration_s = std::round(s.way_m / step) * kFrame_s;
      for (std::size_t a = 0; a < 3; ++a)
        m.velocity_m_per_s[a] = s.step_m[static_cast<Eigen::Index>(a)] / kFrame_s;
    }
    if (s.passer_m > 0) {
      auto& c = room.world.cylinders.emplace_back();
      c.name = "passer", c.radius_m = 0.06, c.height_m = 2;
      c.position_m = {kFace_W.x() - s.passer_m, -0.4, 0};
      auto& m = room.world.movers.emplace_back();
      m.name = "passes", m.shapes = "passer", m.kind = "line";
      m.start_s = time_of(s.first - 1), m.velocity_m_per_s = {0, 1.2, 0};
    }
    return room;
  }

  Setting setting_;
  rt::Startup startup_;
  teletact::SyntheticRoom room_;
  drivers::World world_;
  drivers::DepthNoise noise_;
  drivers::RenderScratch scratch_;
  int box_;
  std::unique_ptr<tasks::FusionTask> task_;
  std::unique_ptr<teletact::FusionFeed> feed_;
  int frames_ = 0, claimed_ = 0;
  double worst_pose_m_ = 0;
};

// S at the middle of the face, its z out of it, towards the camera.
inline Pose face_frame() {
  Pose X = Pose::Identity();
  X.linear().col(0) = Vec3::UnitZ();
  X.linear().col(1) = -Vec3::UnitY();
  X.linear().col(2) = -Vec3::UnitX();
  X.linear().col(1) = X.linear().col(2).cross(X.linear().col(0));
  X.translation() = kFace_W;
  return X;
}

}  // namespace fused_hand
