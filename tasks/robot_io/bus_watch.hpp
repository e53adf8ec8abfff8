// What the motor bus and the motors behind it mean for the base.
//
//   a cycle without a frame, or with a wrong working counter    counted; many in a row: safe stop
//   link down, slaves missing, a slave that left OP, a wheel
//   without commutation, or down without more                   safe stop
//   CAN: bus-off, interface down, send queue full, a module
//   that is silent, or refuses what it is told                  safe stop
//   a motor's own fault, its I2t limit, its timeout             safe stop
//   a joint of the arm that its drive can not hold              safe stop
//   motors that the executor has stopped (make_safe): too many
//   misses, or a job that hung                                  safe stop
//   told to turn, and the encoder stands for 100 ms             safe stop
//
// Such a joint sinks, as the arm has no brakes: its base is not to drive on below it.
// A cycle is bad when either of its frames is: this job's read, or the write before it.
// Encoder: a wheel that for 100 ms of good cycles was told at least 0.5 rad/s (2.4 cm/s at the rim)
// and has not turned by 1 mrad (twenty encoder steps; 50 are due at the least). A wheel that is
// blocked looks the same, and is to stop as well. A base that stands at a wall while its wheels
// turn is none of it.
#pragma once

#include <array>

#include "drivers/youbot/motor_bus.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"

namespace tasks {

namespace robot_io_fault {
inline constexpr rt::FaultId kFrameLost = 501;       // one bus frame: counted
inline constexpr rt::FaultId kBusDown = 502;         // many in a row or bus down: safe stop
inline constexpr rt::FaultId kMotorTimeout = 506;    // flag bit 16: motors off until cleared
inline constexpr rt::FaultId kWorkingCounter = 510;  // counted
inline constexpr rt::FaultId kSlaveState = 511;      // safe stop, and all below
inline constexpr rt::FaultId kSlavesMissing = 512;
inline constexpr rt::FaultId kBusLinkDown = 513;
inline constexpr rt::FaultId kEncoderStands = 514;
inline constexpr rt::FaultId kI2tExceeded = 515;
inline constexpr rt::FaultId kMotorFault = 516;
inline constexpr rt::FaultId kNotCommutated = 517;
}  // namespace robot_io_fault

// Who it is, for the log.
struct BusReport {
  rt::FaultId fault = rt::kNoFault;
  drivers::BusDetail detail;  // of a fault of the bus
  int wheel = -1;             // of a fault of a motor: 0 to 3
  std::uint32_t flags = 0;    // of that motor
};

// Of the arm, of a CAN bus, and of the executor; each is a safe stop.
namespace robot_io_fault {
inline constexpr rt::FaultId kJointUnable = 531;
inline constexpr rt::FaultId kBusOff = 526;
inline constexpr rt::FaultId kModuleSilent = 527;
inline constexpr rt::FaultId kQueueFull = 528;
inline constexpr rt::FaultId kInterfaceDown = 529;
inline constexpr rt::FaultId kModuleRefuses = 530;
inline constexpr rt::FaultId kMadeSafe = 532;
}  // namespace robot_io_fault

class BusWatch {
 public:
  explicit BusWatch(int frames_lost_limit) noexcept : limit_(frames_lost_limit) {}

  // This job's cycle.
  [[nodiscard]] rt::Health cycle(drivers::BusStatus read, drivers::BusStatus sent,
                                 const drivers::BusDetail&) noexcept;
  // After a good read: the motors under what they were told by the job before.
  [[nodiscard]] rt::Health motors(const rt::Tick&, const drivers::MotorStates&) noexcept;
  void told(const drivers::MotorSetpoints& s) noexcept { told_ = s; }

  [[nodiscard]] bool is_down() const noexcept { return bad_in_row_ >= limit_; }
  [[nodiscard]] std::uint64_t bad_cycles() const noexcept { return bad_; }
  // Of this job; no fault: nothing to say.
  [[nodiscard]] const BusReport& report() const noexcept { return report_; }

 private:
  struct Standing {
    double anchor_rad = 0;
    rt::Nanos told_for{-1};  // below zero: not told to turn
  };
  [[nodiscard]] int standing_wheel(const rt::Tick&, const drivers::MotorStates&) noexcept;

  int limit_;
  int bad_in_row_ = 0;
  std::uint64_t bad_ = 0;
  bool takes_setpoints_ = false;
  drivers::MotorSetpoints told_;
  std::array<Standing, drivers::kWheels> standing_{};
  BusReport report_;
};

}  // namespace tasks
