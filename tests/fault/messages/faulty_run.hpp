// The default demo on the virtual clock with faults in its messages or threads.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"

namespace messages {

inline rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

struct Line {
  std::string kind, target;
  int first, every = 1, count = 0;
  double magnitude_us = 0, probability = 1;
};

inline teletact::VirtualRun run(double seconds, const std::vector<Line>& lines,
                                const std::string& logs = {},
                                const std::vector<std::string>& overrides = {}) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("teletact-messages-" + std::to_string(::getpid()) + ".toml");
  {
    std::ofstream out(path);
    out << "name = \"test\"\nseed = 3\n";
    for (const auto& l : lines) {
      out << "[[fault]]\nkind = \"" << l.kind << "\"\ntarget = \"" << l.target
          << "\"\nfirst = " << l.first << "\nevery = " << l.every << "\ncount = " << l.count
          << "\nprobability = " << std::to_string(l.probability);
      if (l.magnitude_us > 0) out << "\nmagnitude_us = " << std::to_string(l.magnitude_us);
      out << "\n\n";
    }
  }
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  teletact::DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  options.fault_plan = path;
  options.log_folder = logs;
  teletact::VirtualRun r =
      teletact::run_virtual(startup().token(), *scene, options, teletact::reference_calibration());
  std::filesystem::remove(path);
  return r;
}

}  // namespace messages
