// A run's log on disk: written while the run goes on, readable after a kill at any moment.
//
// Text header, one line a task, ended by an empty line; then tagged binary records of this
// machine's layout, in the order they were drained:  'J' JobRecord   'S' SentinelRecord
//   teletact-run 3 <sizeof JobRecord> <sizeof SentinelRecord>
//   task <id> <name> <box> <class> <num> <den> <deadline ns> <policy> <core> <priority> <level>
//        <work min> <work max> <budget ns of level 0> <level 1> ...
//   epoch <ns>         of the box's clock; absent where it is not known
//   note <text>        anything the reader should be told, e.g. what made the run not real-time
// A run that reached its end closes with a trailer:  'T' RunFileTotals, one a task
//                                                    'D' uint64_t, records lost because a ring was full
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/result.hpp"

namespace rt {

struct RunFileTotals {
  std::uint16_t task = 0;
  TaskTotals totals;
};

class RunFileWriter {
 public:
  // Throws std::runtime_error naming the file.
  RunFileWriter(const std::string& path, const RunLog& header);
  void add(const JobRecord& record) noexcept;
  void add(const SentinelRecord& record) noexcept;
  // The trailer: once, after the last record.
  void finish(const std::vector<RunFileTotals>& totals, std::uint64_t dropped) noexcept;
  // Hands everything written so far to the kernel.
  void flush() noexcept;

 private:
  struct Close {
    void operator()(std::FILE* f) const noexcept { std::fclose(f); }
  };
  std::unique_ptr<std::FILE, Close> file_;
};

// The header's lines after the first, without the empty one; and one of them back into the log
// (false: not one of ours). For files that carry the same header (black_box.hpp).
[[nodiscard]] std::string run_header_lines(const RunLog& header);
[[nodiscard]] bool parse_run_header_line(const std::string& line, RunLog& log);
// In order of k within each task.
void sort_jobs(RunLog& log);

// Job records sorted by k within their task; a torn record at the end is dropped.
[[nodiscard]] Result<RunLog> read_run_file(const std::string& path);

}  // namespace rt
