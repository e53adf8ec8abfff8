// The C functions of the SDK, on the twin. What the vendor's library does on the host (gravity
// compensation, saturation) is done here; what the controller does is OmegaTwin's.
#include <chrono>
#include <cmath>
#include <cstring>
#include <thread>

#include "drivers/omega/dhd_api.hpp"
#include "drivers/omega/twin_sdk/twin_state.hpp"

using drivers::DeviceState;
using drivers::StylusSample;
using drivers::twin_sdk::last_error;
using drivers::twin_sdk::Twin;
using drivers::twin_sdk::twin;
using drivers::twin_sdk::twin_mutex;
using drivers::twin_sdk::TwinLock;
using perception::Vec3;

namespace {

constexpr double kGravity = 9.81;

int fail(int error) {
  last_error() = error;
  return -1;
}

// Device axes and D differ by half a turn about z.
Vec3 turned(const Vec3& v) { return {-v.x(), -v.y(), v.z()}; }

// Runs `body` on the open twin; -1 and an error number otherwise.
template <class Body>
int on_device(char id, Body body) {
  const TwinLock lock(twin_mutex());
  Twin& t = twin();
  if (!t.open || (id != 0 && id != -1)) return fail(drivers::kDhdErrorNotAvailable);
  if (t.device->faults().unplugged) return fail(drivers::kDhdErrorCom);
  return body(t);
}

// An exchange with the controller: may fail or take long.
template <class Body>
int exchange(char id, Body body) {
  return on_device(id, [&](Twin& t) {
    ++t.exchanges;
    if (t.hang_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(t.hang_s));
    if (t.fail_calls > 0) {
      --t.fail_calls;
      return fail(drivers::kDhdErrorCom);
    }
    return body(t);
  });
}

int expert(char id, bool Twin::*flag) {
  return on_device(id, [&](Twin& t) { return t.*flag ? 0 : fail(drivers::kDhdErrorNotAvailable); });
}

int open_device() {
  const TwinLock lock(twin_mutex());
  Twin& t = twin();
  if (t.device->faults().unplugged) return fail(drivers::kDhdErrorNoDevice);
  if (t.busy) return fail(drivers::kDhdErrorBusy);
  t.open = true;
  return 0;
}

}  // namespace

// NOLINTBEGIN(readability-identifier-naming): the names are the vendor's.
extern "C" {
#define TWIN_EXPORT __attribute__((visibility("default")))

TWIN_EXPORT void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  const TwinLock lock(twin_mutex());
  *major = twin().version_major;
  *minor = twin().version_minor;
  *release = *revision = 0;
}
TWIN_EXPORT int dhdErrorGetLast() { return last_error(); }
TWIN_EXPORT const char* dhdErrorGetStr(int error) {
  switch (error) {
    case drivers::kDhdNoError:
      return "no error";
    case drivers::kDhdErrorCom:
      return "communication error";
    case drivers::kDhdErrorBusy:
      return "controller busy";
    case drivers::kDhdErrorNoDevice:
      return "no device found";
    case drivers::kDhdErrorNotAvailable:
      return "feature not available";
    default:
      return "error";
  }
}
TWIN_EXPORT const char* dhdErrorGetLastStr() { return dhdErrorGetStr(last_error()); }

// ---- which device
TWIN_EXPORT int dhdGetDeviceCount() {
  const TwinLock lock(twin_mutex());
  return twin().device->faults().unplugged ? 0 : 1;
}
TWIN_EXPORT int dhdGetAvailableCount() {
  const TwinLock lock(twin_mutex());
  return twin().device->faults().unplugged || twin().open ? 0 : 1;
}
TWIN_EXPORT int dhdOpen() { return open_device(); }
TWIN_EXPORT int dhdOpenID(char id) {
  return id == 0 ? open_device() : fail(drivers::kDhdErrorNoDevice);
}
TWIN_EXPORT int dhdOpenType(int type) {
  return type == drivers::kDhdDeviceOmega3 ? open_device() : fail(drivers::kDhdErrorNoDevice);
}
TWIN_EXPORT int dhdOpenSerial(int serial) {
  return serial == 1 ? open_device() : fail(drivers::kDhdErrorNoDevice);
}
TWIN_EXPORT int dhdClose(char) {
  const TwinLock lock(twin_mutex());
  twin().open = false;
  return 0;
}
TWIN_EXPORT int dhdGetDeviceID() { return 0; }
TWIN_EXPORT int dhdSetDevice(char id) { return id == 0 ? 0 : fail(drivers::kDhdErrorNoDevice); }
TWIN_EXPORT int dhdGetSystemType(char id) {
  return on_device(id, [](Twin& t) { return t.system_type; });
}
TWIN_EXPORT const char* dhdGetSystemName(char) { return "omega.3 (twin)"; }
TWIN_EXPORT int dhdGetSerialNumber(unsigned short* serial, char id) {
  return on_device(id, [&](Twin&) {
    *serial = 1;
    return 0;
  });
}

// ---- expert settings
TWIN_EXPORT int dhdEnableExpertMode() {
  const TwinLock lock(twin_mutex());
  twin().expert = true;
  return 0;
}
TWIN_EXPORT int dhdDisableExpertMode() {
  const TwinLock lock(twin_mutex());
  twin().expert = false;
  return 0;
}
TWIN_EXPORT int dhdSetWatchdog(unsigned char units, char id) {
  if (expert(id, &Twin::expert) != 0) return -1;
  return on_device(id, [&](Twin& t) {
    if (t.no_watchdog) return fail(drivers::kDhdErrorNotAvailable);
    t.watchdog_units = units;
    // 0 switches it off.
    t.device->set_watchdog(units > 0 ? std::chrono::nanoseconds{units * 125000LL}
                                     : std::chrono::nanoseconds{std::chrono::hours{24}});
    return 0;
  });
}
TWIN_EXPORT int dhdGetWatchdog(unsigned char* units, char id) {
  return on_device(id, [&](Twin& t) {
    if (t.no_watchdog) return fail(drivers::kDhdErrorNotAvailable);
    *units = static_cast<unsigned char>(t.watchdog_units);
    return 0;
  });
}
TWIN_EXPORT int dhdSetVelocityThreshold(unsigned int value, char id) {
  if (expert(id, &Twin::expert) != 0) return -1;
  return on_device(id, [&](Twin& t) {
    t.velocity_threshold = value;
    t.device->set_speed_limit(value > 0 ? value * 1e-3 : 1e9);
    return 0;
  });
}
TWIN_EXPORT int dhdGetVelocityThreshold(unsigned int* value, char id) {
  return on_device(id, [&](Twin& t) {
    *value = t.velocity_threshold;
    return 0;
  });
}
TWIN_EXPORT int dhdSetTimeGuard(int us, char id) {
  if (expert(id, &Twin::expert) != 0) return -1;
  return on_device(id, [&](Twin& t) {
    t.device->set_time_guard(us * 1e-6);
    return 0;
  });
}

// ---- forces
TWIN_EXPORT int dhdStop(char id) {
  return on_device(id, [](Twin& t) {
    t.device->disable_force(t.now());
    return 0;
  });
}
TWIN_EXPORT int dhdEnableForce(unsigned char on, char id) {
  return exchange(id, [&](Twin& t) {
    if (on == 0) {
      t.device->disable_force(t.now());
      return 0;
    }
    return t.device->enable_force(t.now()) ? 0 : fail(drivers::kDhdErrorNotAvailable);
  });
}
TWIN_EXPORT int dhdSetBrakes(int on, char id) { return dhdEnableForce(on != 0 ? 0 : 1, id); }
TWIN_EXPORT int dhdSetGravityCompensation(int on, char id) {
  return on_device(id, [&](Twin& t) {
    t.gravity_on = on != 0;
    return 0;
  });
}
TWIN_EXPORT int dhdSetStandardGravity(double g, char id) {
  return on_device(id, [&](Twin&) { return g > 0 ? 0 : fail(drivers::kDhdErrorAny); });
}
TWIN_EXPORT int dhdGetEffectorMass(double* kg, char id) {
  return on_device(id, [&](Twin& t) {
    *kg = t.file.twin.gravity_mass_kg;
    return 0;
  });
}
TWIN_EXPORT int dhdSetMaxForce(double newton, char id) {
  return on_device(id, [&](Twin& t) {
    t.max_force_N = newton > 0 ? newton : 1e9;
    return 0;
  });
}
TWIN_EXPORT double dhdGetMaxForce(char) {
  const TwinLock lock(twin_mutex());
  return twin().max_force_N;
}
TWIN_EXPORT int dhdSetForce(double x, double y, double z, char id) {
  return exchange(id, [&](Twin& t) {
    if (t.fail_forces) return fail(drivers::kDhdErrorCom);
    if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(z)) {
      return fail(drivers::kDhdErrorAny);
    }
    ++t.commands;
    Vec3 f = turned(Vec3(x, y, z));
    t.sent = f;
    // The first command of OmegaTwin switches the motors on; this controller waits to be asked.
    if (t.device->state() != DeviceState::kForce) return 0;
    // OmegaTwin adds the compensation and saturates the sum, as the SDK does when it is on.
    const Vec3 weight(0, 0, t.file.twin.gravity_mass_kg * kGravity);
    int result = 0;
    const Vec3 sum = t.gravity_on ? Vec3(f + weight) : f;
    const double limit = std::min(t.max_force_N, t.file.twin.force_limit_N);
    if (sum.norm() > limit * (1 + 1e-12)) {
      result = drivers::kDhdMotorSaturated;
      f += (limit / sum.norm() - 1.0) * sum;
    }
    if (!t.gravity_on) f -= weight;
    t.device->act(t.now(), {f});
    return result;
  });
}
TWIN_EXPORT int dhdSetForceAndTorqueAndGripperForce(double x, double y, double z, double, double,
                                                    double, double, char id) {
  return dhdSetForce(x, y, z, id);
}
TWIN_EXPORT int dhdGetForce(double* x, double* y, double* z, char id) {
  return on_device(id, [&](Twin& t) {
    const Vec3 f = turned(t.device->motor_force());
    *x = f.x(), *y = f.y(), *z = f.z();
    return 0;
  });
}

// ---- reads
TWIN_EXPORT int dhdGetPosition(double* x, double* y, double* z, char id) {
  return exchange(id, [&](Twin& t) {
    StylusSample s;
    if (!t.device->sense(t.now(), s)) return fail(drivers::kDhdErrorCom);
    const Vec3 p = turned(s.p_DH);
    *x = p.x(), *y = p.y(), *z = p.z();
    return s.repeated ? drivers::kDhdTimeGuard : 0;
  });
}
TWIN_EXPORT int dhdGetLinearVelocity(double* x, double* y, double* z, char id) {
  return exchange(id, [&](Twin& t) {
    const Vec3 v = turned(t.device->true_velocity());
    *x = v.x(), *y = v.y(), *z = v.z();
    return 0;
  });
}
TWIN_EXPORT unsigned int dhdGetButtonMask(char) {
  const TwinLock lock(twin_mutex());
  const Twin& t = twin();
  const auto& hand = t.device->hand_target();
  return (hand.button || t.device->faults().stuck_button ? 1U : 0U) | (hand.clutch ? 2U : 0U);
}
TWIN_EXPORT int dhdGetButton(int index, char id) {
  return index == 0 || index == 1 ? static_cast<int>((dhdGetButtonMask(id) >> index) & 1U) : 0;
}
TWIN_EXPORT int dhdGetStatus(int* status, char id) {
  return on_device(id, [&](Twin& t) {
    if (t.fail_status) return fail(drivers::kDhdErrorCom);
    std::memset(status, 0, sizeof(int) * drivers::kDhdStatusSize);
    const DeviceState s = t.device->state();
    status[drivers::kDhdPower] = status[drivers::kDhdConnected] = status[drivers::kDhdStarted] = 1;
    status[drivers::kDhdReset] = s == DeviceState::kReset;
    status[drivers::kDhdIdle] = s == DeviceState::kIdle;
    status[drivers::kDhdForce] = s == DeviceState::kForce;
    status[drivers::kDhdBrake] = s == DeviceState::kBrake;
    status[drivers::kDhdGravity] = t.gravity_on;
    status[drivers::kDhdTimeGuardOn] = t.file.twin.time_guard_s > 0;
    status[drivers::kDhdForceOffCause] = static_cast<int>(t.device->force_off_cause());
    return 0;
  });
}
TWIN_EXPORT double dhdGetComFreq(char) { return 4.0; }
}  // extern "C"
// NOLINTEND(readability-identifier-naming)
