// How old a value may be for its reader: kLimitTable of table.hpp, as a scene has it, and what judges by it.
//
// A LimitWatch is one row of that table in one reader. It is asked at the latch, with the reader's clock; what the
// reader then does is its node's or its task's, and said in the row. Each time a limit is crossed, and when the value is
// in time again, the reader's log says so. Nothing published yet, or nothing sensed yet in what was: not within, and
// not told.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "config/schema.hpp"
#include "drivers/link/messages.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "tasks/fusion/scene_view.hpp"
#include "tasks/graph/messages.hpp"
#include "tasks/graph/object_list.hpp"
#include "tasks/graph/surface_points.hpp"
#include "tasks/graph/table.hpp"
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

// When the oldest sensor datum in a message was taken; zero: there is none in it yet.
namespace edge {
inline rt::Time datum(const perception::RgbdFrame& m) noexcept { return m.exposure; }
inline rt::Time datum(const drivers::RobotState& m) noexcept { return m.taken; }
inline rt::Time datum(const drivers::RobotGoal& m) noexcept { return m.made; }
inline rt::Time datum(const perception::SurfacePatch& m) noexcept { return m.exposure; }
inline rt::Time datum(const SurfacePoints& m) noexcept { return m.exposure; }
inline rt::Time datum(const SceneView& m) noexcept { return m.exposure; }
inline rt::Time datum(const perception::MeshDelta& m) noexcept { return m.exposure; }
inline rt::Time datum(const perception::CostMap& m) noexcept { return m.exposure; }
inline rt::Time datum(const CameraPose& m) noexcept { return m.seen; }
inline rt::Time datum(const ObjectList& m) noexcept { return m.exposure; }
inline rt::Time datum(const HapticState& m) noexcept { return m.stamp; }
inline rt::Time datum(const OdometryFrame& m) noexcept { return m.taken; }
inline rt::Time datum(const Path& m) noexcept { return m.seen; }
inline rt::Time datum(const TaskState& m) noexcept { return m.stamp; }
inline rt::Time datum(const ModeMsg& m) noexcept { return m.stamp; }
}  // namespace edge

class LimitWatch {
 public:
  enum class State : std::uint8_t { kGood, kSilent, kOld };

  // Without `logs` a crossing is only counted.
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

}  // namespace tasks
