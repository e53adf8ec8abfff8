// teletact accuracy moving: seeded samples of a place in which one thing moves, each run without
// odometry, with it, and with odometry that lies; claims, error, mask and map against the truth,
// with the limits that they have to keep. docs/moving_judge.md says what is drawn and what each
// figure means.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/accuracy/moving_run.hpp"

namespace teletact {

struct MovingOptions {
  int samples = 300;
  std::uint64_t seed = 1;
  std::vector<double> voxels_mm{20, 10};
  std::vector<int> levels{0, 1, 2};
  bool spread = false;  // each sample at one of the settings, in turn by twelve, not at all of them
  int only = -1;        // sample to run alone
  int jobs = 1;         // samples at a time
  bool colour = false, debug = false, surfaces = true;
  double incidence = 0;  // camera.noise.incidence
  bool watch = true;     // false: fusion.motion.on is
  bool odometry = true;  // and the runs with it, true and lying
  bool peers = false;    // others on the same frames (moving_peer.hpp), said on the progress
};

struct MovingRow {
  MovingSample sample;
  double share = 0;  // of the images, largest of the run
  double share_last = 0;
  MovingSetting setting;
  MovingVariant variant = MovingVariant::kAlone;
  MovingRun run, plain;
  [[nodiscard]] double above_plain_mm() const { return run.ate_mm - plain.ate_mm; }
  [[nodiscard]] bool low() const { return share <= 0.30; }
  // Nothing tells the mover from the place: that it claims nothing is right.
  [[nodiscard]] bool hopeless() const { return !sample.from_rest && share >= 0.40; }
};

// A limit on a figure of some of the runs, with its worst value and median. A figure that is NaN is
// not judged: a run without claims has no error, and fails by its claimed share alone.
struct MovingCheck {
  std::string name;  // of the metric, below moving.
  std::string what;  // the requirement in words
  bool (*applies)(const MovingRow& row);
  double (*figure)(const MovingRow& row);
  double limit;
  bool at_least;  // else at most
};
[[nodiscard]] const std::vector<MovingCheck>& moving_checks();
// Names of the checks that the row fails; its figures and these in a line.
[[nodiscard]] std::vector<std::string> failed_checks(const MovingRow& row);
[[nodiscard]] std::string line_of(const MovingRow& row);

struct MovingStudy {
  std::vector<MovingRow> rows;
  [[nodiscard]] int missed() const;  // checks that some run fails
  void print(std::ostream& out) const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  // Share against error, and speed against error; returns the files.
  std::vector<std::string> write_plots(const std::string& folder) const;
};

// Of voxels and levels, those that a sample is run at.
[[nodiscard]] std::vector<MovingSetting> settings_of(const MovingSample& sample,
                                                     const MovingOptions& options);
// The rows of one sample at its settings.
[[nodiscard]] std::vector<MovingRow> run_sample(rt::NonRealtime& nrt, const MovingSample& sample,
                                                const MovingOptions& options, std::ostream* said);
[[nodiscard]] MovingStudy study_moving(std::ostream& progress, const MovingOptions& options);

// Still pixels masked in the five scenes of teletact accuracy fusion, where nothing moves. At most
// .002.
struct StaticMask {
  std::string scene;
  double masked = 0, claimed = 0, ate_mm = 0;
};
[[nodiscard]] std::vector<StaticMask> study_static_masks(std::ostream& progress, double voxel_mm,
                                                         int frames);
inline constexpr double kMostStaticMasked = 0.002;

}  // namespace teletact
