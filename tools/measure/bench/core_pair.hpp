// Two threads pinned to two cores, SCHED_FIFO where permitted, that run two sides of a burst at the
// same time. Bursts are milliseconds long with a rest between them, so that the machine stays
// usable and the kernel's throttling of real-time threads does not set in.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace teletact {

class CorePair {
 public:
  CorePair();  // takes the first two CPUs of the process's affinity mask
  ~CorePair();
  CorePair(const CorePair&) = delete;
  CorePair& operator=(const CorePair&) = delete;

  // Empty when both cores are there; else why nothing can be measured.
  [[nodiscard]] const std::string& missing() const { return missing_; }
  [[nodiscard]] bool fifo() const { return fifo_; }
  [[nodiscard]] int cpu(int side) const { return cpu_[side]; }

  // Runs a() on the first core and b() on the second, released together; returns when both ended.
  void run(const std::function<void()>& a, const std::function<void()>& b);

 private:
  struct Side {
    std::thread thread;
    const std::function<void()>* job = nullptr;
  };
  void loop(int side);

  int cpu_[2] = {-1, -1};
  bool fifo_ = false;
  std::string missing_;
  Side sides_[2];
  std::mutex mutex_;
  std::condition_variable wake_, ended_;
  int generation_ = 0, running_ = 0;
  bool stopping_ = false;
  std::atomic<int> arrived_{0};
};

}  // namespace teletact
