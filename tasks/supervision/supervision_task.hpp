// Modes and health, 100 Hz, on both boxes. The only writer of Mode.
//
//   reads   Health and heartbeat of every task of this box, liveness of the link, mode of the peer,
//           e-stop input, requests (engage, ramp down, stop, clear)
//   writes  Latest<ModeMsg>   to haptic, prediction, planning; on the robot to robot_io
//   budget  50 us of the 10 ms period
//
//   kInit ──every task heard──▶ kHold ──engage──▶ kEngaged ──fault, request──▶ kRampDown
//   kRampDown ──ramp──▶ kHold
//     any mode ──safe-stop fault, stop request──▶ kSafeStop ──clear, causes gone──▶ kHold
//
// Faults are ordered data (fault_ids.hpp): the worst wins. Within an episode (from one engage, or
// from a stop, to the act that ends it) severity only grows; recovery is an act, never a timeout:
// a rising engage from kHold, or clear from kSafeStop. One exception: a silence of the link alone,
// of at most resume_within_s, on one and the same connection, with the operator's engage held all
// the time. Outputs ramp down as ever, and the act that is still held goes on (Mode::kEngaged
// again). An engage or a clear must be seen as "no" before a "yes" counts, so a switch left on, or
// a link that comes back, starts nothing. The robot's box, in hold, counts a "yes" to engage also
// where such a silence, and nothing else, lies between it and the "no". A clear counts while it is
// pressed, for the first safe stop only: devices that latch need a few ticks to reset. The
// operator's acts reach the robot's box with the goal.
#pragma once

#include <array>
#include <cstdint>

#include "config/schema.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/mode_gate.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/supervision/fault_ids.hpp"

namespace tasks {

// Section [supervision].
struct SupervisionConfig {
  double ramp_s = 0.2;  // time in kRampDown before kHold
  // A longer silence of the link is a fault, on either box.
  double link_liveness_s = limit_of(EdgeId::kRobotState, TaskId::kSupervision).liveness_ms / 1000.0;
  // A silence of at most this ends no engagement whose act is held. 0: each one does.
  double resume_within_s = 1.0;
  double peer_grace_s = 1.0;       // after engage, time for the peer to follow
  double estop_liveness_s = 0.05;  // age of the e-stop input beyond it counts as pressed

  void describe(config::Section& s);
};

// One task to watch.
struct Watch {
  rt::FaultId silent_fault = rt::kNoFault;  // raised when the heartbeat is older than `liveness`
  rt::Nanos liveness{0};
};

class SupervisionTask {
 public:
  static constexpr int kMaxTasks = 16;

  // kPaused, to the robot alone: the operator's box is out of the engaged mode because of a silence
  // alone, holds the act, and may go on.
  enum class Engage : std::uint8_t { kAbsent, kNo, kYes, kPaused };
  // The robot is out of the engaged mode because of a silence alone, and may go on: it is silent
  // there still, or heard again (RobotState::pauses).
  enum class Pause : std::uint8_t { kNone, kSilent, kHears };
  enum class Clear : std::uint8_t { kAbsent, kNo, kYes };
  struct TaskReport {
    bool heard = false;    // has published at least once
    rt::Time heartbeat{};  // end of its newest job
    rt::Health health;     // of its newest job
  };
  struct Requests {
    Engage engage = Engage::kAbsent;  // level; only kNo, then kYes is an act
    bool ramp_down = false;           // level; SIGINT, SIGTERM, operator
    bool stop = false;                // level
    Clear clear = Clear::kAbsent;     // level; only kNo -> kYes is an act, until it is let go
  };
  struct In {
    std::array<TaskReport, kMaxTasks> tasks{};  // in the order of the watches
    bool link_expected = false;                 // this box has a peer
    bool link_heard = false;
    rt::Time link_last{};       // newest valid message of the peer
    bool link_refused = false;  // hand-shake failed: schema or version differ
    bool link_closed = false;   // the connection has ended: as silent, at once
    // Number of the connection. One that follows another ends what was engaged over it, also where
    // the end between them was too short to be seen as `link_closed`.
    std::uint64_t link_session = 0;
    Mode peer_mode = Mode::kInit;     // newest, meaningful while the link is live
    rt::Time peer_mode_at{};          // when it was so, in this box's time; operator box
    Pause peer_pause = Pause::kNone;  // operator box
    bool estop_fitted = false;
    // false: pressed or wire broken. For an input of supervision's own: the nodes of this stack
    // leave it, for robot_io samples the emergency stop and reports a press as its own fault.
    bool estop_closed = true;
    rt::Time estop_sampled{};
    bool watchdog_bit = false;  // the executor's watchdog has made something safe
    Requests requests;
  };
  struct Out {
    ModeMsg mode;
    rt::Health now;               // worst condition of this tick
    rt::Health episode;           // worst of the episode; severity never falls within one
    bool engage_refused = false;  // an engage came and was not followed
  };

  // `box` decides who leads: the robot follows the operator's engage and ramps down when it is
  // withdrawn; the operator ramps down when the robot has not followed, or left.
  // `gate`: the mode changes that the host has room for, by number of Mode; asked before each
  // engage. The other modes are never refused, since a host without room for one of them does not
  // start.
  SupervisionTask(rt::NonRealtime&, const SupervisionConfig&, rt::Box box, const Watch* watches,
                  int watch_count, const rt::ModeGate& gate = {});

  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

  // Times each fault began (condition became true), by row of kFaultTable.
  [[nodiscard]] std::uint32_t count(rt::FaultId id) const noexcept;

 private:
  struct Conditions {
    rt::Health worst;                                  // that a mode answers to
    std::array<rt::Severity, kFaultCount> severity{};  // kOk: not active
  };
  void gather(rt::Time now, const In& in, Conditions& c) const noexcept;
  [[nodiscard]] bool link_changed(const In& in) noexcept;
  void keep_resuming(rt::Time now, const In& in, const Conditions& c, bool changed) noexcept;
  [[nodiscard]] bool peer_pauses(const In& in) const noexcept;
  [[nodiscard]] static bool silence_alone(const Conditions& c, bool paused) noexcept;
  [[nodiscard]] bool may_resume(rt::Time now, const In& in, const rt::Health& worst) const noexcept;
  static void raise(Conditions& c, rt::FaultId id, rt::Severity reported) noexcept;
  void count_and_latch(const Conditions& c) noexcept;
  void enter(Mode mode, rt::FaultId cause, rt::Time now) noexcept;
  bool go(rt::Time now) noexcept;  // into the engaged mode; true
  [[nodiscard]] rt::FaultId restart_fault() const noexcept;
  void stop_safely(rt::FaultId cause, rt::Time now) noexcept;
  [[nodiscard]] bool change_mode(rt::Time now, const In& in, const rt::Health& worst,
                                 bool engage) noexcept;
  [[nodiscard]] bool may_engage(rt::Time now, const In& in, const rt::Health& worst) const noexcept;
  [[nodiscard]] bool take_engage(rt::Time now, const In& in, const Conditions& c,
                                 bool changed) noexcept;
  void take_clear(rt::Time now, const In& in) noexcept;
  void acknowledge(const Conditions& c) noexcept;
  [[nodiscard]] bool held_back() const noexcept;
  [[nodiscard]] bool has_room(Mode mode) const noexcept {
    return gate_.may_enter(static_cast<std::size_t>(mode_), static_cast<std::size_t>(mode));
  }
  [[nodiscard]] bool link_live(rt::Time now, const In& in) const noexcept;
  [[nodiscard]] bool peer_left(rt::Time now, const In& in) const noexcept;
  void note_peer(rt::Time now, const In& in) noexcept;
  [[nodiscard]] bool all_heard(const In& in) const noexcept;

  SupervisionConfig config_;
  rt::Box box_;
  std::array<Watch, kMaxTasks> watches_{};
  int watch_count_ = 0;
  rt::ModeGate gate_;

  Mode mode_ = Mode::kInit;
  rt::FaultId cause_ = rt::kNoFault;
  rt::Time entered_{};
  rt::Health episode_;
  std::array<bool, kFaultCount> was_active_{};
  std::array<bool, kFaultCount> latched_{};  // waits for the operator, or for a restart
  std::array<std::uint32_t, kFaultCount> counts_{};
  bool released_ = false;  // the engage was last seen as "no", released_at_
  rt::Time released_at_{};
  Clear last_clear_ = Clear::kAbsent;  // a clear that is on at the start is no act
  bool clearing_ = false;              // pressed, and not yet let go
  bool clear_open_ = false;            // and no safe stop has begun or ended since
  bool peer_followed_ = false;
  rt::Time peer_engaged_{};  // when it last was, since it followed
  std::uint64_t seq_ = 0;
  std::uint64_t link_session_ = 0;  // newest seen; 0: none yet
  bool resumes_ = false;            // ramped down by a silence alone, and the act is held
  rt::Time quiet_from_{};           // when the link was last heard before it
};

}  // namespace tasks
