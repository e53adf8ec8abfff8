// Simulates the person at the desk for hand segments with source = "chosen": they look at the
// picture of the fused map and choose where to touch next. The console, an ordinary thread, plays
// it from the newest picture; no task does.
//
// A visit is
//   move    chosen, and the next segment is a chosen move: a place is chosen, the hand goes
//           half-way
//   move    chosen: to over the place; if it has gone by now another one is chosen
//   press   chosen: onto the place as it shows now; not done when it has gone
// Each is decided 100 ms before its segment starts. If there is no place to choose, the hand stays
// for that segment.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/haptic/hand_script.hpp"
#include "perception/ground/cost_map.hpp"
#include "rt/time.hpp"
#include "tasks/graph/samples.hpp"
#include "tools/touch/touch_places.hpp"

namespace teletact {

// One visit, as it is kept for the report.
struct Visit {
  TouchPlace::Kind kind = TouchPlace::Kind::kTop;
  bool chosen = false;   // false: there was nothing to choose
  bool pressed = false;  // false: gone before the press
  std::int32_t pictures = 0;
  std::array<float, 3> p_W{}, n_W{};
  double at_s = 0;                 // after the epoch, when it was chosen
  double from_s = 0, until_s = 0;  // press to the next motion
};

class TouchScript {
 public:
  TouchScript(drivers::HandScript& hand, const Reach& reach);
  // Does anything of the script wait for it?
  [[nodiscard]] bool asked() const noexcept { return asked_; }
  // `map`: where the ground was found it says what is level.
  void tick(rt::Nanos since_epoch, const tasks::SceneView& view, const perception::CostMap& map);
  [[nodiscard]] const std::vector<Visit>& visits() const noexcept { return visits_; }
  // One line a visit since the last call, each ended by a line break.
  [[nodiscard]] std::string news();

 private:
  void settle(std::size_t i, rt::Nanos since_epoch, const tasks::SceneView& view);
  void choose(rt::Nanos since_epoch, const tasks::SceneView& view);
  void onto(const TouchPlace& now);
  void begin_visit(rt::Nanos since_epoch);
  [[nodiscard]] bool next_is_chosen_move(std::size_t i) const;
  drivers::HandScript& hand_;
  Reach reach_;
  TouchPlaces memory_;
  std::vector<TouchPlace> touched_;
  std::vector<Visit> visits_;
  std::optional<NextPlace> next_;
  perception::Vec3 at_W_;
  std::size_t segment_ = 0, told_ = 0;
  std::uint64_t seen_ = 0;
  bool asked_ = false, visiting_ = false;
};

[[nodiscard]] std::string text_of(const Visit& visit);

// What came of a visit between `from_s` and `until_s`.
struct Touched {
  double contact_s = 0, force_max_N = 0;
  [[nodiscard]] bool met() const noexcept { return contact_s > 0; }
};
struct TouchedPlaces {
  std::array<int, TouchPlace::kKinds> touched{};  // visits that met something
  int none = 0, gone = 0;                         // nothing to choose; gone before the press
  std::vector<Touched> visits;
  [[nodiscard]] int met() const noexcept;
  // "3 tops, 1 wall"; empty: nothing.
  [[nodiscard]] std::string text() const;
};
inline constexpr int kLeastTouches = 5;  // of a recording; fewer where the run has time for fewer
// Why a recording was touched too rarely; empty: it was not. `asked`: visits that the script had
// time for.
[[nodiscard]] std::string too_few_touches(const TouchedPlaces& touched, int asked);
// `before`: of the same visits, by samples that are gone.
[[nodiscard]] TouchedPlaces touched_places(const std::vector<Visit>& visits,
                                           std::span<const tasks::HapticSample> samples,
                                           std::int64_t epoch_ns,
                                           const std::vector<Touched>& before = {});

}  // namespace teletact
