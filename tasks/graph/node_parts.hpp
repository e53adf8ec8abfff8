// What the nodes share: publishing health, logging changes of mode and level.
#pragma once

#include <optional>
#include <type_traits>

#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"
#include "rt/clock/tick.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/edges/edge_faults.hpp"
#include "tasks/graph/task_log.hpp"

namespace tasks {

// Newest health of a task, for supervision.
struct HealthMsg {
  rt::Time heartbeat{};
  rt::Health health;
};
using HealthCell = rt::Latest<HealthMsg>;

template <class Cells>
[[nodiscard]] HealthCell& health_of(Cells& cells, TaskId id) noexcept {
  return *cells.health[index_of(id)];
}
[[nodiscard]] inline std::array<float, 3> to_floats(const Vec3& v) noexcept {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

inline void publish_health(HealthCell& cell, rt::Time now, rt::Health health) noexcept {
  cell.begin_write() = {now, health};
  cell.publish(now);
}

inline void log_mode(TaskLogs& logs, TaskId id, rt::Time now, const ModeMsg& mode,
                     Mode& logged) noexcept {
  if (mode.mode == logged) return;
  logs.of(id).write(logs.mode, now, static_cast<unsigned>(logged), static_cast<unsigned>(mode.mode),
                    static_cast<unsigned>(mode.cause));
  logged = mode.mode;
}

inline void log_level(TaskLogs& logs, TaskId id, const rt::Tick& tick, int& logged) noexcept {
  if (tick.level == logged) return;
  if (logged >= 0) {
    logs.of(id).write(logs.level, tick.start, static_cast<unsigned>(logged),
                      static_cast<unsigned>(tick.level));
  }
  logged = tick.level;
}

}  // namespace tasks
