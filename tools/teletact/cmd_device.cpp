// teletact device: opens the chosen haptic device, reads it for a while at its rate with zero
// force, and says what it is, in which state, how often it had something new, how long the
// exchanges took, and which stiffness it allows. What is missing is one line and exit code 2.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <thread>

#include "rt/clock/box_time.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/scene/haptic_choice.hpp"
#include "tools/scene/scene.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

const char* state_name(drivers::DeviceState s) {
  switch (s) {
    case drivers::DeviceState::kReset:
      return "RESET: not calibrated (docs/devices.md)";
    case drivers::DeviceState::kIdle:
      return "IDLE";
    case drivers::DeviceState::kForce:
      return "FORCE";
    case drivers::DeviceState::kBrake:
      return "BRAKE";
  }
  return "?";
}

struct Reading {
  std::uint64_t ticks = 0, samples = 0, repeats = 0, misses = 0;
  perception::Vec3 low = perception::Vec3::Constant(1e9), high = perception::Vec3::Constant(-1e9);
  drivers::StylusSample last;
};

Reading read_device(drivers::HapticDevice& device, double seconds, double rate_hz) {
  Reading r;
  const std::int64_t begin = rt::monotonic_ns();
  const auto period = static_cast<std::int64_t>(1e9 / rate_hz);
  const auto ticks = static_cast<std::uint64_t>(seconds * rate_hz);
  for (; r.ticks < ticks; ++r.ticks) {
    const std::int64_t due = begin + static_cast<std::int64_t>(r.ticks) * period;
    if (const std::int64_t wait = due - rt::monotonic_ns(); wait > 0) {
      std::this_thread::sleep_for(rt::Nanos{wait});
    }
    const rt::Time now = rt::time_from_ns(rt::monotonic_ns());
    drivers::StylusSample s;
    if (!device.sense(now, s)) {
      ++r.misses;
    } else {
      (s.repeated ? r.repeats : r.samples) += 1;
      r.low = r.low.cwiseMin(s.p_DH);
      r.high = r.high.cwiseMax(s.p_DH);
      r.last = s;
    }
    device.act(now, {});
  }
  return r;
}

void print_reading(const Reading& r, const drivers::DeviceProperties& properties, double rate_hz) {
  std::printf("state      %s%s\n", r.samples > 0 ? state_name(r.last.state) : "no sample",
              r.last.button ? ", button pressed" : "");
  if (r.samples > 0) {
    std::printf("position   %.2f %.2f %.2f mm; moved %.2f %.2f %.2f mm\n", r.last.p_DH.x() * 1e3,
                r.last.p_DH.y() * 1e3, r.last.p_DH.z() * 1e3, (r.high - r.low).x() * 1e3,
                (r.high - r.low).y() * 1e3, (r.high - r.low).z() * 1e3);
  }
  std::printf("reads      %llu: %llu new, %llu repeated, %llu without a sample\n",
              static_cast<unsigned long long>(r.ticks), static_cast<unsigned long long>(r.samples),
              static_cast<unsigned long long>(r.repeats),
              static_cast<unsigned long long>(r.misses));
  if (properties.renders_force) {
    std::printf("stiffness  at most %.0f N/m at %.0f Hz (b = %g N s/m %s, t_d = %g ms)\n",
                properties.stiffness_limit(1.0 / rate_hz), rate_hz, properties.damping_N_s_per_m,
                properties.measured ? "measured" : "assumed", properties.delay_s * 1e3);
  } else {
    std::printf("stiffness  any: no force is rendered\n");
  }
}

}  // namespace

int cmd_device(int argc, char** argv) {
  std::string scene_name = "default_room", json;
  std::vector<std::string> overrides;
  double seconds = 2.0, rate_hz = 1000.0;
  CLI::App app("Opens the haptic device, reads it, and says how it is. No force is rendered.",
               "teletact device");
  app.add_option("--scene", scene_name, "scene whose section [device] is used")
      ->capture_default_str();
  app.add_option("--set", overrides, "override a key: device.kind=\"omega\"");
  std::string kind;
  app.add_option("--kind", kind, haptic_kind_list() + ": short for --set device.kind");
  app.add_option("--seconds", seconds, "how long it is read")
      ->check(in_range(0.01, 3600))
      ->capture_default_str();
  app.add_option("--rate", rate_hz, "reads a second")
      ->check(in_range(1, 4000))
      ->capture_default_str();
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  if (!kind.empty()) overrides.push_back("device.kind=\"" + kind + "\"");
  const auto scene = load_scene(find_config("scenes", scene_name), overrides);

  rt::Startup startup;
  rt::NonRealtime& nrt = startup.token();
  drivers::HandScript hand(nrt, scene->hand, scene->workspace());
  const auto opened =
      open_haptic_device(nrt, *scene, hand, rt::time_from_ns(rt::monotonic_ns()), true);
  const auto properties = opened->device().properties();
  std::printf("%s\n", opened->description().c_str());
  const Reading r = read_device(opened->device(), seconds, rate_hz);
  print_reading(r, properties, rate_hz);
  Metrics metrics("device");
  metrics.add("device.new", static_cast<double>(r.samples), "1");
  metrics.add("device.repeated", static_cast<double>(r.repeats), "1");
  metrics.add("device.missing", static_cast<double>(r.misses), "1");
  for (const auto& [name, value] : opened->figures()) {
    std::printf("%-22s %g\n", name.c_str(), value);
    metrics.add("device." + name, value, name.find("_us") != std::string::npos ? "us" : "1");
  }
  if (!json.empty()) metrics.write(json);
  if (r.samples == 0) throw std::runtime_error("the device gave no sample: check cable and power");
  return 0;
}

}  // namespace teletact
