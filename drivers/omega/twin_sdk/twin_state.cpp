#include "drivers/omega/twin_sdk/twin_state.hpp"

#include <numbers>
#include <stdexcept>

#include "drivers/omega/dhd_api.hpp"
#include "rt/clock/box_time.hpp"

namespace drivers::twin_sdk {

void TwinFile::describe(config::Section& s) {
  twin.describe(s.section("twin", "the device and the hand on it"));
  hand.describe(s.section("hand", "what the hand does"));
  auto& w = s.section("workspace", "where the script's points are");
  w.numbers("workspace_W_m", workspace_W_m, -1000, 1000, "centre of the device workspace in W");
  w.number("scale", scale, 0.01, 100, "scene metres per hand metre");
  w.number("yaw_deg", yaw_deg, -360, 360, "device base about z of W");
  s.flag("manual_clock", manual_clock, "time moves by advance() only");
}

rt::Time Twin::now() const noexcept {
  return rt::time_from_ns(manual_clock ? manual_ns : rt::monotonic_ns());
}

void Twin::reset(const std::string& toml) {
  TwinFile fresh;
  config::Section schema;
  fresh.describe(schema);
  if (auto good = config::load_text(toml, "twin", schema); !good) {
    throw std::runtime_error(good.error());
  }
  *this = Twin{};
  rt::Startup startup;
  file = fresh;
  manual_clock = file.manual_clock;
  const WorkspaceMap map(
      perception::Vec3(file.workspace_W_m[0], file.workspace_W_m[1], file.workspace_W_m[2]),
      file.scale, file.yaw_deg * std::numbers::pi / 180.0);
  hand = std::make_unique<HandScript>(startup.token(), file.hand, map);
  const perception::Vec3 start = map.to_device(hand->target(rt::Nanos{0}).p_WT);
  device = std::make_unique<OmegaTwin>(startup.token(), file.twin,
                                       hand->size() > 0 ? hand.get() : nullptr, start);
  StylusSample first;
  (void)device->sense(now(), first);  // its clock starts
}

Twin& twin() {
  static Twin instance = [] {
    Twin t;
    t.reset("");
    return t;
  }();
  return instance;
}

std::mutex& twin_mutex() {
  static std::mutex mutex;
  return mutex;
}

int& last_error() {
  thread_local int error = kDhdNoError;
  return error;
}

}  // namespace drivers::twin_sdk
