// A haptic device, as the haptic task drives it: read the position, compute, write the force, all
// in one job of one thread (one tick of delay costs a factor of three in stiffness).
//
// Frames: D haptic base, H stylus tip. SI units, right-handed. The driver turns the device's own
// axes into D: x away from the operator, y to the operator's left, z up, origin at the workspace
// centre.
#pragma once

#include <cstdint>
#include <limits>

#include "perception/geometry/pose.hpp"
#include "rt/time.hpp"

namespace drivers {

// Controller states of Force Dimension devices.
enum class DeviceState : std::uint8_t { kReset, kIdle, kForce, kBrake };

// Why the forces are off (as the vendor's status reports it).
enum class ForceOffCause : std::uint8_t {
  kNone,
  kButton,
  kVelocity,
  kWatchdog,
  kSoftware,
  kDisconnect
};

struct StylusSample {
  std::uint64_t seq = 0;  // sample number of the device
  rt::Time taken{};
  perception::Vec3 p_DH = perception::Vec3::Zero();  // m
  bool button = false;                               // stylus button: "mark"
  DeviceState state = DeviceState::kReset;
  bool repeated = false;  // the device had no new data: same position again
  bool clutch = false;    // second button, held: the workspace is moved, not the hand in the scene
};

struct ForceCommand {
  perception::Vec3 f_H_D = perception::Vec3::Zero();  // force on the hand, N, in D
};

struct DeviceProperties {
  double mass_kg = 0.2;            // effective mass at the tip
  double damping_N_s_per_m = 2.0;  // b
  double coulomb_N = 0.1;          // c
  double delay_s = 0.0;            // t_d from position sample to force, beyond the hold
  double quantum_m = 1e-5;
  double force_limit_N = 12.0;
  double workspace_radius_m = 0.075;
  double speed_limit_m_per_s = 1.0;  // over it the controller brakes
  // b is the twin's own, or was measured: what it dissipates is credited to the loop
  // (tasks/haptic/energy.hpp).
  bool damping_known = false;
  bool measured = false;      // mass, damping and friction: measured on the device, not assumed
  bool renders_force = true;  // false: a pointer; commands are dropped
  // Largest stiffness the loop may render: K = 0.8 b / (T/2 + t_d)  (docs/devices.md).
  [[nodiscard]] double stiffness_limit(double period_s) const noexcept {
    if (!renders_force) return std::numeric_limits<double>::infinity();
    return 0.8 * damping_N_s_per_m / (period_s / 2 + delay_s);
  }
};

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;
  [[nodiscard]] virtual DeviceProperties properties() const noexcept = 0;
  // Reads the newest sample. False: the device gave none (unplugged, not started): `out` is
  // untouched.
  [[nodiscard]] virtual bool sense(rt::Time now, StylusSample& out) noexcept = 0;
  // Sends a force. The driver clips the sum with gravity compensation to its force limit.
  virtual void act(rt::Time now, const ForceCommand& command) noexcept = 0;
  // Asks for forces again after a brake (the operator's act, like the button on the base); any
  // thread. The owner's next sense() carries it out.
  virtual void request_enable() noexcept {}
  // Forces off, at once, from any thread, even while the owner hangs in sense() or act().
  virtual void make_safe() noexcept = 0;
};

}  // namespace drivers
