// What a youBot needs before it is driven, and what a person does with it at the bench.
//
//   check      reads: firmware, flags, voltage, temperature, commutation, homing. Moves nothing.
//   commutate  flags cleared, then every drive that does not know its commutation finds it: mode 7,
//              on firmware 2.00 a slow velocity until flag 15 shows. Wheels and joints may move a
//              little.
//   home_arm   all joints at once toward their stops at 6 degrees a second, in the raw direction
//              that counts up, until a joint stands and its current is beyond its limit for 10 ms;
//              then its torque is taken away for 100 ms and its encoder set to 0 there. Its angles
//              are below zero afterwards, and it is held.
//   jog        one drive at a speed (of wheel or joint, in its own direction) for a time; joints
//              only once they are homed, within their limits and up to their speed. It is braked
//              where the drive's own acceleration (axis parameter 11) still ends within the limit.
// Source: youbot_driver, YouBotManipulator.cpp (order, speeds, currents) and its config files; the
// standstill beside the current is ours: the current of a start is not a stop.
// Joints that are not moved hold where they are as soon as their commutation is known, also after
// a failure: the arm has no brakes. Wheels are off.
// Nothing here asks a person: the caller does, before commutate(), home_arm() and jog().
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "drivers/youbot_bus/calibration_file.hpp"
#include "drivers/youbot_bus/drive_session.hpp"

namespace drivers::youbot_bus {

struct DriveReport {
  std::size_t position = 0;  // on the bus
  std::string name;
  // What the board did not tell: controller 0, NaN, and -1 of the greatest current.
  tmcl::Firmware firmware;
  std::uint32_t flags = 0;
  double supply_V = 0, temperature_C = 0;
  std::int32_t position_ticks = 0, current_mA = 0;
  std::int32_t max_current_mA = 0;  // axis parameter 6
  bool commutated = false;
  bool homed = false;  // joints alone
  // What it did not tell, and why; what has to be done before it is driven. Empty: nothing.
  std::string wrong;
};

// A row for each drive, also for one that tells nothing. The error: the bus has failed.
[[nodiscard]] rt::Result<std::vector<DriveReport>> check(DriveSession&);

// "joint 3 has its stop"
using Progress = std::function<void(const std::string&)>;
[[nodiscard]] rt::Result<bool> clear_timeouts(DriveSession&);
// Of drives that have I2t latched (flag 17): how many it was cleared of (axis parameter 29). A
// winding that is still hot keeps it.
[[nodiscard]] rt::Result<int> clear_i2t(DriveSession&);
// The first drive that may take more (axis parameter 6, which a password of the maker protects), in
// words; empty: none.
[[nodiscard]] rt::Result<std::string> above_current(DriveSession&, std::int32_t most_mA);
[[nodiscard]] rt::Result<bool> commutate(DriveSession&, const Progress&);
// `measured`: the joints of this arm are appended, once all have their stops.
[[nodiscard]] rt::Result<bool> home_arm(DriveSession&, int arm, const Progress&,
                                        std::vector<HomedJoint>* measured = nullptr);
[[nodiscard]] rt::Result<bool> jog(DriveSession&, std::size_t position, double rad_per_s,
                                   double seconds);

// Turns of the motor for one of the joint (1 to 5), and its limits in raw ticks once it is homed.
struct JointFacts {
  double gear = 156;
  std::int32_t low_ticks = 0, high_ticks = 0;
  std::int32_t homing_mA = 500;
  int sign = -1;  // of a positive angle on the wire
  // config/robots/youbot.toml, max_speed: 90 degrees a second (operating instructions, URDF).
  double most_rad_per_s = 1.5708;
};
[[nodiscard]] const JointFacts& joint_facts(int number) noexcept;
// What jog() takes: a joint's own limit; of a wheel 3 rad/s, the bench's.
[[nodiscard]] double most_jog_rad_per_s(const BoardPlace&) noexcept;
// Motor turns for one of the wheel or joint.
[[nodiscard]] double gear_of(const BoardPlace&) noexcept;

}  // namespace drivers::youbot_bus
