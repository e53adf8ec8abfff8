// The handles of the Omega's twin library beside the SDK's own functions: its clock, its faults,
// the truth behind its readings. The library (libteletact_omega_twin.so) has the same C functions
// as the vendor's SDK and the mechanics of OmegaTwin inside, so the driver that loads it is the
// real one.
//
// Keys of set():                                   value
//   manual_clock      1: time moves by advance() only; 0: CLOCK_MONOTONIC
//   unplugged         1: gone from the bus: reads and writes fail, open finds nothing; brakes on
//   repeat            that many next reads repeat
//   drop_commands     that many next commands are lost
//   nan_position, frozen, stuck_button               1 or 0
//   force_button      1: the button on the base is pressed once
//   lose_calibration  1: back to RESET;  calibrate 1: RESET -> IDLE
//   jump_x_m, jump_y_m, jump_z_m                     added to what is read, in D
//   bias_x_N, bias_y_N, bias_z_N                     motor offset, in D
//   push_x, push_y, push_z                           kick, m/s, in D
//   external_x_N, external_y_N, external_z_N         a steady force of the outside, in D
//   fail_calls        that many next exchanges return -1 (error 2, communication)
//   fail_status, fail_forces                         1: each dhdGetStatus, each dhdSetForce does
//   hang_s            each exchange takes so long (a stalled USB); real clock only
//   version_major, version_minor                     what dhdGetSDKVersion says
//   system_type       what dhdGetSystemType says
//   no_watchdog       1: firmware without a watchdog
//   velocity_threshold                               0: off, as another program may have left it
//   busy              1: open fails as if another program held the device
// Keys of get(): x_m y_m z_m vx vy vz fx_N fy_N fz_N (truth, in D), state (DeviceState), cause,
// brakes,
//   open, exchanges, commands (since reset), sent_x_N sent_y_N sent_z_N (last command, in D),
//   watchdog_units, velocity_threshold, gravity_on, hand_segment.
#pragma once

#include <type_traits>

namespace drivers {

struct OmegaTwinControl {
  // Forgets everything; TOML of [twin] (OmegaTwinConfig), [hand] (HandScriptConfig) and
  // [workspace]. 0, or -1 with the reason in error().
  int (*reset)(const char* toml) = nullptr;
  const char* (*error)() = nullptr;
  int (*set)(const char* key, double value) = nullptr;  // -1: no such key
  double (*get)(const char* key) = nullptr;             // NaN: no such key
  void (*advance)(double seconds) = nullptr;
  // The hand's script starts so many seconds from now.
  void (*start_hand)(double in_s) = nullptr;
  // A hand's point that became known while running (HandScript::set_point).
  int (*hand_point)(int segment, const double* p_W, const double* normal_W) = nullptr;

  [[nodiscard]] bool complete() const noexcept { return reset != nullptr; }
};

// Looks the handles up in a loaded library; complete() is false for the vendor's SDK.
template <class Library>
[[nodiscard]] OmegaTwinControl find_twin_control(const Library& library) {
  OmegaTwinControl c;
  const auto get = [&](auto& function, const char* name) {
    using Function = std::remove_reference_t<decltype(function)>;
    function = reinterpret_cast<Function>(library.symbol(name));
  };
  get(c.reset, "teletact_twin_reset");
  get(c.error, "teletact_twin_error");
  get(c.set, "teletact_twin_set");
  get(c.get, "teletact_twin_get");
  get(c.advance, "teletact_twin_advance");
  get(c.start_hand, "teletact_twin_start_hand");
  get(c.hand_point, "teletact_twin_hand_point");
  return c;
}

}  // namespace drivers
