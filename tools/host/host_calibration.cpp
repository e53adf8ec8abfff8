// Which calibration is this host's, and when it is measured.
#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "rt/hash.hpp"
#include "tools/files/build_info.hpp"
#include "tools/host/calibrate.hpp"

namespace teletact {

namespace {

std::string hex(std::uint64_t x) {
  char text[20];
  std::snprintf(text, sizeof text, "%016" PRIx64, x);
  return text;
}

// Where a device of the robot is, and what it must be: no task takes longer for it.
constexpr std::array kPlaces{"robot.bus.interface",      "robot.bus.chain",
                             "robot.bus.calibration",    "robot.bus.ignored_flags",
                             "robot.bus.most_current_A", "robot.bus.arm_rest",
                             "robot.bus.can.iface",      "robot.gpio.chip"};

// The values in effect without these. Of the bus its kind is left: frames cost robot_io.
std::string what_costs(const std::string& effective) {
  std::istringstream in(effective);
  std::string out, section;
  for (std::string line; std::getline(in, line);) {
    std::string_view plain = line;
    if (plain.starts_with("# ")) plain.remove_prefix(2);
    if (plain.starts_with("["))
      section = std::string(plain.substr(1, plain.find_first_of(']') - 1)) + ".";
    const std::string key = section + std::string(plain.substr(0, plain.find(" = ")));
    if (std::find(kPlaces.begin(), kPlaces.end(), key) == kPlaces.end()) out += line + "\n";
  }
  return out;
}

// Its rows alone, of both boxes without one.
std::vector<rt::TaskSpec> specs_of(const tasks::Calibration& c, const Scene& scene,
                                   std::optional<rt::Box> only) {
  auto specs = tasks::make_specs(c, choice_limits(scene));
  if (only) std::erase_if(specs, [&](const rt::TaskSpec& s) { return s.box != *only; });
  return specs;
}

std::string cache_folder() {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  namespace fs = std::filesystem;
  return ((cache != nullptr ? fs::path(cache)
                            : fs::path(home != nullptr ? home : "/tmp") / ".cache") /
          "teletact")
      .string();
}

}  // namespace

tasks::CalibrationOrigin calibration_origin(const Scene& scene) {
  rt::Hash64 program, values;
  std::ifstream self("/proc/self/exe", std::ios::binary);
  for (std::array<char, 65536> part{}; self.read(part.data(), part.size()) || self.gcount() > 0;)
    program.bytes(part.data(), static_cast<std::size_t>(self.gcount()));
  const std::string text = what_costs(config::effective(scene.schema));
  values.bytes(text.data(), text.size());
  tasks::CalibrationOrigin o;
  o.host = tasks::host_id();
  o.build =
      std::string(kVersion) + " " + kBuildType + ", " + kCompiler + ", " + hex(program.digest());
  o.config = hex(values.digest());
  if (!scene.rgbd_dir.empty())
    o.recording = std::filesystem::weakly_canonical(scene.rgbd_dir).string();
  return o;
}

tasks::Calibration host_calibration(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
                                    std::string& text, std::optional<rt::Box> only) {
  namespace fs = std::filesystem;
  if (!options.calibration.empty()) {
    auto c = tasks::load_calibration(options.calibration);
    if (!c) throw std::runtime_error(c.error());
    text = options.calibration + " (" + c.value().host + ")";
    return std::move(c).value();
  }
  const fs::path folder = cache_folder();
  const std::string of_both =
      (folder / ("calibration-" + fs::path(options.scene_path).stem().string())).string();
  // What was measured for both boxes serves one of them too.
  std::vector<std::string> files{of_both + ".toml"};
  if (only)
    files.push_back(of_both + (*only == rt::Box::kRobot ? "-robot.toml" : "-operator.toml"));
  const std::string file = files.back();
  std::string why = "there is none yet";
  for (const std::string& f : files) {
    if (!fs::exists(f)) continue;
    auto c = tasks::load_calibration(f);
    why = c ? c.value().lacks(calibration_origin(scene), specs_of(c.value(), scene, only))
            : c.error();
    if (!why.empty()) continue;
    text = f + " (" + c.value().host + ")";
    return std::move(c).value();
  }
  std::printf("measuring what each task costs here, once; %s: %s\n", file.c_str(), why.c_str());
  std::fflush(stdout);
  // Long enough for the first touches and the first plan of the shipped scenes.
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw std::runtime_error(folder.string() + ": can not be made: " + error.message());
  tasks::Calibration c = calibrate(nrt, scene, 8.0, options.quiet, nullptr, only);
  tasks::save_calibration(file, c);
  text = file + ", measured just now (" + c.host + ")";
  return c;
}

tasks::Calibration reference_calibration() {
  auto c = tasks::load_calibration(find_config("limits", "reference_costs"));
  if (!c) throw std::runtime_error(c.error());
  return std::move(c).value();
}

}  // namespace teletact
