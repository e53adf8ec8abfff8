// The world of a shipped scene file, without the program that reads the rest of it: the tables
// under [world] are cut out of the text and loaded.
#pragma once

#include <fstream>
#include <stdexcept>
#include <string>

#include "config/schema.hpp"
#include "drivers/world/world.hpp"
#include "tests/support/paths.hpp"

namespace test_support {

[[nodiscard]] inline std::string scene_path(const std::string& scene) {
  return tests::in_tree("config/scenes/") + scene;
}

[[nodiscard]] inline std::string world_tables(const std::string& scene) {
  std::ifstream file(scene_path(scene));
  std::string text, line;
  for (bool in_world = false; std::getline(file, line);) {
    if (!line.empty() && line[0] == '[') {
      const std::string name = line.substr(line.find_first_not_of('['));
      in_world = name.rfind("world.", 0) == 0 || name.rfind("world]", 0) == 0;
    }
    // Blank lines keep the line numbers of messages right.
    text.append(in_world ? line : std::string()).append("\n");
  }
  return text;
}

// Throws std::runtime_error with the loader's message.
[[nodiscard]] inline drivers::World load_world(rt::NonRealtime& nrt, const std::string& scene) {
  drivers::WorldConfig config;
  config::Section root;
  config.describe(root.section("world"));
  const auto ok = config::load_text(world_tables(scene), scene, root);
  if (!ok) throw std::runtime_error(ok.error());
  drivers::World world(nrt, config);
  if (world.shapes().empty()) throw std::runtime_error(scene + ": nothing in the world");
  return world;
}

}  // namespace test_support
