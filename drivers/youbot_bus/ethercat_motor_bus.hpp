// The wheels of a youBot base on EtherCAT, as robot_io drives them (drivers/youbot/motor_bus.hpp).
//
//   sense      the inputs' frame (LRD): encoder words to wheel angles that do not wrap.
//   act        the outputs' frame (LWR): setpoints to rpm. Of both, kFrameLost: no frame, or its
//              working counter is not the expected one; `states` keeps what it had. kDown: link,
//              slaves or states are gone, or the master has stopped.
//   detail     which slave, and why, by the master's account (Master::health).
//   rearm      the operator's act: the master brings slaves back to OP, then of each drive that has
//              it latched the timeout flag is cleared (axis parameter 158) and I2t (29; a winding
//              that is still hot keeps it), one step a cycle. Until all of it is done the wheels
//              stand and take no setpoint (kRearming).
//   16 bytes   inputs of the first firmware have no room for flags 16 and 17: of such drives they
//              are asked for by mailbox (axis parameter 156), one drive after the other, and in
//              rearm() of each, after both were cleared. So they are seen up to 0.1 s later.
//   arm        each joint holds the position that it had when its drive became able to, as the arm
//              has no brakes; it is told so in every cycle, also while the wheels are off, another
//              drive is at fault or being cleared, or the bus has stopped. A joint whose drive is
//              not able (flags, or its slave not in OP) is told to stop, and takes a new position
//              when it is able again; detail() names the first such joint, and why. kFree: with
//              the wheels off, no torque instead: the arm sinks.
//   ready      wheels without commutation (flag 15) do not turn and count as kDown: finding it
//              moves them, which is for `teletact youbot setup`.
//   power      an encoder whose board had no power counts anew. Its wheel's angle goes on from
//              where it was known last: what the wheel turned meanwhile is not known.
//   make_safe  from any thread: every cycle from now on carries motor stop. If the owner hangs in
//              a cycle, no frame goes, and the slaves' watchdog (100 ms) stops the motors.
// Nothing allocates after construction.
#pragma once

#include <atomic>
#include <vector>

#include "drivers/ethercat/master.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "drivers/youbot_bus/process_data.hpp"

namespace drivers::youbot_bus {

enum class ArmRest : std::uint8_t { kHold, kFree };

struct MotorBusConfig {
  std::array<std::size_t, kWheels> slave{1, 2, 3, 4};  // of each wheel, from 0 at the master
  std::vector<std::size_t> joints;                     // of each arm joint; at most 10
  ArmRest arm_rest = ArmRest::kHold;
  // Bits of the drives' flags that are taken as 0. Sources differ on 6, 7 and 12.
  std::uint32_t ignored_flags = 0;
  int ticks_per_motor_turn = 4000;
  double gear_ratio = 9405.0 / 364.0;  // motor turns per wheel turn
};

class EtherCatMotorBus final : public MotorBus {
 public:
  // `master` is in OP, and this object's from now on. Throws std::invalid_argument for more than
  // ten joints.
  EtherCatMotorBus(rt::NonRealtime&, ethercat::Master& master, const MotorBusConfig& = {});

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  [[nodiscard]] BusDetail detail() const noexcept override { return detail_; }
  void rearm() noexcept override;
  void make_safe() noexcept override { safe_.store(true, std::memory_order_release); }

  // Flags are being cleared, or slaves brought back.
  [[nodiscard]] bool rearming() const noexcept {
    return flags_awaited_ || to_clear_ != 0 || to_look_ != 0 || master_.recovering();
  }

 private:
  void put_setpoints(const MotorSetpoints&) noexcept;
  void put_arm(bool stopped) noexcept;
  void look_at_arm() noexcept;
  [[nodiscard]] std::size_t drives() const noexcept { return kWheels + config_.joints.size(); }
  [[nodiscard]] std::size_t slave_of(std::size_t drive) const noexcept;
  // False: inputs of an unknown size.
  [[nodiscard]] bool read_drive(std::size_t drive, DriveInputs& out) const noexcept;
  void choose_clears() noexcept;
  void use_mailbox() noexcept;
  void take_answer() noexcept;
  void post_clear() noexcept;
  void post_look() noexcept;
  [[nodiscard]] BusStatus status_of(const ethercat::CycleResult&) noexcept;
  [[nodiscard]] bool take_states(rt::Time now, MotorStates&) noexcept;

  ethercat::Master& master_;
  MotorBusConfig config_;
  std::atomic<bool> safe_{false};
  bool flags_awaited_ = false;  // what rearm() has to clear shows in the next good inputs
  // What is to be cleared, a bit each: timeout flags of the drives, wheels first, then their I2t.
  unsigned to_clear_ = 0;
  int clearing_ = -1;  // the bit whose request is under way
  // Drives with inputs of 16 bytes, a bit each: all, those that rearm() still has to ask, the one
  // that is being asked, and what each said last of its latched flags.
  unsigned narrow_ = 0, to_look_ = 0;
  int looking_ = -1, looked_ = -1;
  std::array<std::uint32_t, kWheels + 10> latched_{};
  BusDetail detail_;
  bool fresh_ = false;  // the inputs are of this job
  bool ready_ = false;  // the wheels have their commutation
  std::array<bool, 10> held_{};
  std::array<std::int32_t, 10> hold_ticks_{};
  bool recovering_ = false;             // in the last job
  std::array<bool, kWheels> primed_{};  // word_ is of an earlier cycle of the same encoder
  std::uint64_t seq_ = 0;
  std::array<std::int32_t, kWheels> word_{};   // encoder, as it came last
  std::array<std::int64_t, kWheels> ticks_{};  // the same, unwrapped
};

}  // namespace drivers::youbot_bus
