// A hand on a recording that plays forward and back while it is being fused: frames at 30 Hz of virtual time, every
// claimed one integrated, windows of the growing map, 1000 ticks a second. The hand's path was made by a
// seeded script on the final map of a first pass. The same trace goes through `nearest` and the published method
// beside it, on the same windows.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "tools/bench/bench_metric.hpp"
#include "tools/haptic/map_path.hpp"
#include "tools/haptic/run_file.hpp"

namespace teletact {

struct RecordingTouchOptions {
  std::string rgbd;
  std::optional<drivers::TumOptions::Pinhole> pinhole =
      std::nullopt;     // of the recording, if it does not say
  int frames = 150;     // of the recording at most, played forward and back
  double seconds = 60;  // of virtual time
  std::uint64_t seed = 1;
  bool beside = true;           // nearest and force_shading too
  std::FILE* record = nullptr;  // haptic run of the product's method
};

struct TouchedRow {
  std::string method;
  std::uint64_t ticks = 0, contact = 0;
  std::uint64_t jumps = 0;         // contact ticks with |dF_raw| > K |dh| + 0.5 N
  std::uint64_t longest_jump = 0;  // ticks in a row
  double step_raw_max_N = 0, step_max_N = 0, force_max_N = 0;
  std::uint64_t not_finite = 0, sunk = 0, flipped = 0, unknown = 0;
  double deepest_mm = 0;
  double stretch_max_mm = 0;  // from the hand to the proxy
  struct Event {
    double t_s = 0, step_raw_N = 0;
    bool flipped = false, sunk = false;
    perception::Vec3 p_WH = perception::Vec3::Zero(), p_WP = perception::Vec3::Zero();
  };
  std::vector<Event> events;               // the first 20 jumps and pops
  std::vector<float> force_N, step_raw_N;  // a tick
  std::vector<double> place_contact_s;     // in contact at each place
  [[nodiscard]] double jump_share() const {
    return contact > 0 ? static_cast<double>(jumps) / static_cast<double>(contact) : 0;
  }
};

struct RecordingTouchResult {
  int frames_played = 0, integrated = 0;
  double seconds = 0, hand_speed_max_m_per_s = 0;
  std::vector<Place> places;
  std::vector<TouchedRow> rows;                // the first is the product's method
  [[nodiscard]] int surfaces_touched() const;  // places with half a second of contact
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
  // SVG: force, and raw step a tick, of every method over time.
  [[nodiscard]] std::string force_drawing() const;
  [[nodiscard]] std::string step_drawing() const;
};

// Throws std::runtime_error: recording can not be read, map without the places.
[[nodiscard]] RecordingTouchResult touch_recording(std::ostream& progress,
                                                   const RecordingTouchOptions& options);

}  // namespace teletact
