// The real clock: one pinned SCHED_FIFO thread per task, absolute clock_nanosleep on an exact grid,
// a sentinel per core just above the tasks, a watchdog on the last of these cores, and an ordinary
// thread that drains the audit rings.
//
// A row that names a parent is a worker of its pool (worker_pool.hpp): a thread that does parts of
// the parent's jobs. Its record of a job runs from the first fork to the end of its last part, with
// its own CPU time.
//
// No thread does a step of its work before all of them have their core and priority.
//
// A missing right (FIFO, mlock) is reported, and the run is marked "not real-time". cpu_dma_latency
// is not such a right: without it wake-ups from deep idle states are later, which sentinels see and
// the run reports.
//
// Thread priorities: theft of a fault plan 98 > sentinel 95 > watchdog 94 > hog of a fault plan 93
// > tasks 80 - rank.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "rt/channel/ring.hpp"
#include "rt/fault/injector.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/executor.hpp"
#include "rt/sched/worker_pool.hpp"

namespace rt {

struct RealOptions {
  bool fifo = true;  // ask for SCHED_FIFO
  bool sentinel = true;
  bool lock_memory = true;
  bool hold_dma_latency = true;
  Nanos watchdog_period{10000000};
  Nanos hang_limit{100000000};  // a job older than this is hung: its safe output is forced
};

template <class Faults>
class RealExecutor final : public Executor {
 public:
  // Sinks are called from the drain thread, an ordinary one.
  using JobSink = std::function<void(const JobRecord&)>;
  using SentinelSink = std::function<void(const SentinelRecord&)>;

  RealExecutor(NonRealtime& nrt, const std::vector<PlacedTask>& tasks, const Faults& faults,
               JobSink jobs, SentinelSink sentinels, RealOptions options = {});
  ~RealExecutor() override;
  void run(const RunPlan& plan) override;
  void request_stop() noexcept override;

  [[nodiscard]] std::vector<TaskTotals> totals() const override;

  // What was asked for and not granted, one line each; empty = a real-time run.
  // All threads stand: from here on missing() does not change. Any thread may ask.
  [[nodiscard]] bool placed() const noexcept { return placed_.load(std::memory_order_acquire); }
  [[nodiscard]] const std::vector<std::string>& missing() const noexcept { return missing_; }
  // What would have helped and was not granted.
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept { return notes_; }
  [[nodiscard]] std::uint64_t dropped_records() const noexcept;
  // Number of times the watchdog forced a safe output.
  [[nodiscard]] std::uint64_t hangs() const noexcept { return hangs_.load(); }

 private:
  struct Worker;
  struct Sentinel;
  void make_pools(NonRealtime& nrt);
  void start_workers();
  void stop_workers();
  void record_shares(Worker& w, const JobRecord& job);
  void task_loop(Worker& w);
  void serve(Worker& w, std::uint64_t k, Time release, std::uint32_t skipped,
             const JobFaults& faults);
  void sentinel_loop(Sentinel& s);
  void watchdog_loop();
  void drain_loop();
  std::size_t drain_once();
  void launch(std::thread& thread, int cpu, int priority, const std::string& name,
              std::function<void()> body);
  void injector_loop(int cpu, bool theft);
  void lose_until(Worker& w, std::int64_t host_ns);
  [[nodiscard]] int watchdog_cpu() const noexcept;
  [[nodiscard]] Time release_box(const TaskSpec& spec, std::uint64_t k) const noexcept;
  [[nodiscard]] Time raw_arrival(const PlacedTask& task, std::uint64_t k) const noexcept;
  bool sleep_until(std::int64_t host_ns) const noexcept;

  RealOptions options_;
  const Faults& faults_;
  JobSink job_sink_;
  SentinelSink sentinel_sink_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::vector<std::unique_ptr<WorkerPool>> pools_;
  std::vector<std::unique_ptr<Sentinel>> sentinels_;
  std::vector<std::string> missing_, notes_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> placed_{false};          // every thread has its core and its priority
  std::atomic<std::int64_t> stopped_at_{0};  // host; the largest value: nobody asked
  std::atomic<int> alive_{0};
  std::atomic<bool> drain_done_{false};
  std::atomic<std::uint64_t> hangs_{0};
  RunPlan plan_{};
  int dma_fd_ = -1;
};

}  // namespace rt
