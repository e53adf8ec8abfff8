// A fork-join pool with ordinary pinned threads, for benches of what takes part in it.
#pragma once

#include <cstdint>
#include <thread>
#include <vector>

#include "rt/sched/worker_pool.hpp"

namespace teletact {

// The calling thread takes the first CPU of its mask, each worker another one, as far as there are;
// given back at the end.
class BenchPool {
 public:
  explicit BenchPool(int workers);
  ~BenchPool();
  BenchPool(const BenchPool&) = delete;
  BenchPool& operator=(const BenchPool&) = delete;

  [[nodiscard]] rt::WorkerPool& pool() noexcept { return pool_; }
  // Wall time of a fork and join of parts without work, median of many; measured at a real-time
  // priority, as the pool has in the product, where that is permitted: else it may hold waits for a
  // core that others use.
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return round_trip_ns_; }
  [[nodiscard]] bool real_time() const noexcept { return real_time_; }
  // Thread CPU of all workers since begin_job().
  [[nodiscard]] std::int64_t workers_cpu_ns() const noexcept;

 private:
  void measure_round_trip();
  rt::Startup startup_;
  rt::WorkerPool pool_;
  std::vector<int> cpus_;
  std::vector<std::thread> threads_;
  std::int64_t round_trip_ns_ = 0;
  bool real_time_ = false;
};

}  // namespace teletact
