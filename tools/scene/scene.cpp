#include "tools/scene/scene.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <set>
#include <span>
#include <stdexcept>

#include "drivers/youbot/motor_flags.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/map_file/map_file.hpp"
#include "tasks/graph/safe_times.hpp"
#include "tools/files/build_info.hpp"

namespace teletact {

namespace {

// Of the first root that has the folder, sorted.
std::string names_in(std::span<const std::filesystem::path> roots, const std::string& folder) {
  namespace fs = std::filesystem;
  std::set<std::string> names;
  for (const fs::path& root : roots) {
    std::error_code ec;
    for (const fs::directory_entry& entry : fs::directory_iterator(root / folder, ec))
      if (entry.path().extension() == ".toml") names.insert(entry.path().stem().string());
    if (!names.empty()) break;
  }
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "(none is installed there)" : list;
}

// A stored map fixes the voxel: a scene that names none takes the map's.
void settle_stored_map(Scene& scene, const std::string& path) {
  namespace fs = std::filesystem;
  auto& fusion = scene.graph.fusion;
  if (fusion.map.empty()) return;
  // As given, or beside the scene's file; whole, so that a saved scene finds it too.
  const fs::path beside = fs::path(path).parent_path() / fusion.map;
  fusion.map = fs::absolute(fs::exists(fusion.map) ? fs::path(fusion.map) : beside).string();
  rt::Startup startup;
  const auto file = perception::read_map_file(startup.token(), fusion.map);
  if (!file) throw std::runtime_error("fusion.map: " + file.error());
  config::Section* tsdf = &scene.schema.section("fusion").section("tsdf");
  const double voxel_m = file.value().info.voxel_size_m;
  if (!tsdf->named("voxel_size_m")) {
    fusion.tsdf.voxel_size_m = voxel_m;
    tsdf->find("voxel_size_m")->named = true;
  }
  if (std::abs(fusion.tsdf.voxel_size_m - voxel_m) > 1e-9)
    throw std::runtime_error("fusion.map: " + fusion.map + " has voxels of " +
                             std::to_string(voxel_m) + " m, fusion.tsdf.voxel_size_m is " +
                             std::to_string(fusion.tsdf.voxel_size_m));
}

}  // namespace

void EditConfig::describe(config::Section& s) {
  s.text("kind", kind, {"clear", "disc", "box", "erase"}, "what is asked")
      .number("at_s", at_s, 0, 864000, "when, from the start of the run")
      .text("source", source, {"point", "pixel"}, "where the centre comes from")
      .numbers("position_m", position_m, -1000, 1000, "of the centre, in W")
      .numbers("pixel", pixel, 0, 8192, "of the depth image: the surface seen there is the centre")
      .numbers("size_m", size_m, 0.01, tasks::FusionTask::kLongestClear_m,
               "edges of a box; of a no-go box the first two")
      .number("radius_m", radius_m, 0.01, 10, "of a no-go disc")
      .number("yaw_deg", yaw_deg, -360, 360, "of a no-go box, about up")
      .integer("id", id, 0, 65535, "of a no-go area, from 1; erase: 0 is all");
}

tasks::SceneEdit EditConfig::edit(const perception::Vec3& centre_W) const {
  using Kind = tasks::SceneEdit::Kind;
  tasks::SceneEdit e;
  e.kind = kind == "clear"  ? Kind::kClear
           : kind == "disc" ? Kind::kDrawDisc
           : kind == "box"  ? Kind::kDrawBox
                            : Kind::kErase;
  e.id = static_cast<std::uint16_t>(id);
  for (std::size_t a = 0; a < 3; ++a) {
    e.centre_W[a] = centre_W(static_cast<Eigen::Index>(a));
    e.half_m[a] = size_m[a] / 2;
  }
  if (e.kind == Kind::kDrawDisc) e.half_m[0] = radius_m;
  e.yaw_rad = yaw_deg * std::numbers::pi / 180.0;
  return e;
}

drivers::LinkShapeConfig LinkConfig::way() const {
  if (!network.any()) return shape;
  return {network.delay_ms, network.jitter_ms, network.rate_Mbit_per_s, network.seed};
}

void Scene::describe(config::Section& s) {
  s.text("title", title, {}, "name of the scene in reports");
  world.describe(s.section("world", "the simulated place"));
  auto& eye = s.section("camera", "RGB-D camera, its twin and its mount");
  camera.describe(eye);
  camera_choice.describe(eye);
  auto& robot_section = s.section("robot", "twin of the youBot");
  plant.describe(robot_section.section("plant", "wheels, motors, floor"));
  auto& motor_bus = robot_section.section("bus", "motor bus");
  bus.describe(motor_bus);
  motor_bus
      .text("kind", bus_kind, {"direct", "ethercat-twin", "ethercat", "can-twin", "can"},
            "what carries setpoints: to the virtual motors nothing, EtherCAT frames or CAN frames; "
            "to a youBot's, frames on a network card; or a CAN bus (virtual where no device is "
            "opened)")
      .text("interface", bus_interface, {}, "kind ethercat: the network card, as eth1")
      .text("chain", bus_chain, {"any", "base", "base+arm", "base+2arms"},
            "kind ethercat: what must be on the bus")
      .text("arm_rest", arm_rest, {"hold", "free"},
            "kind ethercat: with the wheels off, the arm holds its position, or is without torque "
            "and sinks");
  motor_bus
      .integer("ignored_flags", ignored_flags, 0, static_cast<int>(drivers::motor_flag::kFaults),
               "kind ethercat: sum of 2^bit of fault flags that are taken as 0, where a board's "
               "firmware sets one without a meaning (docs/robot.md)")
      .number("most_current_A", most_current_A, 0, 20,
              "kind ethercat: a drive that may take more (axis parameter 6) is refused at start; "
              "0: any");
  motor_bus.text("calibration", bus_calibration, {},
                 "kind ethercat: file of teletact youbot setup --calibration; another robot's is "
                 "refused");
  can.describe(motor_bus.section("can", "TMCL modules on a CAN bus"));
  auto& lines = robot_section.section("gpio", "emergency stop, enable switch, heartbeat, lamp");
  gpio.describe(lines);
  lines.list(
      "event", [this](config::Section& item) { gpio_events.emplace_back().describe(item); },
      "what people and faults do to the simulated lines");
  arm.describe(robot_section.section("arm", "effect: its arm, in view of the camera"));
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
  X.linear() = perception::rotation_about_z(graph.robot_io.start_yaw_rad);
  return X;
}

namespace {

// Read once, and the arm's script held against it, before anything is built.
void settle_arm(Scene& scene, const std::string& path) {
  const drivers::ScriptedArmConfig& arm = scene.arm;
  if (!arm.present()) {
    // A saved scene names every key, each at its default.
    const drivers::ScriptedArmConfig none;
    if (arm.description != none.description || arm.joint_delay_ms != none.joint_delay_ms ||
        arm.joint_error_deg != none.joint_error_deg || arm.stated_age_ms != none.stated_age_ms ||
        arm.stated_error_deg != none.stated_error_deg)
      throw std::runtime_error(path +
                               ": key 'robot.arm.key' = []: allowed one or more where "
                               "[robot.arm] asks for anything");
    return;
  }
  std::string file;
  try {
    file = find_config("robots", arm.description);
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(path + ": key 'robot.arm.description': " + e.what());
  }
  auto robot = perception::load_robot(file);
  if (!robot) throw std::runtime_error(robot.error());
  scene.robot = std::make_shared<perception::RobotDescription>(std::move(robot).value());
  rt::Startup startup;
  try {
    const drivers::ScriptedArm check(startup.token(), scene.arm, *scene.robot, rt::Time{});
  } catch (const std::invalid_argument& e) {
    throw std::runtime_error(path + ": " + e.what());
  }
}

void check_network(const Scene& scene, const std::string& path) {
  const drivers::NetworkConfig& network = scene.link.network;
  if (const std::string wrong = network.wrong(); !wrong.empty())
    throw std::runtime_error(path + ": " + wrong);
  if (network.any() && scene.link.shape.any())
    throw std::runtime_error(
        path + ": keys 'link.network' and 'link.shape': allowed one of them in a scene");
}

// What no single key can be wrong about: names of shapes, ways of length 0.
void check_movers(const Scene& scene, const std::string& path) {
  if (scene.world.movers.empty()) return;
  rt::Startup startup;
  try {
    const drivers::World check(startup.token(), scene.world);
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(path + ": " + e.what());
  }
}

}  // namespace

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
  settle_stored_map(*scene, path);
  settle_arm(*scene, path);
  check_movers(*scene, path);
  check_network(*scene, path);
  auto& edits = scene->operator_script.edits;
  std::stable_sort(edits.begin(), edits.end(),
                   [](const EditConfig& a, const EditConfig& b) { return a.at_s < b.at_s; });
  for (const EditConfig& e : edits) {
    if (e.id == 0 && (e.kind == "disc" || e.kind == "box"))
      throw std::runtime_error(path +
                               ": operator.edit.id = 0: a no-go area has a number from 1 on");
  }
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
                                      program / "../../config", fs::path(kSourceFolder) / "config"};
  for (const auto& root : roots) {
    if (fs::exists(root / folder / file)) return fs::canonical(root / folder / file).string();
  }
  throw std::runtime_error(name + ": is not a file, and none of the names in config/" + folder +
                           ": " + names_in(roots, folder));
}

}  // namespace teletact
