// Work that the console's thread must not wait for: jobs wait in line for one ordinary thread, what
// came of them is taken later. The thread begins with the first job, with nice 10: behind whatever
// else this box has to do.
//
// One thread puts and takes. The owner declares this behind all that its work uses: the destructor
// waits for the job under way.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace teletact {

// What becomes of the jobs that still wait at the end.
enum class AtEnd : std::uint8_t { kDropped, kDone };

template <class Job, class Done>
class DeskThread {
 public:
  // `at_once`: put() itself does the work. For runs that must be the same each time.
  DeskThread(std::size_t most_waiting, bool at_once, AtEnd at_end, std::function<Done(Job)> work)
      : most_waiting_(most_waiting), at_once_(at_once), at_end_(at_end), work_(std::move(work)) {}
  ~DeskThread() {
    if (!thread_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      ends_ = true;
    }
    there_.notify_one();
    thread_.join();
  }
  DeskThread(const DeskThread&) = delete;
  DeskThread& operator=(const DeskThread&) = delete;

  // As many wait as may.
  [[nodiscard]] bool full() {
    const std::lock_guard lock(mutex_);
    return waiting_.size() >= most_waiting_;
  }
  // False: full().
  [[nodiscard]] bool put(Job job) {
    if (at_once_) {
      done_.push_back(work_(std::move(job)));
      return true;
    }
    if (full()) return false;
    {
      const std::lock_guard lock(mutex_);
      waiting_.push_back(std::move(job));
    }
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
    there_.notify_one();
    return true;
  }
  [[nodiscard]] std::vector<Done> take() {
    std::vector<Done> out;
    const std::lock_guard lock(mutex_);
    out.swap(done_);
    return out;
  }

 private:
  void run() {
    // Where the kernel refuses, it is one thread more.
    constexpr int kNice = 10;
    static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice));
    for (;;) {
      Job job;
      {
        std::unique_lock lock(mutex_);
        there_.wait(lock, [this] { return ends_ || !waiting_.empty(); });
        if (waiting_.empty() || (ends_ && at_end_ == AtEnd::kDropped)) return;
        job = std::move(waiting_.front());
        waiting_.pop_front();
      }
      Done done = work_(std::move(job));
      const std::lock_guard lock(mutex_);
      done_.push_back(std::move(done));
    }
  }

  const std::size_t most_waiting_;
  const bool at_once_;
  const AtEnd at_end_;
  const std::function<Done(Job)> work_;
  std::mutex mutex_;
  std::condition_variable there_;
  bool ends_ = false;
  std::deque<Job> waiting_;
  std::vector<Done> done_;
  std::thread thread_;
};

}  // namespace teletact
