// What the report needs of a console's samples once they are gone, so that a run of days holds no
// more of them than one of minutes: the newest are whole, of the older ones only this.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tasks/graph/samples.hpp"
#include "tools/touch/touch_script.hpp"

namespace teletact {

// When a list reaches twice its number the older half goes. At 1 kHz the newest minute is whole, of
// fusion and the truth the newest ten.
inline constexpr std::size_t kWholeTicks = 60000, kWholeFrames = 18000, kWholeTruth = 30000;
inline constexpr std::size_t kWholePaths = 200, kWholeArrivals = 4096;

// Every n-th of any number of values, at most kMost: each time it is full, every second one goes
// and n doubles. The first value stays.
template <class T>
struct Decimated {
  static constexpr std::size_t kMost = 20000;
  std::vector<T> kept;
  std::uint64_t step = 1, seen = 0;

  void add(const T& value) {
    if (seen++ % step != 0) return;
    kept.push_back(value);
    if (kept.size() < kMost) return;
    for (std::size_t i = 0; 2 * i < kept.size(); ++i) kept[i] = kept[2 * i];
    kept.resize((kept.size() + 1) / 2);
    step *= 2;
  }
};

struct HapticTally {
  std::uint64_t ticks = 0, contact = 0, guard = 0, contacts = 0, not_finite = 0, clutched = 0;
  std::uint64_t jumps = 0, flips = 0;
  double force_N = 0, step_N = 0, step_raw_N = 0, reach = 0;  // largest
  bool has_last = false;
  tasks::HapticSample last{};
  std::array<float, 3> entry{};  // stretch at the entry into the contact that goes on

  // In order of time. `touch_N_per_m`: the contact's spring in the scene.
  void add(const tasks::HapticSample& s, double touch_N_per_m);
};

struct FusionTally {
  std::uint64_t consumed = 0, tracked = 0, claimed = 0, moving = 0;
  std::uint32_t moving_cells = 0;  // largest

  void add(const tasks::FusionSample& s) noexcept;
};

// Takes and touches the memory for so many values, once, before the run: a list that grows to its
// bound in the run takes it then, and leaves behind the smaller blocks that it grew out of.
template <class T>
void hold_room(std::vector<T>& values, std::size_t most) {
  values.resize(most);
  values.clear();
}

// The oldest half of `values` goes, each through `take`, once there are twice `whole` of them.
template <class T, class Take>
void fold_older(std::vector<T>& values, std::size_t whole, const Take& take) {
  if (values.size() < 2 * whole) return;
  for (std::size_t i = 0; i < whole; ++i) take(values[i]);
  values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(whole));
}

}  // namespace teletact
