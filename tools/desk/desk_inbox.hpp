// What has come from the page and waits for the console's thread. The server's thread puts in, the
// console's takes out, or sleeps until there is something; each waits at most for the other's few
// pointers.
//
// In the order in which it came: a token that lets go does not overtake the press before it.
// Bounded: kMost acts; of `drive` and `hand` only the newest between two other acts is kept, so
// however many come they take no room and delay nothing. A stop does not come through here.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>

#include "tools/desk/intents/intent.hpp"

namespace teletact {

struct DeskItem {
  enum class Kind : std::uint8_t { kAct, kJoined, kLeft };
  Kind kind = Kind::kAct;
  std::uint32_t session = 0;
  std::int64_t id = 0;
  std::int64_t arrived_ns = 0;  // by the clock that the desk was given
  Intent intent;
  std::string who;  // kJoined, kLeft: in words
};

class DeskInbox {
 public:
  static constexpr std::size_t kMost = 1024;

  // False: full.
  [[nodiscard]] bool put(DeskItem item) {
    {
      const std::lock_guard lock(mutex_);
      if (!keep(std::move(item))) return false;
    }
    there_.notify_one();
    return true;
  }
  // Until something waits, so long at most. False: nothing does.
  [[nodiscard]] bool await(std::chrono::nanoseconds most) {
    std::unique_lock lock(mutex_);
    return there_.wait_for(lock, most, [this] { return !waiting_.empty(); });
  }
  [[nodiscard]] std::deque<DeskItem> take() {
    std::deque<DeskItem> out;
    const std::lock_guard lock(mutex_);
    out.swap(waiting_);
    acts_ = 0;
    return out;
  }

 private:
  [[nodiscard]] static bool newest_wins(const DeskItem& item) {
    return item.kind == DeskItem::Kind::kAct &&
           (item.intent.act == Act::kDrive || item.intent.act == Act::kHand);
  }
  [[nodiscard]] bool keep(DeskItem item) {
    if (newest_wins(item)) {
      for (auto last = waiting_.rbegin(); last != waiting_.rend() && newest_wins(*last); ++last) {
        if (last->intent.act != item.intent.act) continue;
        *last = std::move(item);
        return true;
      }
    } else if (item.kind == DeskItem::Kind::kAct && acts_++ >= kMost) {
      acts_ = kMost;
      return false;
    }
    waiting_.push_back(std::move(item));
    return true;
  }
  std::mutex mutex_;
  std::condition_variable there_;
  std::deque<DeskItem> waiting_;
  std::size_t acts_ = 0;  // that wait, and are no `drive` or `hand`
};

}  // namespace teletact
