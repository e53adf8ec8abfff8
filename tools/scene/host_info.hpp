// What a report says of the machine, and the trace file of a run.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rt/audit/run_log.hpp"

namespace teletact {

[[nodiscard]] std::vector<std::pair<std::string, std::string>> host_rows();
// Chrome/Perfetto JSON: one row a task, one a core's sentinel. Throws std::runtime_error.
void write_trace(const std::string& path, const std::vector<const rt::RunLog*>& logs);
// One line a job. Throws std::runtime_error.
void write_csv(const std::string& path, const std::vector<const rt::RunLog*>& logs);

}  // namespace teletact
