// Whom the supervision of a box watches: the rows of kTaskTable that say so, in their order.
#pragma once

#include <array>
#include <chrono>

#include "tasks/contract/table.hpp"
#include "tasks/supervision/supervision_task.hpp"

namespace tasks {

template <rt::Box B>
[[nodiscard]] consteval auto watched_in() {
  constexpr auto watched = [](const TaskRow& t) { return t.box == B && t.watch.fault != 0; };
  constexpr auto count = std::count_if(kTaskTable.begin(), kTaskTable.end(), watched);
  std::array<TaskRow, static_cast<std::size_t>(count)> rows{};
  std::copy_if(kTaskTable.begin(), kTaskTable.end(), rows.begin(), watched);
  return rows;
}

template <std::size_t N>
[[nodiscard]] consteval std::array<Watch, N> watches_of(const std::array<TaskRow, N>& rows) {
  std::array<Watch, N> watches{};
  for (std::size_t i = 0; i < N; ++i)
    watches[i] = {rows[i].watch.fault, std::chrono::milliseconds{rows[i].watch.silence_ms}};
  return watches;
}

}  // namespace tasks
