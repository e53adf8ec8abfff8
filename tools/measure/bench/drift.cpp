#include "tools/measure/bench/drift.hpp"

#include <algorithm>
#include <cstdio>

#include "drivers/camera/render.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

using perception::Pose;

namespace {

double mean(const std::vector<double>& v, std::size_t from, std::size_t to) {
  double sum = 0;
  for (std::size_t i = from; i < to; ++i) sum += v[i];
  return to > from ? sum / static_cast<double>(to - from) : 0;
}

// Every step-th pixel of a Kinect v2 that sees as much.
perception::Intrinsics camera_of(int step) {
  return {365.0 / step,       365.0 / step, 256.0 / step - 0.5,
          212.0 / step - 0.5, 512 / step,   424 / step};
}

}  // namespace

DriftResult bench_drift(std::ostream& progress, int frames, double voxel_m, int step) {
  rt::Startup startup;
  const SyntheticRoom room = furnished_room();
  const drivers::World world(startup.token(), room.world);
  const drivers::DepthNoise noise(startup.token(), room.noise);
  drivers::RenderScratch scratch(startup.token(), world.shapes().size());
  const Pose X_WC = carried_pose(0.4);
  tasks::FusionConfig config;
  config.tsdf.voxel_size_m = voxel_m;
  config.view_period_frames = 0;
  tasks::FusionSetup setup;
  setup.camera = camera_of(step);
  setup.X_WC0 = X_WC;
  tasks::FusionTask task(startup.token(), config, setup);
  FusionFeed feed(task);
  DriftResult r;
  r.frames = frames;
  r.voxel_mm = 1e3 * voxel_m;
  std::vector<double> off;
  for (int i = 0; i < frames; ++i) {
    drivers::render(world, setup.camera, X_WC, {room.range_min_m, room.range_max_m}, noise, 1,
                    static_cast<std::uint64_t>(i), scratch, feed.frame());
    feed.frame().exposure = rt::Time{} + rt::Nanos{1'000'000'000LL + i * 33'333'333LL};
    const auto& out = feed.step();
    r.cpu_ms += feed.cpu_ms() / frames;
    const perception::Mat3 R = out.camera.X_WC.linear();
    r.orthonormal = std::max(
        r.orthonormal, (R.transpose() * R - perception::Mat3::Identity()).cwiseAbs().maxCoeff());
    if (i % 1000 == 999) progress << i + 1 << " frames\n";
    if (!out.camera_written || !out.camera.claimed) continue;
    ++r.claimed;
    off.push_back(1e3 * (out.camera.X_WC.translation() - X_WC.translation()).norm());
    r.worst_mm = std::max(r.worst_mm, off.back());
    const perception::Mat3 turn = R.transpose() * X_WC.linear();
    r.worst_deg = std::max(r.worst_deg, 57.29577951308232 * perception::rotation_angle(turn));
  }
  const std::size_t n = off.size();
  r.first_mm = mean(off, std::min<std::size_t>(10, n), std::max<std::size_t>(n / 10, 1));
  r.last_mm = mean(off, n - n / 10, n);
  return r;
}

std::vector<Limit> DriftResult::limits() const {
  constexpr int kTenths = 200;  // below it a tenth is too few frames for a mean, or none
  Limits all;
  all.add("claimed frames", static_cast<double>(claimed), ">=", static_cast<double>(frames));
  all.add("worst, mm", worst_mm, "<=", 2);
  all.add("off orthonormal", orthonormal, "<=", 1e-9);
  all.add("last tenth beyond the first, mm", last_mm - first_mm, "<=", 0.3,
          frames >= kTenths ? "" : "fewer than 200 frames");
  return all.all();
}

std::vector<BenchMetric> DriftResult::metrics() const {
  return {{"drift.frames", static_cast<double>(frames), "1"},
          {"drift.claimed", static_cast<double>(claimed), "1"},
          {"drift.worst_mm", worst_mm, "mm"},
          {"drift.worst_deg", worst_deg, "deg"},
          {"drift.first_mm", first_mm, "mm"},
          {"drift.last_mm", last_mm, "mm"},
          {"drift.orthonormal", orthonormal, "1"},
          {"drift.cpu_ms", cpu_ms, "ms"}};
}

void DriftResult::print(std::ostream& out) const {
  char line[256];
  std::snprintf(
      line, sizeof line,
      "a still camera in a still room, %d frames, voxels of %.0f mm\n"
      "claimed %d; off by %.3f mm in the first tenth, %.3f mm in the last, at most %.3f mm "
      "and %.4f deg\nrotation off orthonormal by at most %.1e; %.1f ms CPU a frame\n",
      frames, voxel_mm, claimed, first_mm, last_mm, worst_mm, worst_deg, orthonormal, cpu_ms);
  out << line;
  teletact::print(out, limits());
}

}  // namespace teletact
