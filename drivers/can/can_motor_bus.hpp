// Four wheel motors behind TMCL modules on a CAN bus, as robot_io drives them (MotorBus).
//
// A bus of 1 Mbit/s carries about four requests with their replies a millisecond, and a module
// takes one request at a time. So each job asks three of the modules, in turn, each by a rota:
//
//   setpoint, position, setpoint, speed, setpoint, position, ... and now and then flags or current
//
// A setpoint goes out at most four jobs after act() got it, motor stop in the same job.
// Replies are read in the next job: a position is up to nine jobs old, `taken` is the oldest one's.
//
//   kFrameLost   a module did not answer in time, or the queue took no frame; states keep what they
//                had
//   kDown        the bus is off, the interface down, the queue full for `full_jobs`, a module has
//                told no position for `silent_jobs`, or refuses what it is told to do (it would
//                turn on at its last speed).
//                Latched: until rearm(), and then until every position and speed has been read
//                anew and the latches have been looked after, only motor stop is sent, and detail()
//                says why, by what came first
//   rearm        The operator's act. A module whose flags (parameter 156) have a latch, and after a
//                bus that was down every module: its flags are read, what is latched is cleared (a
//                timeout by parameter 158, I2t by 29; a winding that is still hot keeps it), and
//                they are read again, and then every module's speed. Until then the wheels take no
//                setpoint (kRearming).
//   make_safe    motor stop to every module at once from the calling thread, and from then on
// Nothing allocates after construction.
#pragma once

#include <array>
#include <atomic>
#include <vector>

#include "config/schema.hpp"
#include "drivers/can/can_port.hpp"
#include "drivers/tmcl/tmcl_can.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::can {

// Section [robot.bus.can].
struct CanMotorConfig {
  std::string iface = "can0";
  // Of the wheels front left, front right, back left, back right: each module's own identifier
  // (global parameter 71), and the address byte in its replies. Default: as identifiers.
  std::array<double, kWheels> request_ids{1, 3, 5, 7};
  std::array<double, kWheels> module_addresses{1, 3, 5, 7};
  int reply_id = 2;  // global parameter 70, the same for all
  int ticks_per_motor_turn = 4000;
  double gear_ratio = 9405.0 / 364.0;  // motor turns per wheel turn; no key: robot_io.base has it
  int requests_per_job = 3;            // leaves a quarter of a bus of 1 Mbit/s free
  double reply_ms = 5;                 // a reply that comes later was lost
  int silent_jobs = 100;               // without a position of a module: the bus is down
  int full_jobs = 20;                  // queue full in a row: the same

  void describe(config::Section& s);
};

class CanMotorBus final : public MotorBus {
 public:
  // `port` outlives this object. Throws std::invalid_argument with one line if two modules share
  // an identifier or an address.
  CanMotorBus(rt::NonRealtime&, CanPort& port, const CanMotorConfig& = {});

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  [[nodiscard]] BusDetail detail() const noexcept override { return detail_; }
  void rearm() noexcept override;
  void make_safe() noexcept override;

  struct Counters {
    std::uint64_t requests = 0, replies = 0;
    std::uint64_t late = 0;     // replies that never came in time
    std::uint64_t refused = 0;  // a module answered with another status than 100
    std::uint64_t strange = 0;  // frames that answer nothing that was asked
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }
  // The reply identifiers to open a port with.
  [[nodiscard]] static std::vector<std::uint32_t> receive_ids(const CanMotorConfig&);

 private:
  enum class Ask : std::uint8_t { kSetpoint, kPosition, kSpeed, kFlags, kCurrent, kClear };
  // What rearm() has begun with a module, in its order.
  enum class Latches : std::uint8_t { kNone, kLook, kClear, kLookAgain, kPace };
  struct Module {
    std::uint32_t id = 0;
    std::uint8_t address = 0;
    tmcl::Request asked;
    Ask kind = Ask::kSetpoint;
    bool waiting = false;
    bool driven = false;  // the last setpoint that went out was not motor stop
    rt::Time asked_at{};
    rt::Time ask_from{};  // parameters; setpoints go out before
    int silent = 0;       // jobs without a position
    unsigned turn = 0;
    // Position and speed were read since the start or the last rearm().
    bool placed = false, paced = false;
    bool refuses = false;  // its last setpoint or motor stop
    std::int32_t word = 0;
    std::int64_t ticks = 0;
    bool unwrapped = false;
    rt::Time placed_at{};
    double rad_per_s = 0, current_A = 0;
    std::uint32_t flags = 0;
    Latches latches = Latches::kNone;
    bool looked = true;          // since a bus that was down was rearmed
    std::uint32_t to_clear = 0;  // bits of flags
  };
  void take_replies(rt::Time now) noexcept;
  void take_reply(const Received&) noexcept;
  void keep(Module&, const tmcl::Reply&, rt::Time at) noexcept;
  void ask_all(rt::Time now, const MotorSetpoints&) noexcept;
  [[nodiscard]] static Ask next_kind(const Module&, unsigned turn) noexcept;
  [[nodiscard]] tmcl::Request next_request(Module&, double rpm, bool drive,
                                           bool setpoint) const noexcept;
  // An answer to a look at the flags, or to a clear, has come: whatever it was.
  void go_on(Module&) noexcept;
  [[nodiscard]] bool drop_late(rt::Time now) noexcept;
  [[nodiscard]] bool all_known() const noexcept;
  [[nodiscard]] bool rearming() const noexcept;
  [[nodiscard]] BusDetail trouble() noexcept;
  void look_at_bus() noexcept;
  void write_states(rt::Time now, MotorStates&) noexcept;
  [[nodiscard]] CanFrame stop_frame(const Module&) const noexcept;

  CanPort& port_;
  CanMotorConfig config_;
  rt::Nanos reply_limit_;
  std::array<Module, kWheels> modules_{};
  std::array<Received, 64> in_{};
  std::array<CanFrame, kWheels> stop_{};  // for make_safe(): never written after construction
  std::atomic<bool> safe_{false};
  bool down_ = false;      // latched
  BusDetail why_;          // of down_; kept behind it until all is known again
  BusDetail detail_;       // of the last half of a cycle
  std::size_t first_ = 0;  // module whose turn it is
  int full_ = 0;
  std::uint64_t bus_offs_ = 0;  // of the port's, those that were acted on
  std::uint64_t seq_ = 0;
  Counters counters_;
};

}  // namespace drivers::can
