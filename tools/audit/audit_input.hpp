// What an audit reads: logs of runs, their stores, black boxes.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/store/read_store.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

struct AuditInput {
  std::vector<rt::RunLog> logs;  // one a file
  std::vector<std::pair<std::string, rt::BlackBox>> boxes;
  std::vector<rt::StoreEvent> events;
};

// Throws std::runtime_error with one line: the file and what is wrong with it. A piece is of logs
// alone.
[[nodiscard]] AuditInput read_files(const std::vector<std::string>& files, const rt::StorePiece&);

// Throws std::runtime_error that says where the run ends, when nothing of `logs`, which were read
// from `files`, lies in the piece.
void check_piece(const std::vector<std::string>& files, const std::vector<const rt::RunLog*>& logs,
                 const rt::StorePiece& piece);

struct AuditedTask {
  const rt::RunLog* log = nullptr;
  const rt::TaskLog* task = nullptr;
  std::string name;  // with _2, _3 where several files hold a task of this name
};

std::vector<AuditedTask> tasks_of(const std::vector<rt::RunLog>& logs);

}  // namespace teletact
