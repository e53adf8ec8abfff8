// What has come from the page and waits for the console's thread. The server's thread puts in, the
// console's takes out; each waits at most for the other's few pointers.
//
// Bounded: kMost acts; of `drive` and `hand` only the newest is kept, so however many come they
// take no room and delay nothing. A stop does not come through here.
#pragma once

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
    const std::lock_guard lock(mutex_);
    if (item.kind == DeskItem::Kind::kAct) {
      if (item.intent.act == Act::kDrive) return keep(drive_, std::move(item));
      if (item.intent.act == Act::kHand) return keep(hand_, std::move(item));
      if (waiting_.size() >= kMost) return false;
    }
    waiting_.push_back(std::move(item));
    return true;
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
  static bool keep(std::optional<DeskItem>& newest, DeskItem item) {
    newest = std::move(item);
    return true;
  }
  std::mutex mutex_;
  std::deque<DeskItem> waiting_;
  std::optional<DeskItem> drive_, hand_;
};

}  // namespace teletact
