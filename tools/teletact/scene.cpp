#include "tools/teletact/scene.hpp"

#include <unistd.h>

#include <array>
#include <climits>
#include <filesystem>
#include <numbers>
#include <stdexcept>

#include "tasks/graph/safe_times.hpp"
#include "tools/teletact/build_info.hpp"

namespace teletact {

void Scene::describe(config::Section& s) {
  s.text("title", title, {}, "name of the scene in reports");
  world.describe(s.section("world", "the simulated place"));
  auto& eye = s.section("camera", "RGB-D camera, its twin and its mount");
  camera.describe(eye);
  camera_choice.describe(eye);
  auto& robot = s.section("robot", "twin of the youBot");
  plant.describe(robot.section("plant", "wheels, motors, floor"));
  bus.describe(robot.section("bus", "motor bus"));
  auto& haptic_device = s.section("device", "haptic device, its twin and the hand on it");
  device.describe(haptic_device);
  choice.describe(haptic_device);
  hand.describe(s.section("hand", "what the hand does"));
  operator_script.describe(s.section("operator", "what the operator does beside"));
  link.describe(s.section("link", "between the boxes"));
  graph.describe(s);
}

drivers::WorkspaceMap Scene::workspace() const {
  const auto& h = graph.haptic;
  return {perception::Vec3(h.workspace_W_m[0], h.workspace_W_m[1], h.workspace_W_m[2]), h.scale,
          h.workspace_yaw_deg * std::numbers::pi / 180.0};
}

perception::Pose Scene::start_X_WB() const {
  perception::Pose X = perception::Pose::Identity();
  X.translation() = perception::Vec3(graph.robot_io.start_x_m, graph.robot_io.start_y_m, 0);
  X.linear() =
      Eigen::AngleAxisd(graph.robot_io.start_yaw_rad, perception::Vec3::UnitZ()).toRotationMatrix();
  return X;
}

std::unique_ptr<Scene> load_scene(const std::string& path,
                                  const std::vector<std::string>& overrides) {
  auto scene = std::make_unique<Scene>();
  if (auto ok = config::load_file(path, scene->schema); !ok) throw std::runtime_error(ok.error());
  for (const auto& o : overrides) {
    if (auto ok = config::load_override(o, scene->schema); !ok)
      throw std::runtime_error(ok.error());
  }
  if (!scene->camera_choice.in_process())
    scene->camera.stands_in_for = scene->camera_choice.intrinsics();
  if (const std::string bad = tasks::check_safe_times(scene->graph); !bad.empty())
    throw std::runtime_error(path + ": " + bad);
  return scene;
}

std::string find_config(const std::string& folder, const std::string& name) {
  namespace fs = std::filesystem;
  if (fs::exists(name)) return name;
  const std::string file =
      name.size() > 5 && name.substr(name.size() - 5) == ".toml" ? name : name + ".toml";
  char self[PATH_MAX] = {};
  const ssize_t n = ::readlink("/proc/self/exe", self, sizeof self - 1);
  const fs::path program =
      n > 0 ? fs::path(std::string(self, static_cast<std::size_t>(n))).parent_path()
            : fs::path(".");
  const std::array<fs::path, 3> roots{program / "../share/teletact/config",
                                      program / "../../config", fs::path(kSourceConfig)};
  for (const auto& root : roots) {
    if (fs::exists(root / folder / file)) return fs::canonical(root / folder / file).string();
  }
  throw std::runtime_error(name + ": no such file, and no " + folder + "/" + file + " in " +
                           (program / "../share/teletact/config").string());
}

}  // namespace teletact
