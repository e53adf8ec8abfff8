// How the tasks do, while they run: from the job records that a run keeps, lateness, CPU, misses
// and whose fault they are (rt/audit/blame.hpp), for the page's timing table.
//
//   tasks(), add()   by the thread that keeps the records: an ordinary one, never a task's
//   look(), now()    by the console's thread
//
// Lateness and CPU are of the newest kWindow of each task's own releases, whatever its box's clock
// says; misses are of the whole run so far. With nobody who looks, what waits is bounded: older
// records are dropped and counted.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/audit/run_log.hpp"

namespace teletact {

struct TaskFigures {
  std::string name, box;  // box: "operator" or "robot"
  double hz = 0;
  double late_p95_us = 0;  // start after release
  double cpu_ms = 0;       // mean of a job, twins taken out
  double cpu_share = 0;    // of a core
  std::uint64_t misses = 0;
  std::array<std::uint64_t, rt::kCauses> by_cause{};  // of the misses
  std::size_t jobs = 0;                               // in the window; 0: none yet

  // "3 platform, 1 own"; empty: no miss.
  [[nodiscard]] std::string blame_text() const;
};

class TaskWatch {
 public:
  static constexpr rt::Nanos kWindow = std::chrono::seconds{5};
  static constexpr std::size_t kMostWaiting = 65536;

  // The tasks of one box more; of `header` the records are not read.
  void tasks(const rt::RunLog& header);
  void add(const rt::JobRecord& record);
  void add(const rt::SentinelRecord& record);

  // Takes what has come since the last look.
  void look();
  [[nodiscard]] std::vector<TaskFigures> now() const;
  [[nodiscard]] std::uint64_t dropped() const;

 private:
  struct Job {
    std::int64_t release_ns = 0, late_ns = 0, cpu_ns = 0;
  };
  struct Row {
    rt::TaskLog task;
    rt::BlameWalk walk;
    rt::BlameCounts counts;
    std::deque<Job> jobs;  // of the window
  };
  template <class Record>
  void put(std::vector<Record>& waiting, const Record& record);

  mutable std::mutex mutex_;  // of what waits
  std::vector<rt::TaskLog> new_tasks_;
  std::vector<rt::JobRecord> jobs_;
  std::vector<rt::SentinelRecord> sentinels_;
  std::uint64_t dropped_ = 0;
  // Of the console's thread alone.
  std::vector<Row> rows_;
  std::vector<rt::SentinelRecord> heard_;  // of the newest two looks
  std::size_t heard_before_ = 0;
};

}  // namespace teletact
