// Which of the operator's goals the robot's box takes. Every goal carries its number, when it was
// made and until when it is valid; the link adds the number of the message. Instants are in this
// box's clock, and `unsure` by how much they may be wrong.
//
//   replayed      the message came before, or one that was sent later did
//   reordered     made before a goal that was taken on this connection
//   out of range  no robot of this stack can mean it (kCommandRange), or it is to be valid too long
//   from ahead    made later than now, beyond doubt: the clocks, or the sender, are wrong
//   late          perhaps no longer valid
//
// The first four are refused: the robot's box keeps the goal that it has, and that one expires. A
// late one is handed on, since what it says of the operator's acts (engage, clear) is newer than
// what the box knows; it moves nothing (robot_io, F-RIO-03 of docs/faults.md). All are counted, and
// the counts are sent to the operator's box (CommandReport).
//
// Pure; one thread: that of the link.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "drivers/link/messages.hpp"
#include "drivers/link/wire.hpp"

namespace drivers {

enum class CommandFault : std::uint8_t {
  kNone,
  kReplayed,
  kReordered,
  kOutOfRange,
  kFromAhead,
  kLate,
};
inline constexpr int kCommandFaults = 6;
[[nodiscard]] constexpr const char* to_text(CommandFault f) noexcept {
  constexpr const char* kText[kCommandFaults] = {
      "", "replayed", "out of order", "out of range", "made in the future", "too late"};
  return kText[static_cast<std::size_t>(f)];
}

struct CommandRange {
  double place_m = 10000;  // |x|, |y| of X_OB
  double yaw_rad = 100;
  double speed_m_per_s = 5, yaw_rate_rad_per_s = 10;  // also of the limit that it sets
  rt::Nanos life = std::chrono::seconds{5};           // as prediction.goal_valid_ms at most
};
inline constexpr CommandRange kCommandRange{};

class CommandGate {
 public:
  // A new connection: another box may be there, which counts from one.
  void renew() noexcept {
    newest_message_ = newest_goal_ = 0;
    newest_made_ = {};
    any_ = false;
  }

  // message_seq: of the message that brought the goal, from 1 on.
  [[nodiscard]] CommandFault judge(const RobotGoal& goal, std::uint64_t message_seq, rt::Time now,
                                   rt::Nanos unsure) noexcept {
    const CommandFault fault = fault_of(goal, message_seq, now, unsure);
    if (fault == CommandFault::kNone || fault == CommandFault::kLate) {
      any_ = true;
      newest_message_ = message_seq;
      newest_goal_ = goal.seq;
      newest_made_ = goal.made;
    }
    if (fault != CommandFault::kNone) {
      ++report_.counts[static_cast<std::size_t>(fault)];
      report_.newest = static_cast<std::uint8_t>(fault);
    }
    return fault;
  }

  // Since the box started; newest: the last fault.
  struct Report {
    std::array<std::uint64_t, kCommandFaults> counts{};  // by CommandFault
    std::uint8_t newest = 0;
    [[nodiscard]] std::uint64_t all() const noexcept {
      std::uint64_t n = 0;
      for (const std::uint64_t c : counts) n += c;
      return n;
    }
  };
  [[nodiscard]] const Report& report() const noexcept { return report_; }

 private:
  [[nodiscard]] static bool within(double v, double most) noexcept {
    return std::isfinite(v) && std::abs(v) <= most;
  }
  [[nodiscard]] static bool in_range(const RobotGoal& g) noexcept {
    const CommandRange& r = kCommandRange;
    return within(g.x_m, r.place_m) && within(g.y_m, r.place_m) && within(g.yaw_rad, r.yaw_rad) &&
           within(g.vx, r.speed_m_per_s) && within(g.vy, r.speed_m_per_s) &&
           within(g.wz, r.yaw_rate_rad_per_s) && within(g.speed_limit_m_per_s, r.speed_m_per_s) &&
           g.speed_limit_m_per_s >= 0 && g.valid_until >= g.made &&
           g.valid_until - g.made <= r.life;
  }
  [[nodiscard]] CommandFault fault_of(const RobotGoal& g, std::uint64_t message_seq, rt::Time now,
                                      rt::Nanos unsure) const noexcept {
    if (any_ && message_seq <= newest_message_) return CommandFault::kReplayed;
    if (any_ && (g.seq < newest_goal_ || g.made < newest_made_ - unsure))
      return CommandFault::kReordered;
    if (!in_range(g)) return CommandFault::kOutOfRange;
    if (g.made > now + unsure + kAhead) return CommandFault::kFromAhead;
    if (now + unsure > g.valid_until) return CommandFault::kLate;
    return CommandFault::kNone;
  }

  bool any_ = false;
  std::uint64_t newest_message_ = 0, newest_goal_ = 0;
  rt::Time newest_made_{};
  Report report_;
};

}  // namespace drivers
