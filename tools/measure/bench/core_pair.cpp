#include "tools/measure/bench/core_pair.hpp"

#include <pthread.h>
#include <sched.h>

#include <chrono>

namespace teletact {
namespace {

// Pins the calling thread; true when it also became SCHED_FIFO.
bool settle(int cpu) {
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<std::size_t>(cpu), &one);
  (void)pthread_setaffinity_np(pthread_self(), sizeof one, &one);
  sched_param param{};
  param.sched_priority = 50;
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &param) == 0;
}

}  // namespace

CorePair::CorePair() {
  cpu_set_t mask;
  CPU_ZERO(&mask);
  sched_getaffinity(0, sizeof mask, &mask);
  int found = 0;
  for (int c = 0; c < CPU_SETSIZE && found < 2; ++c) {
    if (CPU_ISSET(static_cast<std::size_t>(c), &mask)) cpu_[found++] = c;
  }
  if (found < 2) {
    missing_ = "two cores are needed, the process may use only " + std::to_string(found);
    return;
  }
  for (int side = 0; side < 2; ++side) {
    sides_[side].thread = std::thread([this, side] { loop(side); });
  }
  const std::function<void()> nothing = [] {};
  run(nothing, nothing);  // both have settled
}

CorePair::~CorePair() {
  {
    const std::lock_guard<std::mutex> hold(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  for (Side& side : sides_) {
    if (side.thread.joinable()) side.thread.join();
  }
}

void CorePair::loop(int side) {
  const bool fifo = settle(cpu_[side]);
  int done = 0;
  for (;;) {
    const std::function<void()>* job = nullptr;
    {
      std::unique_lock<std::mutex> hold(mutex_);
      if (side == 0) fifo_ = fifo;
      wake_.wait(hold, [&] { return stopping_ || generation_ != done; });
      if (stopping_) return;
      done = generation_;
      job = sides_[side].job;
    }
    // Both wait here on the cores they run on, so neither starts before the other can answer.
    arrived_.fetch_add(1);
    while (arrived_.load() != 2) {
    }
    (*job)();
    const std::lock_guard<std::mutex> hold(mutex_);
    if (--running_ == 0) ended_.notify_all();
  }
}

void CorePair::run(const std::function<void()>& a, const std::function<void()>& b) {
  std::unique_lock<std::mutex> hold(mutex_);
  sides_[0].job = &a;
  sides_[1].job = &b;
  arrived_.store(0);
  running_ = 2;
  ++generation_;
  wake_.notify_all();
  ended_.wait(hold, [&] { return running_ == 0; });
}

}  // namespace teletact
