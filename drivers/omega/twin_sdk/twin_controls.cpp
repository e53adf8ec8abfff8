// The handles of twin_control.hpp, exported.
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

#include "drivers/omega/twin_sdk/twin_state.hpp"

using drivers::twin_sdk::Twin;
using drivers::twin_sdk::twin;
using drivers::twin_sdk::twin_mutex;
using drivers::twin_sdk::TwinLock;
using perception::Vec3;

namespace {

using Setter = std::function<void(Twin&, double)>;
using Getter = std::function<double(const Twin&)>;

std::string& error_text() {
  static std::string text;
  return text;
}

void add_axes(std::map<std::string, Setter>& m, const std::string& before, const std::string& after,
              const std::function<void(Twin&, int, double)>& set) {
  for (int i = 0; i < 3; ++i) {
    m[before + std::string(1, "xyz"[i]) + after] = [=](Twin& t, double v) { set(t, i, v); };
  }
}

const std::map<std::string, Setter>& setters() {
  static const std::map<std::string, Setter> map = [] {
    std::map<std::string, Setter> m;
    m["manual_clock"] = [](Twin& t, double v) {
      const auto now = t.now();
      t.manual_clock = v != 0;
      t.manual_ns = rt::ns_of(now);
    };
    m["unplugged"] = [](Twin& t, double v) {
      t.device->faults().unplugged = v != 0;
      if (v != 0) {
        drivers::StylusSample lost;
        (void)t.device->sense(t.now(), lost);  // the controller brakes at once, asked or not
        t.open = false;
      }
    };
    m["repeat"] = [](Twin& t, double v) { t.device->faults().repeat = static_cast<unsigned>(v); };
    m["drop_commands"] = [](Twin& t, double v) {
      t.device->faults().drop_commands = static_cast<unsigned>(v);
    };
    m["nan_position"] = [](Twin& t, double v) { t.device->faults().nan_position = v != 0; };
    m["frozen"] = [](Twin& t, double v) { t.device->faults().frozen = v != 0; };
    m["stuck_button"] = [](Twin& t, double v) { t.device->faults().stuck_button = v != 0; };
    m["force_button"] = [](Twin& t, double v) { t.device->faults().force_button = v != 0; };
    m["lose_calibration"] = [](Twin& t, double v) { t.device->faults().lose_calibration = v != 0; };
    m["calibrate"] = [](Twin& t, double) { t.device->calibrate(); };
    m["fail_calls"] = [](Twin& t, double v) { t.fail_calls = static_cast<int>(v); };
    m["fail_status"] = [](Twin& t, double v) { t.fail_status = v != 0; };
    m["fail_forces"] = [](Twin& t, double v) { t.fail_forces = v != 0; };
    m["hang_s"] = [](Twin& t, double v) { t.hang_s = v; };
    m["version_major"] = [](Twin& t, double v) { t.version_major = static_cast<int>(v); };
    m["version_minor"] = [](Twin& t, double v) { t.version_minor = static_cast<int>(v); };
    m["system_type"] = [](Twin& t, double v) { t.system_type = static_cast<int>(v); };
    m["no_watchdog"] = [](Twin& t, double v) { t.no_watchdog = v != 0; };
    m["velocity_threshold"] = [](Twin& t, double v) {
      t.velocity_threshold = static_cast<unsigned>(v);
    };
    m["busy"] = [](Twin& t, double v) { t.busy = v != 0; };
    add_axes(m, "jump_", "_m", [](Twin& t, int i, double v) { t.device->faults().jump_m[i] = v; });
    add_axes(m, "bias_", "_N",
             [](Twin& t, int i, double v) { t.device->faults().force_bias_N[i] = v; });
    add_axes(m, "push_", "", [](Twin& t, int i, double v) {
      Vec3 dv = Vec3::Zero();
      dv[i] = v;
      t.device->push(dv);
    });
    add_axes(m, "external_", "_N", [](Twin& t, int i, double v) {
      t.external[i] = v;
      t.device->set_external_force(t.external);
    });
    return m;
  }();
  return map;
}

const std::map<std::string, Getter>& getters() {
  static const std::map<std::string, Getter> map = [] {
    std::map<std::string, Getter> m;
    for (int i = 0; i < 3; ++i) {
      const std::string axis(1, "xyz"[i]);
      m[axis + "_m"] = [i](const Twin& t) { return t.device->true_position()[i]; };
      m["v" + axis] = [i](const Twin& t) { return t.device->true_velocity()[i]; };
      m["f" + axis + "_N"] = [i](const Twin& t) { return t.device->motor_force()[i]; };
      m["sent_" + axis + "_N"] = [i](const Twin& t) { return t.sent[i]; };
    }
    m["state"] = [](const Twin& t) { return static_cast<double>(t.device->state()); };
    m["cause"] = [](const Twin& t) { return static_cast<double>(t.device->force_off_cause()); };
    m["brakes"] = [](const Twin& t) { return static_cast<double>(t.device->brakes()); };
    m["open"] = [](const Twin& t) { return t.open ? 1.0 : 0.0; };
    m["exchanges"] = [](const Twin& t) { return static_cast<double>(t.exchanges); };
    m["commands"] = [](const Twin& t) { return static_cast<double>(t.commands); };
    m["watchdog_units"] = [](const Twin& t) { return static_cast<double>(t.watchdog_units); };
    m["velocity_threshold"] = [](const Twin& t) {
      return static_cast<double>(t.velocity_threshold);
    };
    m["gravity_on"] = [](const Twin& t) { return t.gravity_on ? 1.0 : 0.0; };
    m["hand_segment"] = [](const Twin& t) {
      return static_cast<double>(t.device->hand_target().segment);
    };
    return m;
  }();
  return map;
}

}  // namespace

extern "C" {
#define TWIN_EXPORT __attribute__((visibility("default")))

TWIN_EXPORT int teletact_twin_reset(const char* toml) {
  const TwinLock lock(twin_mutex());
  try {
    twin().reset(toml);
    return 0;
  } catch (const std::exception& e) {
    error_text() = e.what();
    return -1;
  }
}
TWIN_EXPORT const char* teletact_twin_error() { return error_text().c_str(); }
TWIN_EXPORT int teletact_twin_set(const char* key, double value) {
  const TwinLock lock(twin_mutex());
  const auto found = setters().find(key);
  if (found == setters().end()) return -1;
  found->second(twin(), value);
  return 0;
}
TWIN_EXPORT double teletact_twin_get(const char* key) {
  const TwinLock lock(twin_mutex());
  const auto found = getters().find(key);
  return found == getters().end() ? std::numeric_limits<double>::quiet_NaN()
                                  : found->second(twin());
}
TWIN_EXPORT void teletact_twin_advance(double seconds) {
  const TwinLock lock(twin_mutex());
  Twin& t = twin();
  t.manual_ns += rt::nanos_from_seconds(seconds).count();
}
TWIN_EXPORT void teletact_twin_start_hand(double in_s) {
  const TwinLock lock(twin_mutex());
  twin().device->start_hand(twin().now() + rt::nanos_from_seconds(in_s));
}
TWIN_EXPORT int teletact_twin_hand_point(int segment, const double* p_W, const double* normal_W) {
  const TwinLock lock(twin_mutex());
  return segment >= 0 && twin().hand->set_point(static_cast<std::size_t>(segment),
                                                Vec3(p_W[0], p_W[1], p_W[2]),
                                                Vec3(normal_W[0], normal_W[1], normal_W[2]))
             ? 0
             : -1;
}
}  // extern "C"
