// What the twin library holds, behind one mutex as the vendor's library is one global object.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "drivers/haptic/hand_script.hpp"
#include "drivers/omega/omega_twin.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::twin_sdk {

struct TwinFile {
  OmegaTwinConfig twin;
  HandScriptConfig hand;
  std::array<double, 3> workspace_W_m{};
  double scale = 1.0, yaw_deg = 0.0;
  bool manual_clock = false;
  void describe(config::Section& s);
};

struct Twin {
  TwinFile file;
  std::unique_ptr<HandScript> hand;
  std::unique_ptr<OmegaTwin> device;

  bool manual_clock = false;
  std::int64_t manual_ns = 1'000'000'000;
  bool open = false, expert = false, gravity_on = true, no_watchdog = false, busy = false;
  bool fail_status = false, fail_forces = false;
  int version_major = 3, version_minor = 17, system_type = 33;
  int fail_calls = 0;
  double hang_s = 0;
  unsigned watchdog_units = 160;
  unsigned velocity_threshold = 1000;  // the twin counts it in mm/s; the vendor's unit is its own
  double max_force_N = 1e9;
  perception::Vec3 external = perception::Vec3::Zero(), sent = perception::Vec3::Zero();
  std::uint64_t exchanges = 0, commands = 0;

  [[nodiscard]] rt::Time now() const noexcept;
  // Throws std::runtime_error with one line.
  void reset(const std::string& toml);
};

// The one twin, and the lock that every exported function holds.
[[nodiscard]] Twin& twin();
[[nodiscard]] std::mutex& twin_mutex();
using TwinLock = std::lock_guard<std::mutex>;
// Error number of the calling thread, as the SDK keeps it.
[[nodiscard]] int& last_error();

}  // namespace drivers::twin_sdk
