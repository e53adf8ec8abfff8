#include "tasks/graph/limits.hpp"

#include <string>

#include "tasks/graph/graph_config.hpp"

namespace tasks {

namespace {

using std::chrono::milliseconds;

// Least limit of a liveness: two periods of its writer.
int least_ms(const EdgeRow& edge) noexcept {
  if (edge.from == kConsole) return 40;
  if (edge.from == kLink) return 100;  // an unanswered demand is made again after 50
  const auto rate_hz = kTaskTable[index_of(edge.from)].rate_hz;
  return static_cast<int>((2000 + rate_hz - 1) / rate_hz);
}

}  // namespace

void LimitsConfig::describe(config::Section& s) {
  constexpr int kMost_ms = 60000;
  for (std::size_t i = 0; i < kLimitTable.size(); ++i) {
    const LimitRow& row = kLimitTable[i];
    const EdgeRow& edge = kEdgeTable[index_of(row.edge)];
    const std::string name(edge.name);
    config::Section& of =
        s.section(std::string(reader_name(row.reader)), "how old its inputs may be");
    const int least = least_ms(edge);
    if (row.liveness_key.empty())
      of.integer(name + "_liveness_ms", liveness_ms[i], least, kMost_ms,
                 "longest silence of " + std::string(reader_name(edge.from)));
    if (row.age_key.empty() && row.data_age_ms != kAgeless)
      of.integer(name + "_age_ms", data_age_ms[i], least, kMost_ms,
                 "oldest datum in a " + name + " that counts");
  }
}

Limit limit_in_force(const GraphConfig& c, std::size_t row) noexcept {
  Limit limit{milliseconds{c.limits.liveness_ms[row]}, milliseconds{c.limits.data_age_ms[row]}};
  switch (row) {
    case limit_row(EdgeId::kRobotState, TaskId::kPrediction):
      limit.age = milliseconds{c.prediction.state_liveness_ms};
      break;
    case limit_row(EdgeId::kGoal, TaskId::kRobotIo):
      limit = {milliseconds{c.robot_io.link_silence_ms}, milliseconds{c.prediction.goal_valid_ms}};
      break;
    case limit_row(EdgeId::kRobotState, TaskId::kSupervision):
    case limit_row(EdgeId::kGoal, TaskId::kRobotSupervision):
      limit.liveness = rt::nanos_from_seconds(c.supervision.link_liveness_s);
      break;
    case limit_row(EdgeId::kPatch, TaskId::kHaptic):
      limit.liveness = rt::nanos_from_seconds(c.haptic.patch_liveness_s);
      break;
    default:
      break;
  }
  if (kLimitTable[row].data_age_ms == kAgeless) limit.age = rt::Nanos::max();
  return limit;
}

void LimitWatch::tell(State state, rt::Time now, rt::Nanos by) noexcept {
  state_ = state;
  if (state != State::kGood) ++crossed_;
  if (logs_ == nullptr || row().reader == kConsole) return;
  // The one that was crossed; in time again: that of the silence, which is what is told of then.
  const rt::Nanos limit = state == State::kOld ? limit_.age : limit_.liveness;
  logs_->of(row().reader)
      .write(logs_->limits[row_], now, static_cast<unsigned>(state),
             1e-6 * static_cast<double>(by.count()), 1e-6 * static_cast<double>(limit.count()));
}

}  // namespace tasks
