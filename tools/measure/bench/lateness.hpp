// How late the tasks of a recorded run started, over what the machine alone did. Pure.
#pragma once

#include <cstdint>
#include <string_view>

#include "rt/audit/run_log.hpp"

namespace teletact {

// The task's row. Throws std::runtime_error where the run has none of this name.
[[nodiscard]] const rt::TaskLog& task_of(const rt::RunLog& log, std::string_view name);

// Its jobs that were released in [from_ns, to_ns) of the box's clock, without what is counted only.
[[nodiscard]] rt::TaskLog released_in(const rt::TaskLog& task, std::int64_t from_ns,
                                      std::int64_t to_ns);

// p99 of start over the sentinel's at the same release, us, of those jobs. NaN: there is none.
[[nodiscard]] double late_p99_us(const rt::RunLog& log, std::string_view task, std::int64_t from_ns,
                                 std::int64_t to_ns);

// Misses of all tasks that were their own doing.
[[nodiscard]] std::uint64_t own_misses(const rt::RunLog& log);

}  // namespace teletact
