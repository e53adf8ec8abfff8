// The C functions of a Force Dimension SDK (3.14 or later) that the driver calls, as function types
// of our own: no vendor header or binary is in the tree. Semantics from the published reference of
// the interface: 0 is success, -1 an error (its number by get_last_error, per thread), 1 from a
// read means that the TimeGuard gave the last sample again, 2 from a write that a motor saturates.
// The device number has no default from C: it must be passed. Device axes: x toward the operator, y
// to the operator's right, z up (assumed, to be seen on hardware); metres, newtons.
#pragma once

#include <array>

namespace drivers {

struct DhdApi {
  void (*get_sdk_version)(int* major, int* minor, int* release, int* revision) = nullptr;
  int (*get_last_error)() = nullptr;
  const char* (*get_last_error_text)() = nullptr;
  int (*get_device_count)() = nullptr;
  int (*open_type)(int type) = nullptr;
  int (*open_serial)(int serial) = nullptr;
  int (*close)(char id) = nullptr;
  int (*stop)(char id) = nullptr;
  int (*get_system_type)(char id) = nullptr;
  int (*enable_expert_mode)() = nullptr;
  int (*disable_expert_mode)() = nullptr;
  int (*set_watchdog)(unsigned char units, char id) = nullptr;
  int (*get_watchdog)(unsigned char* units, char id) = nullptr;
  int (*get_velocity_threshold)(unsigned int* value, char id) = nullptr;
  int (*set_time_guard)(int us, char id) = nullptr;
  int (*set_max_force)(double newton, char id) = nullptr;
  int (*set_gravity_compensation)(int on, char id) = nullptr;
  int (*get_effector_mass)(double* kg, char id) = nullptr;
  int (*enable_force)(unsigned char on, char id) = nullptr;
  int (*get_position)(double* x, double* y, double* z, char id) = nullptr;
  int (*set_force)(double x, double y, double z, char id) = nullptr;
  unsigned int (*get_button_mask)(char id) = nullptr;
  int (*get_status)(int* status, char id) = nullptr;  // array of kDhdStatusSize
};

inline constexpr int kDhdDeviceOmega3 = 33;
inline constexpr int kDhdTimeGuard = 1;       // a read: nothing new
inline constexpr int kDhdMotorSaturated = 2;  // a write: less force than asked for
inline constexpr double kDhdWatchdogUnit_s = 125e-6;
// Buffer for get_status: 17 numbers by the reference; later SDKs may write more.
inline constexpr int kDhdStatusSize = 17, kDhdStatusRoom = 64;

// Indices of get_status.
enum : int {
  kDhdPower = 0,
  kDhdConnected = 1,
  kDhdStarted = 2,
  kDhdReset = 3,
  kDhdIdle = 4,
  kDhdForce = 5,
  kDhdBrake = 6,
  kDhdErrorFlag = 9,
  kDhdGravity = 10,
  kDhdTimeGuardOn = 11,
  kDhdForceOffCause = 14
};
// Numbers of get_last_error.
enum : int {
  kDhdNoError = 0,
  kDhdErrorAny = 1,
  kDhdErrorCom = 2,
  kDhdErrorBusy = 3,
  kDhdErrorNoDriver = 4,
  kDhdErrorNoDevice = 5,
  kDhdErrorNotAvailable = 6,
  kDhdErrorTimeout = 7
};

}  // namespace drivers
