// How old a value may be for its reader: kLimitTable of table.hpp, as a scene has it, and what
// judges by it.
//
// A LimitWatch is one row of that table in one reader. It is asked at the latch, with the reader's
// clock; what the reader then does is its node's or its task's, and said in the row. Each time a
// limit is crossed, and when the value is in time again, the reader's log says so. Before a first
// publication, or before its value holds anything sensed, the value is not within the limit, and no
// line says so.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "config/schema.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/edges/message_values.hpp"
#include "tasks/graph/task_log.hpp"

namespace tasks {

struct GraphConfig;

// Section [limits]: what rows without keys of their own take.
struct LimitsConfig {
  std::array<int, kLimitTable.size()> liveness_ms = of_table(&LimitRow::liveness_ms);
  std::array<int, kLimitTable.size()> data_age_ms = of_table(&LimitRow::data_age_ms);

  void describe(config::Section& s);

 private:
  [[nodiscard]] static constexpr std::array<int, kLimitTable.size()> of_table(
      int LimitRow::*column) noexcept {
    std::array<int, kLimitTable.size()> a{};
    for (std::size_t i = 0; i < a.size(); ++i) a[i] = kLimitTable[i].*column;
    return a;
  }
};

// In force; Nanos::max() = none.
struct Limit {
  rt::Nanos liveness = rt::Nanos::max(), age = rt::Nanos::max();
};
[[nodiscard]] Limit limit_in_force(const GraphConfig& config, std::size_t row) noexcept;

class LimitWatch {
 public:
  enum class State : std::uint8_t { kGood, kSilent, kOld };

  // Without `logs` a crossing is only counted. See also watch().
  LimitWatch(std::size_t row, const GraphConfig& config, TaskLogs* logs) noexcept
      : limit_(limit_in_force(config, row)), row_(row), logs_(logs) {}

  // `view`: what the latch took of a Latest.
  template <class View>
  [[nodiscard]] bool within(const View& view, rt::Time now) noexcept {
    if (!view) return false;
    const rt::Time taken = edge::datum(*view);
    return taken != rt::Time{} && within(now, view.at, taken, view.unsure);
  }
  // Writer heard at `heard`; data taken at `taken`, give or take `unsure`.
  [[nodiscard]] bool within(rt::Time now, rt::Time heard, rt::Time taken,
                            rt::Nanos unsure = rt::Nanos{0}) noexcept {
    State state = State::kGood;
    if (now - heard > limit_.liveness)
      state = State::kSilent;
    else if (now - taken + unsure > limit_.age)
      state = State::kOld;
    if (state != state_) [[unlikely]]
      tell(state, now, state == State::kOld ? now - taken + unsure : now - heard);
    return state == State::kGood;
  }
  [[nodiscard]] State state() const noexcept { return state_; }
  [[nodiscard]] std::uint32_t crossed() const noexcept { return crossed_; }
  [[nodiscard]] const Limit& limit() const noexcept { return limit_; }
  [[nodiscard]] const LimitRow& row() const noexcept { return kLimitTable[row_]; }

 private:
  void tell(State state, rt::Time now, rt::Nanos by) noexcept;

  Limit limit_;
  State state_ = State::kGood;
  std::uint32_t crossed_ = 0;
  std::size_t row_;
  TaskLogs* logs_;
};

// The watches of all that one task reads: limits.of<Edge>().
template <TaskId R>
class ReaderLimits {
  static constexpr std::size_t kRows = static_cast<std::size_t>(std::count_if(
      kLimitTable.begin(), kLimitTable.end(), [](const LimitRow& row) { return row.reader == R; }));
  [[nodiscard]] static constexpr std::array<std::size_t, kRows> rows() {
    std::array<std::size_t, kRows> found{};
    for (std::size_t i = 0, at = 0; i < kLimitTable.size(); ++i) {
      if (kLimitTable[i].reader == R) found[at++] = i;
    }
    return found;
  }
  [[nodiscard]] static constexpr std::size_t place_of(EdgeId edge) {
    std::size_t place = 0;
    while (rows()[place] != find_limit_row(edge, R)) ++place;
    return place;
  }

 public:
  ReaderLimits(const GraphConfig& config, TaskLogs* logs) noexcept
      : watches_(make(config, logs, std::make_index_sequence<kRows>{})) {}
  template <EdgeId E>
  [[nodiscard]] LimitWatch& of() noexcept {
    constexpr std::size_t place = place_of(E);
    return watches_[place];
  }

 private:
  template <std::size_t... I>
  static std::array<LimitWatch, kRows> make(const GraphConfig& config, TaskLogs* logs,
                                            std::index_sequence<I...>) noexcept {
    return {LimitWatch(rows()[I], config, logs)...};
  }
  std::array<LimitWatch, kRows> watches_;
};

}  // namespace tasks
