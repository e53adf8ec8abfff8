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

class MotorBus {
 public:
  virtual ~MotorBus() = default;
  // The first half of a cycle. `states` is untouched unless kOk.
  [[nodiscard]] virtual BusStatus sense(rt::Time now, MotorStates& states) noexcept = 0;
  // The second half, not before the first: the setpoints are with the motors when it returns kOk.
  // kFrameLost: they may be or not, and the motors go on with what they have.
  [[nodiscard]] virtual BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept = 0;
  // The operator's clear: resets the motors' latched traffic timeout (SAP 158) and make_safe().
  // Owner's thread.
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
