#include "tools/measure/accuracy/recording_study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {

namespace {

// Each image as long after the first as it was taken from it, whichever way.
RecordingRow run_in_order(rt::NonRealtime& nrt, const FusionSequence& sequence,
                          const RecordingStudyOptions& o, RecordingRow row) {
  tasks::FusionConfig config = fusion_with_voxel(1e-3 * row.voxel_mm);
  config.levels[0] = config.levels[static_cast<std::size_t>(row.level)];
  config.tracker.iterations = config.levels[0].iterations;
  config.level_count = 1;
  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics;
  tasks::FusionTask task(nrt, config, setup);
  FusionFeed feed(task);
  ClaimedError error;
  const std::vector<int> images = images_of(row.order, row.start, sequence.size());
  const rt::Time begin = sequence.exposure(0), first = sequence.exposure(images.front());
  for (const int i : images) {
    sequence.frame(i, feed.frame());
    const rt::Time taken = sequence.exposure(i);
    feed.frame().exposure = begin + (taken > first ? taken - first : first - taken);
    const auto& out = feed.step();
    ++row.frames;
    row.lost += out.camera.tracking == tasks::CameraPose::Tracking::kLost ? 1 : 0;
    if (!out.camera_written || !out.camera.claimed) continue;
    ++row.claimed;
    const perception::Pose* truth = sequence.truth(i);
    if (truth == nullptr) continue;
    row.wrong += 1e3 * error.add(out.camera.X_WC, *truth) > o.wrong_mm ? 1 : 0;
  }
  row.ate_mm = error.ate_mm();
  row.worst_mm = error.worst_mm();
  return row;
}

void print_rows(std::ostream& out, const char* title, const std::vector<RecordingRow>& rows) {
  char line[160];
  std::snprintf(line, sizeof line, "\n%s\n%8s %5s  %-13s %5s  %9s %5s %5s %8s %9s\n", title,
                "voxel mm", "level", "order", "from", "claimed", "lost", "wrong", "ATE mm",
                "worst mm");
  out << line;
  for (const RecordingRow& r : rows) {
    std::snprintf(line, sizeof line, "%8g %5d  %-13s %5d  %4d/%-4d %5d %5d %8.1f %9.1f\n",
                  r.voxel_mm, r.level, name_of(r.order), r.start, r.claimed, r.frames, r.lost,
                  r.wrong, r.ate_mm, r.worst_mm);
    out << line;
  }
}

}  // namespace

const char* name_of(Order order) noexcept {
  switch (order) {
    case Order::kForwards:
      return "forwards";
    case Order::kBackwards:
      return "backwards";
    case Order::kEverySecond:
      return "every second";
  }
  return "?";
}

std::vector<int> images_of(Order order, int start, int size) {
  std::vector<int> all;
  if (order == Order::kBackwards) {
    for (int i = size - start; i >= 0; --i) all.push_back(i);
  } else {
    const int step = order == Order::kEverySecond ? 2 : 1;
    for (int i = start - 1; i < size; i += step) all.push_back(i);
  }
  return all;
}

RecordingStudy study_recording(std::ostream& progress, const FusionSequence& sequence,
                               const RecordingStudyOptions& o) {
  if (sequence.known_truth().empty())
    throw std::runtime_error(sequence.name + ": has no true pose at the stamp of a frame");
  rt::Startup startup;
  RecordingStudy study;
  study.wrong_mm = o.wrong_mm;
  const auto run = [&](const RecordingRow& row) {
    progress << row.voxel_mm << " mm, level " << row.level << ", " << name_of(row.order) << " from "
             << row.start << std::endl;
    return run_in_order(startup.token(), sequence, o, row);
  };
  for (const double voxel_mm : o.voxels_mm) {
    for (const Order order : {Order::kForwards, Order::kBackwards, Order::kEverySecond}) {
      for (int start = 1; start <= sequence.size(); start += o.start_step) {
        const auto left = static_cast<int>(images_of(order, start, sequence.size()).size());
        if (start > 1 && left < o.least_frames / (order == Order::kEverySecond ? 2 : 1)) break;
        study.starts.push_back(run({voxel_mm, 0, order, start}));
      }
    }
  }
  for (const double voxel_mm : o.level_voxels_mm) {
    for (const int level : o.levels)
      study.levels.push_back(run({voxel_mm, level, Order::kForwards, 1}));
  }
  return study;
}

void RecordingStudy::print(std::ostream& out) const {
  print_rows(out, "each order, begun anywhere", starts);
  print_rows(out, "each level", levels);
  out << "\n";
  teletact::print(out, limits().all());
}

Limits RecordingStudy::limits() const {
  Limits all;
  char what[120];
  int wrong = 0, unclaimed = 0;
  double worst_mm = 0;
  for (const std::vector<RecordingRow>* rows : {&starts, &levels}) {
    for (const RecordingRow& r : *rows) {
      wrong += r.wrong;
      worst_mm = std::fmax(worst_mm, r.worst_mm);
    }
  }
  for (const RecordingRow& r : levels) unclaimed += r.frames - r.claimed;
  std::snprintf(what, sizeof what, "frames claimed more than %g mm off (largest %.1f mm)", wrong_mm,
                worst_mm);
  all.add(what, wrong, "<=", 0);
  all.add("frames not claimed, of all levels", unclaimed, "<=", 0);
  return all;
}

std::vector<BenchMetric> RecordingStudy::metrics() const {
  std::vector<BenchMetric> all;
  for (const std::vector<RecordingRow>* rows : {&starts, &levels}) {
    for (const RecordingRow& r : *rows) {
      char head[80];
      std::snprintf(head, sizeof head, "recording.%gmm.level%d.%s.from%d.", r.voxel_mm, r.level,
                    name_of(r.order), r.start);
      std::string name = head;
      std::replace(name.begin(), name.end(), ' ', '_');
      all.push_back({name + "claimed", static_cast<double>(r.claimed) / r.frames, "1"});
      if (std::isfinite(r.worst_mm)) all.push_back({name + "worst_mm", r.worst_mm, "mm"});
      all.push_back({name + "wrong", static_cast<double>(r.wrong), "1"});
    }
  }
  return all;
}

}  // namespace teletact
