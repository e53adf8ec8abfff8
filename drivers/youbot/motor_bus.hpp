// The four wheel motors of a youBot base, as robot_io drives them. A cycle a job: sense() at its
// beginning reads the states, act() at its end writes the setpoints, so what a job decides is on
// the wire in that job. What carries it (EtherCAT master, virtual robot) is the implementation's
// business.
//
// Wheel order: 0 front left, 1 front right, 2 back left, 3 back right. Signs as in the youBot's own
// wiring: the kinematics carries them (drivers/youbot/mecanum.hpp).
#pragma once

#include <array>
#include <cstdint>

#include "rt/time.hpp"

namespace drivers {

inline constexpr int kWheels = 4;

enum class MotorMode : std::uint8_t { kStop = 0, kVelocity = 2 };  // youBot controller modes

struct MotorSetpoints {
  MotorMode mode = MotorMode::kStop;
  std::array<double, kWheels> wheel_rad_per_s{};
};

struct MotorStates {
  std::uint64_t seq = 0;
  rt::Time taken{};
  std::array<double, kWheels> wheel_rad{};  // unwrapped
  std::array<double, kWheels> wheel_rad_per_s{};
  std::array<double, kWheels> current_A{};
  std::array<std::uint32_t, kWheels> flags{};  // youBot error and status word
};

enum class BusStatus : std::uint8_t { kOk, kFrameLost, kDown };

// What is wrong with the bus, as far as that can tell which carries it.
enum class BusTrouble : std::uint8_t {
  kNone,            // nothing, or it can not tell
  kFrameLost,       // no frame came back
  kWorkingCounter,  // a frame came back that not every slave took
  kLinkDown,        // no frame can be sent
  kSlavesMissing,   // from `slave` on nobody answers
  kSlaveState,      // `slave` is not in OP
  kNotReady,        // a wheel does not know its commutation
  kRearming,        // status kOk: latches are being cleared, the wheels take no setpoint yet
  // Of a CAN bus. `slave` is the module: wheel 1 to 4.
  kBusOff,         // the controller has switched itself off
  kModuleSilent,   // `slave` tells no position
  kQueueFull,      // frames do not leave: nobody acknowledges them
  kInterfaceDown,  // the interface is down, or gone
  kModuleRefuses,  // `slave` does not take what it is told to do
  // Status kOk: `slave` is a joint of an arm, and its drive can not hold it.
  kJointNotCommutated,
  kJointTimeout,
  kJointI2t,
  kJointFault,  // its drive's own fault
  // Status kOk: make_safe() was called, and the wheels take no setpoint until rearm().
  kMadeSafe
};
struct BusDetail {
  BusTrouble trouble = BusTrouble::kNone;
  std::int16_t slave = 0;      // counted from 1; 0: not known, or of none
  std::uint16_t al_state = 0;  // kSlaveState: registers 0x0130 and 0x0134 of that slave
  std::uint16_t al_code = 0;
  friend bool operator==(const BusDetail&, const BusDetail&) = default;
};

class MotorBus {
 public:
  virtual ~MotorBus() = default;
  // The first half of a cycle. `states` has a new `seq` if they are of this job, and is untouched
  // otherwise. With kOk they are of this job. With kDown they are, where the bus still tells what
  // the wheels do.
  [[nodiscard]] virtual BusStatus sense(rt::Time now, MotorStates& states) noexcept = 0;
  // The second half, not before the first: the setpoints are with the motors when it returns kOk.
  // kFrameLost: they may be or not, and the motors go on with what they have.
  [[nodiscard]] virtual BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept = 0;
  // Of the half of a cycle that was made last.
  [[nodiscard]] virtual BusDetail detail() const noexcept { return {}; }
  // The operator's clear: resets the motors' latched traffic timeout (SAP 158), make_safe(), and
  // what else they have latched. Called again while that goes on, it changes nothing. Owner's
  // thread.
  virtual void rearm() noexcept {}
  // Motor stop, at once, from any thread, even while the owner hangs in a cycle.
  virtual void make_safe() noexcept = 0;

  // Both halves at one instant, for a caller without a job in between.
  [[nodiscard]] BusStatus exchange(rt::Time now, const MotorSetpoints& setpoints,
                                   MotorStates& states) noexcept {
    const BusStatus in = sense(now, states);
    const BusStatus out = act(now, setpoints);
    return in != BusStatus::kOk ? in : out;
  }
};

}  // namespace drivers
