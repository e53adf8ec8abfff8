// Twin of an Omega.3 with a hand on it.
//
// Mechanics  StylusPlant: a point mass with friction and a scripted hand, integrated lazily.
// States     RESET (not calibrated) -> IDLE (reads only) -> FORCE; BRAKE with the motor windings
//            shorted (viscous): after make_safe, force disabled, over-speed, no command within the
//            watchdog, the force button, loss of the link. Leaving BRAKE takes enable_force().
// Source     reference facts of Force Dimension controllers: watchdog unit 125 us, <= 31.9 ms;
//            over-speed brake; forces added to gravity compensation saturate on the sum.
// One owner thread, except make_safe().
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/haptic/force_gate.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "drivers/haptic/haptic_device.hpp"
#include "drivers/haptic/stylus_plant.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [device.twin]. Mass, damping and friction of a real Omega.3 are not published: assumed.
struct OmegaTwinConfig : StylusPlantConfig {
  double quantum_m = 1e-5;
  double force_limit_N = 12.0;
  double speed_limit_m_per_s = 1.0;
  double watchdog_s = 0.020;
  double time_guard_s = 0.0;  // effect: reads closer than this repeat the last sample
  bool calibrated = true;     // false: starts in RESET
  std::string measured;       // when mass, damping and friction were measured; empty: assumed

  void describe(config::Section& s) {
    s.number("mass_kg", mass_kg, 0.01, 5, "effective mass at the tip (assumed)");
    s.number("damping_N_s_per_m", damping_N_s_per_m, 0, 100, "viscous friction b (assumed)");
    s.number("coulomb_N", coulomb_N, 0, 5, "Coulomb friction c (assumed)");
    s.number("delay_s", delay_s, 0, 0.01, "position sample to force, beyond the hold");
    s.number("quantum_m", quantum_m, 0, 0.001, "position resolution");
    s.number("force_limit_N", force_limit_N, 0.1, 50, "saturation of the force");
    s.number("workspace_radius_m", workspace_radius_m, 0.01, 1, "reach from the centre");
    s.number("speed_limit_m_per_s", speed_limit_m_per_s, 0.05, 20, "over it the controller brakes");
    s.number("brake_damping_N_s_per_m", brake_damping_N_s_per_m, 0, 200, "shorted windings");
    s.number("watchdog_s", watchdog_s, 0.001, 0.0319, "no command for so long: brake");
    s.number("time_guard_s", time_guard_s, 0, 0.01, "effect: nearer reads repeat the sample");
    s.number("gravity_mass_kg", gravity_mass_kg, 0, 5, "effect: weight of the arm");
    s.number("hand_mass_kg", hand_mass_kg, 0, 5, "mass of the hand at the tip");
    s.number("hand_stiffness_N_per_m", hand_stiffness_N_per_m, 0, 5000, "0: nobody holds it");
    s.number("hand_damping_N_s_per_m", hand_damping_N_s_per_m, 0, 200, "damping of the hand");
    s.number("end_stop_N_per_m", end_stop_N_per_m, 0, 20000, "rim of the workspace");
    s.integer("substep_us", substep_us, 5, 50, "integration step");
    s.flag("calibrated", calibrated, "false: starts in RESET");
    s.text("measured", measured, {}, "when teletact identify measured them; empty: assumed");
  }
};

struct DeviceFaults {
  bool unplugged = false;           // sense() gives nothing, commands go nowhere, brakes on
  std::uint32_t repeat = 0;         // this many next reads repeat the last sample
  std::uint32_t drop_commands = 0;  // this many next commands are lost
  bool nan_position = false;        // reads carry NaN
  perception::Vec3 jump_m = perception::Vec3::Zero();  // added to what is read (a slipped encoder)
  bool stuck_button = false;                           // stylus button reads pressed
  bool force_button = false;  // the base's force button was pressed: brake (cleared by the twin)
  bool lose_calibration = false;  // back to RESET (cleared by the twin)
  bool frozen = false;            // position no longer changes, the device otherwise lives
  perception::Vec3 force_bias_N = perception::Vec3::Zero();  // motor offset
};

class OmegaTwin final : public HapticDevice {
 public:
  // `hand` may be null: nobody holds the stylus. It must outlive the twin.
  // Throws std::invalid_argument if the numbers contradict each other.
  OmegaTwin(rt::NonRealtime&, const OmegaTwinConfig&, HandScript* hand,
            const perception::Vec3& start_p_DH = perception::Vec3::Zero());

  [[nodiscard]] DeviceProperties properties() const noexcept override;
  [[nodiscard]] bool sense(rt::Time now, StylusSample& out) noexcept override;
  void act(rt::Time now, const ForceCommand& command) noexcept override;
  void make_safe() noexcept override { gate_.make_safe(); }
  void request_enable() noexcept override { gate_.ask(); }

  // Owner's thread. The hand's script starts at the first access, or here.
  void start_hand(rt::Time now) noexcept;
  // Leaves BRAKE or IDLE for FORCE with zero force, watchdog restarted. False in RESET or
  // unplugged.
  bool enable_force(rt::Time now) noexcept;
  void disable_force(rt::Time now) noexcept;
  void calibrate() noexcept;  // RESET -> IDLE
  // Settings of the controller that a driver may change while it runs.
  void set_watchdog(rt::Nanos after) noexcept;
  void set_time_guard(double seconds) noexcept { config_.time_guard_s = seconds; }
  void set_speed_limit(double m_per_s) noexcept { config_.speed_limit_m_per_s = m_per_s; }
  [[nodiscard]] DeviceFaults& faults() noexcept { return faults_; }
  [[nodiscard]] DeviceState state() const noexcept { return state_; }
  [[nodiscard]] ForceOffCause force_off_cause() const noexcept { return cause_; }

  // The truth, for tests and reports.
  [[nodiscard]] const perception::Vec3& true_position() const noexcept {
    return plant_.true_position();
  }
  [[nodiscard]] const perception::Vec3& true_velocity() const noexcept {
    return plant_.true_velocity();
  }
  [[nodiscard]] const perception::Vec3& motor_force() const noexcept {
    return plant_.motor_force();
  }
  [[nodiscard]] const HandTarget& hand_target() const noexcept { return plant_.hand_target(); }
  [[nodiscard]] std::uint64_t brakes() const noexcept { return brakes_; }
  [[nodiscard]] std::uint64_t repeats() const noexcept { return repeats_; }
  // Kicks the mass (tests): adds to the velocity.
  void push(const perception::Vec3& dv) noexcept { plant_.push(dv); }
  // A steady force of the outside on the tip, N in D (tests and sweeps).
  void set_external_force(const perception::Vec3& f) noexcept { plant_.set_external_force(f); }
  [[nodiscard]] std::vector<std::string> effects() const;

  using CpuClock = std::int64_t (*)() noexcept;
  void set_cpu_clock(CpuClock clock) noexcept { cpu_clock_ = clock; }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_; }

 private:
  void advance(rt::Time now) noexcept;
  void supervise() noexcept;
  void brake(ForceOffCause) noexcept;
  void switch_on() noexcept;

  OmegaTwinConfig config_;
  StylusPlant plant_;
  std::int64_t watchdog_steps_ = 0, last_command_step_ = 0;
  DeviceState state_ = DeviceState::kIdle;
  ForceOffCause cause_ = ForceOffCause::kNone;
  ForceGate gate_;
  DeviceFaults faults_;
  StylusSample last_sample_;
  bool sampled_ = false;
  perception::Vec3 frozen_at_ = perception::Vec3::Zero();
  bool was_frozen_ = false;
  std::uint64_t seq_ = 0, brakes_ = 0, repeats_ = 0;
  CpuClock cpu_clock_ = nullptr;
  std::int64_t twin_cpu_ns_ = 0;
};

}  // namespace drivers
