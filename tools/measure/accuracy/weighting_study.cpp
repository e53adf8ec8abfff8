#include "tools/measure/accuracy/weighting_study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "rt/quantile.hpp"
#include "tools/measure/accuracy/moving_film.hpp"
#include "tools/record/scenes.hpp"

namespace teletact {

namespace {

struct Weights {
  const char* setting;
  double noise_m, per_m2, from_m;
};

std::vector<Weights> weightings() {
  const perception::TrackerConfig product;
  return {{"uniform", product.noise_m, 0, 0},
          {"noise", 0.0015, 0.0019, 0.4},
          {"default", product.noise_m, product.noise_per_m2, product.noise_from_m},
          {"steep", 0.0015, 0.008, 1.2}};
}

// What one setting is run with, on one data set.
struct Case {
  Weights weights;
  bool watch;
  double voxel_mm;
};

std::vector<Case> cases(const WeightingOptions& o) {
  std::vector<Case> all;
  for (const double voxel_mm : o.voxels_mm) {
    for (const bool watch : {true, false}) {
      for (const Weights& w : weightings()) all.push_back({w, watch, voxel_mm});
    }
  }
  return all;
}

tasks::FusionConfig config_of(const Case& c) {
  tasks::FusionConfig config = fusion_with_voxel(1e-3 * c.voxel_mm);
  config.tracker.noise_m = c.weights.noise_m;
  config.tracker.noise_per_m2 = c.weights.per_m2;
  config.tracker.noise_from_m = c.weights.from_m;
  config.motion.on = c.watch;
  return config;
}

StudyRow row_of(const std::string& data, const Case& c) {
  char voxel[32], label[80];
  std::snprintf(voxel, sizeof voxel, "%gmm", c.voxel_mm);
  for (char& ch : voxel) ch = ch == '.' ? '_' : ch;
  if (c.weights.per_m2 > 0)
    std::snprintf(label, sizeof label, "%.2g+%.2g(z-%.2g)^2", 1e3 * c.weights.noise_m,
                  1e3 * c.weights.per_m2, c.weights.from_m);
  else
    std::snprintf(label, sizeof label, "uniform");
  StudyRow row;
  row.data = data + "_" + voxel;
  row.knob = "weights";
  row.setting = std::string(c.weights.setting) + (c.watch ? "_watch" : "_plain");
  row.label = std::string(label) + (c.watch ? ", watch" : ", plain");
  row.is_default = c.watch && std::string(c.weights.setting) == "default";
  return row;
}

void run_still(rt::NonRealtime& nrt, const std::string& data, const FusionSequence& sequence,
               const WeightingOptions& o, std::ostream& progress, Study& study) {
  for (const Case& c : cases(o)) {
    StudyRow row = row_of(data, c);
    progress << row.data << " " << row.label << std::endl;
    const FusionRun run = run_fusion(nrt, sequence, config_of(c));
    row.figures = {{"ate_mm", run.ate_mm, "mm"},
                   {"worst_mm", run.worst_mm, "mm"},
                   {"claimed", run.claimed, "1"},
                   {"cpu_ms", run.cpu_ms, "ms"}};
    study.rows.push_back(std::move(row));
  }
}

// Runs of one case over the samples of one half of the shares.
struct Tally {
  std::vector<double> ate_mm;
  double worst_mm = 0, claimed = 0, cpu_ms = 0;
  int samples = 0, wrong = 0;
  void add(const FusionRun& run, double allowed_mm) {
    ++samples;
    if (std::isfinite(run.ate_mm)) ate_mm.push_back(run.ate_mm);
    if (std::isfinite(run.worst_mm)) worst_mm = std::max(worst_mm, run.worst_mm);
    wrong += run.worst_mm > allowed_mm ? 1 : 0;
    claimed += run.claimed;
    cpu_ms += run.cpu_ms;
  }
  [[nodiscard]] std::vector<BenchMetric> figures() const {
    return {{"ate_mm", rt::quantile_or_nan(ate_mm, 0.5), "mm"},
            {"worst_mm", worst_mm, "mm"},
            {"claimed", claimed / samples, "1"},
            {"cpu_ms", cpu_ms / samples, "ms"},
            {"wrong", static_cast<double>(wrong), "1"},
            {"samples", static_cast<double>(samples), "1"}};
  }
};

void run_moving_samples(rt::NonRealtime& nrt, const WeightingOptions& o, std::ostream& progress,
                        Study& study) {
  const std::vector<Case> all = cases(o);
  constexpr std::array<const char*, 2> kData{"unseen_moving30", "unseen_moving60"};
  constexpr std::array<double, 2> kAllowed_mm{20, 50};
  std::array<std::vector<Tally>, 2> tallies{std::vector<Tally>(all.size()),
                                            std::vector<Tally>(all.size())};
  for (int i = 0; i < o.samples; ++i) {
    MovingSample sample = draw_moving_sample(nrt, o.seed, i);
    sample.half_images = true;
    progress << sample.text() << std::endl;
    const MovingFilm film = film_moving(nrt, sample, false);
    const std::size_t half = film.share_most <= 0.30 ? 0 : 1;
    for (std::size_t c = 0; c < all.size(); ++c) {
      tallies[half][c].add(run_fusion(nrt, film.with, config_of(all[c])), kAllowed_mm[half]);
    }
  }
  for (std::size_t half = 0; half < tallies.size(); ++half) {
    for (std::size_t c = 0; c < all.size(); ++c) {
      if (tallies[half][c].samples == 0) continue;
      StudyRow row = row_of(kData[half], all[c]);
      row.figures = tallies[half][c].figures();
      study.rows.push_back(std::move(row));
    }
  }
}

}  // namespace

FusionSequence backwards(const FusionSequence& sequence) {
  FusionSequence out;
  out.name = sequence.name + ", backwards";
  auto image = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, *image);
    const rt::Time exposure = image->exposure;
    const int from = sequence.size() - 1 - i;
    sequence.frame(from, *image);
    image->exposure = exposure;
    out.append(*image);
    const perception::Pose* truth = sequence.truth(from);
    out.truth_WC.push_back(truth != nullptr ? std::optional(*truth) : std::nullopt);
  }
  return out;
}

Study study_weighting(std::ostream& progress, const WeightingOptions& o) {
  rt::Startup startup;
  Study study;
  study.name = "accuracy.weighting";
  std::optional<FusionSequence> recording;
  if (!o.rgbd.empty()) {
    recording = recorded_sequence(progress, o.rgbd, {o.rgbd_frames, 2, o.pinhole});
    if (recording->known_truth().empty())
      throw std::runtime_error(o.rgbd + ": has no true pose at the stamp of a frame");
  }
  for (const std::string& name : o.scenes) {
    const FusionSequence images = synthetic_sequence(startup.token(), scene_named(name), o.frames);
    run_still(startup.token(), (name == "room" ? "chosen_" : "unseen_") + name, images, o, progress,
              study);
  }
  if (recording) {
    run_still(startup.token(), "chosen_recording", *recording, o, progress, study);
    run_still(startup.token(), "unseen_recording_backwards", backwards(*recording), o, progress,
              study);
  }
  run_moving_samples(startup.token(), o, progress, study);
  return study;
}

}  // namespace teletact
