// What has come from the page and waits for the console's thread. The server's thread puts in, the
// console's takes out, or sleeps until there is something; each waits at most for the other's few
// pointers.
//
// Bounded: kMost acts; of `drive` and `hand` only the newest is kept, so however many come they
// take no room and delay nothing. A stop does not come through here.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

#include "tools/desk/intent.hpp"

namespace teletact {

struct DeskItem {
  enum class Kind : std::uint8_t { kAct, kJoined, kLeft };
  Kind kind = Kind::kAct;
  std::uint32_t session = 0;
  std::int64_t id = 0;
  std::int64_t arrived_ns = 0;  // by the clock that the desk was given
  Intent intent;
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
    return there_.wait_for(lock, most, [this] { return !waiting_.empty() || drive_ || hand_; });
  }
  struct Taken {
    std::deque<DeskItem> acts;  // in order
    std::optional<DeskItem> drive, hand;
  };
  [[nodiscard]] Taken take() {
    Taken out;
    const std::lock_guard lock(mutex_);
    out.acts.swap(waiting_);
    out.drive.swap(drive_);
    out.hand.swap(hand_);
    return out;
  }

 private:
  [[nodiscard]] bool keep(DeskItem item) {
    const bool act = item.kind == DeskItem::Kind::kAct;
    if (act && item.intent.act == Act::kDrive) {
      drive_ = std::move(item);
    } else if (act && item.intent.act == Act::kHand) {
      hand_ = std::move(item);
    } else {
      if (act && waiting_.size() >= kMost) return false;
      waiting_.push_back(std::move(item));
    }
    return true;
  }
  std::mutex mutex_;
  std::condition_variable there_;
  std::deque<DeskItem> waiting_;
  std::optional<DeskItem> drive_, hand_;
};

}  // namespace teletact
