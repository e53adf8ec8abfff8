#include "tools/measure/bench/bench_pool.hpp"

#include <pthread.h>
#include <sched.h>

#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"

namespace teletact {

namespace {

std::vector<int> cpus_of_this_thread() {
  cpu_set_t set;
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return cpus;
  for (int c = 0; c < CPU_SETSIZE; ++c)
    if (CPU_ISSET(static_cast<std::size_t>(c), &set)) cpus.push_back(c);
  return cpus;
}

void pin(pthread_t thread, const std::vector<int>& cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int c : cpus) CPU_SET(static_cast<std::size_t>(c), &set);
  pthread_setaffinity_np(thread, sizeof set, &set);
}

// To the class that the executor gives the pool, and back. False: not permitted.
bool rank(pthread_t thread, bool real_time) {
  sched_param param{};
  param.sched_priority = real_time ? 10 : 0;
  return pthread_setschedparam(thread, real_time ? SCHED_FIFO : SCHED_OTHER, &param) == 0;
}

}  // namespace

BenchPool::BenchPool(int workers) : pool_(startup_.token(), workers), cpus_(cpus_of_this_thread()) {
  for (int w = 0; w < workers; ++w) {
    threads_.emplace_back([this, w] { pool_.serve(w); });
    if (!cpus_.empty()) {
      pin(threads_.back().native_handle(), {cpus_[static_cast<std::size_t>(w + 1) % cpus_.size()]});
    }
  }
  if (!cpus_.empty()) pin(pthread_self(), {cpus_.front()});
  measure_round_trip();
  pool_.profile(true);
}

void BenchPool::measure_round_trip() {
  bool real_time = rank(pthread_self(), true);
  for (auto& t : threads_) real_time = rank(t.native_handle(), true) && real_time;
  std::vector<std::int64_t> trips;
  for (int n = 0; n < 2000; ++n) {
    const std::int64_t begin = rt::monotonic_ns();
    pool_.for_parts(pool_.width(), [](int) {});
    trips.push_back(rt::monotonic_ns() - begin);
  }
  for (auto& t : threads_) static_cast<void>(rank(t.native_handle(), false));
  static_cast<void>(rank(pthread_self(), false));
  round_trip_ns_ = rt::quantile_in_place(std::span(trips), 0.5);
  real_time_ = real_time;
}

BenchPool::~BenchPool() {
  pool_.stop();
  for (auto& t : threads_) t.join();
  if (!cpus_.empty()) pin(pthread_self(), cpus_);
}

std::int64_t BenchPool::workers_cpu_ns() const noexcept {
  std::int64_t sum = 0;
  for (int w = 0; w + 1 < pool_.width(); ++w) sum += pool_.share(w).cpu_ns;
  return sum;
}

}  // namespace teletact
