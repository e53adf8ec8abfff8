// A synthetic place, and the fusion task that is shown it image by image.
#pragma once

#include <algorithm>
#include <memory>

#include "drivers/camera/render.hpp"
#include "drivers/world/world.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace fusion_places {

using perception::Pose;
using perception::Vec3;

struct Told {
  int frames = 0, claimed = 0;
  double worst_m = 0;  // of the claimed frames
  [[nodiscard]] double share() const { return static_cast<double>(claimed) / frames; }
};

class Film {
 public:
  Film(const teletact::SyntheticRoom& room, double voxel_m, std::uint64_t seed)
      : room_(room),
        world_(startup_.token(), room_.world, kBegin),
        noise_(startup_.token(), room_.noise),
        scratch_(startup_.token(), world_.shapes().size()),
        seed_(seed) {
    tasks::FusionConfig config;
    config.tsdf.voxel_size_m = voxel_m;
    config.view_period_frames = 0;
    tasks::FusionSetup setup;
    setup.camera = room_.camera;
    setup.X_WC0 = room_.path(0);
    task_ = std::make_unique<tasks::FusionTask>(startup_.token(), config, setup);
    feed_ = std::make_unique<teletact::FusionFeed>(*task_);
  }

  // The next image.
  const tasks::FusionOut& see() {
    const double t = told_.frames / 30.0;
    const rt::Time exposure = kBegin + rt::nanos_from_seconds(t);
    const Pose X_WC = room_.path(t);
    drivers::render(world_, room_.camera, X_WC, {room_.range_min_m, room_.range_max_m}, noise_,
                    seed_, static_cast<std::uint64_t>(told_.frames), scratch_, feed_->frame(),
                    exposure);
    feed_->frame().exposure = exposure;
    const auto& out = feed_->step();
    ++told_.frames;
    off_m_ = (task_->camera().translation() - X_WC.translation()).norm();
    if (out.camera_written && out.camera.claimed) {
      ++told_.claimed;
      told_.worst_m = std::max(told_.worst_m, off_m_);
    }
    return out;
  }
  [[nodiscard]] const Told& told() const { return told_; }
  [[nodiscard]] double off_m() const { return off_m_; }  // of the last image
  [[nodiscard]] const tasks::FusionTask& task() const { return *task_; }
  [[nodiscard]] const perception::RgbdFrame& frame() const { return feed_->frame(); }  // the newest
  [[nodiscard]] Pose truth() const { return room_.path((told_.frames - 1) / 30.0); }   // of it
  [[nodiscard]] rt::Startup& startup() { return startup_; }

 private:
  static constexpr rt::Time kBegin = rt::Time{} + rt::Nanos{1'000'000'000};
  rt::Startup startup_;
  teletact::SyntheticRoom room_;
  drivers::World world_;
  drivers::DepthNoise noise_;
  drivers::RenderScratch scratch_;
  std::uint64_t seed_;
  std::unique_ptr<tasks::FusionTask> task_;
  std::unique_ptr<teletact::FusionFeed> feed_;
  Told told_;
  double off_m_ = 0;
};

}  // namespace fusion_places
