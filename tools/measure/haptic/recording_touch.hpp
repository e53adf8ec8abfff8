// A hand on a recording that plays forward and back while it is being fused: frames at 30 Hz of
// virtual time, every claimed one integrated, windows of the growing map, 1000 ticks a second. The
// hand's path was made by a seeded script on the final map of a first pass. The same trace goes
// through `nearest` and the published method beside it, on the same windows. What the product
// misses is shown to the field's optimum, if asked.
#pragma once

#include <cstdint>
#include <cstdio>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/measure/haptic/map_path.hpp"
#include "tools/measure/haptic/recording_optimum.hpp"
#include "tools/touch/tick_file.hpp"

namespace teletact {

struct RecordingTouchOptions {
  std::string rgbd;
  std::optional<drivers::TumOptions::Pinhole> pinhole =
      std::nullopt;       // of the recording, if it does not say
  int frames = 150;       // of the recording at most, played forward and back
  bool from_end = false;  // begins with the last of them
  double seconds = 60;    // of virtual time
  std::uint64_t seed = 1;
  int paths = 1;                     // of this seed and those after it, all over one fusion
  std::optional<Place::Kind> first;  // where a path begins; none: at what is seen first
  int pool = 400;                    // places of a kind that are chosen from
  bool beside = true;                // nearest and force_shading too
  bool optimum = false;              // the field's optimum in contacts in which a limit is missed
  std::FILE* record = nullptr;       // haptic run of the product's method, first path
};

// At one place, or between them.
struct PlaceFigures {
  double contact_s = 0, step_raw_max_N = 0;
  std::uint64_t jumps = 0, pops = 0;
};

struct TouchedRow {
  std::string method;
  std::uint64_t ticks = 0, contact = 0;
  std::uint64_t jumps = 0;         // contact ticks with |dF_raw| > K |dh| + 0.5 N
  std::uint64_t longest_jump = 0;  // ticks in a row
  double step_raw_max_N = 0, step_max_N = 0, force_max_N = 0;
  std::uint64_t not_finite = 0, sunk = 0, flipped = 0, unknown = 0;
  std::uint64_t let_go = 0;  // the surface under the hand went, or came too fast
  double deepest_mm = 0;
  double energy_min_J = 0;    // E + booked + credit, at b 2 N s/m
  double stretch_max_mm = 0;  // from the hand to the proxy
  struct Event {
    double t_s = 0, step_raw_N = 0, blend = 1;
    int place = -1;
    std::size_t begin = 0, tick = 0;  // last free tick before the contact, and this
    std::uint64_t in_a_row = 0;       // jumps
    bool jump = false, flipped = false, sunk = false;
    perception::Vec3 p_WH = perception::Vec3::Zero(), p_WP = perception::Vec3::Zero(),
                     p_before_WP = perception::Vec3::Zero(),  // proxy, a tick before
        entry_W = perception::Vec3::Zero();                   // n_entry of the contact
  };
  std::vector<Event> events;               // the first 60 jumps and pops
  std::vector<float> force_N, step_raw_N;  // a tick
  std::vector<PlaceFigures> places;        // the last: between them
  [[nodiscard]] double jump_share() const {
    return contact > 0 ? static_cast<double>(jumps) / static_cast<double>(contact) : 0;
  }
};

// One path.
struct TouchedPath {
  std::uint64_t seed = 0;
  double seconds = 0, hand_speed_max_m_per_s = 0, way_m = 0;
  std::vector<Place> places;
  std::vector<TouchedRow> rows;   // the first is the product's method
  ContactFigures asked, optimum;  // product and optimum in the contacts asked about
  // Those with a jump or a turn beyond the limits.
  [[nodiscard]] std::vector<TickSpan> missed_contacts() const;
  // Of jumps in a row, turns and ticks through the surface: limits missed that the optimum keeps,
  // or was not asked about.
  [[nodiscard]] int missed_alone() const;
  [[nodiscard]] int surfaces_touched() const;  // places with half a second of contact
  // Of the product's method: two thirds of the time in contact; five surfaces, with a wall, an
  // edge and a corner; at most 1 % of the contact ticks over K |dh| + 0.5 N, not more than two in a row; all
  // finite; nowhere through the surface.
  [[nodiscard]] std::vector<Limit> limits() const;
  void print(std::ostream& out) const;
};

struct RecordingTouchResult {
  int frames_played = 0, integrated = 0;
  double seconds = 0;
  bool optimum = false;  // was asked
  std::vector<TouchedPath> paths;
  [[nodiscard]] std::vector<Limit> limits() const;  // the path that is worst at each
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;  // the worst of all paths
  void print(std::ostream& out) const;
  // SVG, first path: force, and raw step a tick, of every method over time.
  [[nodiscard]] std::string force_drawing() const;
  [[nodiscard]] std::string step_drawing() const;
};

// Throws std::runtime_error: recording can not be read, map without the places.
[[nodiscard]] RecordingTouchResult touch_recording(std::ostream& progress,
                                                   const RecordingTouchOptions& options);

}  // namespace teletact
