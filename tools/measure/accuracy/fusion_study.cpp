#include "tools/measure/accuracy/fusion_study.hpp"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <stdexcept>

#include "rt/quantile.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/scenes.hpp"

namespace teletact {

using perception::Pose;
using perception::RgbdFrame;

namespace {

constexpr int kAllocateStep = 2;  // of level 0

// 13.3 as 13_3.
std::string as_word(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", v);
  std::string word = text;
  std::replace(word.begin(), word.end(), '.', '_');
  return word;
}

struct Knobs {
  double voxel_mm = 10;
  int pixel_step = 1;
  std::array<int, 3> iterations{4, 5, 15};
  friend bool operator==(const Knobs&, const Knobs&) = default;
};

Knobs defaults() {
  const tasks::FusionConfig c;
  return {1e3 * c.tsdf.voxel_size_m, c.levels[0].pixel_step, c.levels[0].iterations};
}

tasks::FusionConfig config_of(const Knobs& k) {
  tasks::FusionConfig config = fusion_with_voxel(1e-3 * k.voxel_mm);
  config.levels[0].pixel_step = k.pixel_step;
  config.levels[0].iterations = config.tracker.iterations = k.iterations;
  return config;
}

std::string iterations_text(const std::array<int, 3>& n, char between) {
  return std::to_string(n[0]) + between + std::to_string(n[1]) + between + std::to_string(n[2]);
}

StudyRow row_of(const std::string& data, const Knobs& k) {
  const Knobs d = defaults();
  StudyRow row;
  row.data = data;
  row.is_default = k == d;
  const std::string voxel = as_word(k.voxel_mm) + "mm";
  char label[32];
  std::snprintf(label, sizeof label, "%g mm", k.voxel_mm);
  row.knob = "voxel";
  row.setting = "voxel_" + voxel;
  row.label = label;
  if (k.iterations != d.iterations) {
    row.knob = "ICP iterations";
    row.setting = "icp_" + iterations_text(k.iterations, '_');
    row.label = "ICP " + iterations_text(k.iterations, '/');
  } else if (k.pixel_step != d.pixel_step) {
    row.knob = "pixel step";
    row.setting = "step_" + std::to_string(k.pixel_step) +
                  (k.voxel_mm != d.voxel_mm ? "_" + voxel : std::string());
    row.label = (k.voxel_mm != d.voxel_mm ? std::string(label) + ", " : std::string()) + "step " +
                std::to_string(k.pixel_step);
  }
  return row;
}

// The voxel's size; of `every` knob one after the other, the pixel step at twice the voxel too,
// where it buys most.
std::vector<Knobs> settings(const FusionStudyOptions& o, bool every) {
  std::vector<Knobs> all;
  const auto add = [&](const Knobs& k) {
    if (std::find(all.begin(), all.end(), k) == all.end()) all.push_back(k);
  };
  const Knobs d = defaults();
  const auto has = [&](double mm) {
    return std::find(o.voxels_mm.begin(), o.voxels_mm.end(), mm) != o.voxels_mm.end();
  };
  for (const double mm : o.voxels_mm) add({mm, d.pixel_step, d.iterations});
  if (!every) return all;
  for (const double mm : {d.voxel_mm, 2 * d.voxel_mm}) {
    if (!has(mm)) continue;
    for (const int step : o.pixel_steps) add({mm, step, d.iterations});
  }
  if (has(d.voxel_mm)) {
    for (const auto& n : o.iterations) add({d.voxel_mm, d.pixel_step, n});
  }
  return all;
}

void add_surface(const SurfaceError& e, const std::string& head, StudyRow& row) {
  row.figures.push_back({head + "median_mm", e.median_mm, "mm"});
  row.figures.push_back({head + "p95_mm", e.p95_mm, "mm"});
  row.figures.push_back({head + "rmse_mm", e.rmse_mm, "mm"});
  row.figures.push_back({head + "complete", e.completeness, "1"});
}

void add_run(const FusionRun& run, StudyRow& row) {
  row.figures.push_back({"cpu_ms", run.cpu_ms, "ms"});
  row.figures.push_back({"ate_mm", run.ate_mm, "mm"});
  row.figures.push_back({"worst_mm", run.worst_mm, "mm"});
  row.figures.push_back({"claimed", run.claimed, "1"});
}

perception::Mesh moved(perception::Mesh mesh, const Pose& X_WM) {
  for (auto& v : mesh.vertices_W) v = (X_WM * v.cast<double>()).cast<float>();
  for (auto& n : mesh.normals_W) n = (X_WM.linear() * n.cast<double>()).cast<float>();
  return mesh;
}

void study_scene(rt::NonRealtime& nrt, const std::string& name, bool every_knob,
                 const FusionStudyOptions& o, std::ostream& progress, Study& study) {
  SyntheticRoom room = scene_named(name);
  room.noise.incidence = o.incidence;
  const drivers::World world(nrt, room.world);
  progress << "rendering " << name << "\n";
  const FusionSequence sequence = synthetic_sequence(nrt, room, o.frames);
  const auto seen = seen_surface(world, sequence.intrinsics, sequence.known_truth());
  for (const Knobs& k : settings(o, every_knob)) {
    StudyRow row = row_of(name, k);
    progress << name << " " << row.label << "\n";
    const FusionRun run = run_fusion(nrt, sequence, config_of(k));
    add_run(run, row);
    add_surface(surface_error(run.mesh, world, seen), "surface_", row);
    if (row.knob == "voxel") {
      add_surface(surface_error(fuse_at_truth(nrt, sequence, config_of(k).tsdf), world, seen),
                  "true_", row);
    }
    study.rows.push_back(std::move(row));
  }
  study.plots.push_back({"accuracy_fusion_" + name, "fusion, synthetic " + name + ": trajectory",
                         name, "ate_mm", "trajectory error, mm (RMS)", "cpu_ms",
                         "CPU a frame, ms"});
  study.plots.push_back({"accuracy_surface_" + name, "fusion, synthetic " + name + ": surface",
                         name, "surface_rmse_mm", "vertices to the true surface, mm (RMS)",
                         "cpu_ms", "CPU a frame, ms"});
}

FusionSequence read_recording(const FusionStudyOptions& o, std::ostream& progress) {
  progress << "reading " << o.rgbd << "\n";
  FusionSequence sequence = recorded_sequence(progress, o.rgbd, {o.rgbd_frames, 2, o.pinhole});
  if (sequence.known_truth().empty()) {
    throw std::runtime_error(o.rgbd + ": has no true pose at the stamp of a frame");
  }
  return sequence;
}

void study_recording(rt::NonRealtime& nrt, const FusionSequence& sequence,
                     const FusionStudyOptions& o, std::ostream& progress, Study& study) {
  for (const Knobs& k : settings(o, true)) {
    StudyRow row = row_of("recording", k);
    progress << "recording " << row.label << "\n";
    add_run(run_fusion(nrt, sequence, config_of(k)), row);
    study.rows.push_back(std::move(row));
  }
  study.plots.push_back({"accuracy_fusion_recording", "fusion, recording: trajectory", "recording",
                         "ate_mm", "trajectory error against the given poses, mm (RMS)", "cpu_ms",
                         "CPU a frame, ms"});
}

}  // namespace

tasks::FusionConfig fusion_with_voxel(double voxel_m) {
  tasks::FusionConfig config;
  config.tsdf.voxel_size_m = voxel_m;
  // The surface of the same place takes more blocks as voxels get finer.
  const double finer = std::max(1.0, 0.01 / voxel_m);
  config.tsdf.max_blocks = static_cast<int>(config.tsdf.max_blocks * finer * finer);
  config.view_period_frames = 0;
  return config;
}

FusionRun run_fusion(rt::NonRealtime& nrt, const FusionSequence& sequence,
                     const tasks::FusionConfig& config, const FusionAtEnd& at_end) {
  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics;
  const Pose* first = sequence.truth(0);
  const Pose X_WM = first != nullptr ? *first : Pose::Identity();
  tasks::FusionTask task(nrt, config, setup);
  FusionFeed feed(task);
  FusionRun run;
  ClaimedError error;
  std::vector<double> cpu;
  int claimed = 0;
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, feed.frame());
    const auto& out = feed.step();
    if (i >= std::min(10, sequence.size() / 2)) cpu.push_back(feed.cpu_ms());
    run.blocks_refused += out.integration.blocks_refused;
    if (!out.camera_written || !out.camera.claimed) continue;
    ++claimed;
    if (const Pose* truth = sequence.truth(i)) error.add(out.camera.X_WC, *truth);
  }
  run.ate_mm = error.ate_mm();
  run.worst_mm = error.worst_mm();
  run.claimed = static_cast<double>(claimed) / std::max(1, sequence.size());
  run.cpu_ms = rt::quantile_or_nan(cpu, 0.5);
  run.mesh = moved(perception::extract_mesh(nrt, task.map()), X_WM);
  if (at_end) at_end(feed, X_WM);
  return run;
}

perception::Mesh fuse_at_truth(rt::NonRealtime& nrt, const FusionSequence& sequence,
                               const perception::TsdfConfig& config) {
  perception::TsdfMap map(nrt, config);
  auto frame = std::make_unique<RgbdFrame>();
  const Pose& X_WM = *sequence.truth(0);
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, *frame);
    map.integrate(perception::FrameView::of(*frame),
                  X_WM.inverse(Eigen::Isometry) * *sequence.truth(i), kAllocateStep);
  }
  return moved(perception::extract_mesh(nrt, map), X_WM);
}

std::vector<BenchMetric> counted_figures(const StudyRow& row) {
  std::vector<BenchMetric> counted;
  const bool enough = row.figure("claimed") >= 0.98;
  for (const BenchMetric& m : row.figures)
    if (m.value == m.value && (enough || m.name != "ate_mm")) counted.push_back(m);
  return counted;
}

Study study_fusion(std::ostream& progress, const FusionStudyOptions& options) {
  rt::Startup startup;
  Study study;
  study.name = "accuracy.fusion";
  // What is wrong with it is said before the scenes, which take minutes.
  std::optional<FusionSequence> recording;
  if (!options.rgbd.empty()) recording = read_recording(options, progress);
  bool first = true;
  for (const std::string& scene : options.scenes) {
    study_scene(startup.token(), scene, first, options, progress, study);
    first = false;
  }
  if (recording) study_recording(startup.token(), *recording, options, progress, study);
  return study;
}

}  // namespace teletact
