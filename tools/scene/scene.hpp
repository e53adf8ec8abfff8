// A scene file, whole: the place, the twins of the devices, the network's shape, and every task's
// section. What a scene does not name is not simulated.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "config/schema.hpp"
#include "drivers/camera/camera_choice.hpp"
#include "drivers/camera/synthetic_camera.hpp"
#include "drivers/can/can_motor_bus.hpp"
#include "drivers/emulator/network_config.hpp"
#include "drivers/gpio/gpio_config.hpp"
#include "drivers/gpio/twin/gpio_twin.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "drivers/link/shaper.hpp"
#include "drivers/omega/omega_twin.hpp"
#include "drivers/world/world_config.hpp"
#include "drivers/youbot/robot_plant.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "tasks/contract/scene_edit.hpp"
#include "tasks/graph/graph_config.hpp"
#include "tools/scene/haptic_choice.hpp"

namespace teletact {

// [[operator.edit]]: what the operator asks of the scene at an instant
// (tasks/contract/scene_edit.hpp).
//
//   [[operator.edit]]
//   kind = "clear"            # forget a box; "disc", "box": a no-go area; "erase": one of these,
//                             or all
//   at_s = 6
//   position_m = [1, 0, 0.2]  # of the centre, in W; or source = "pixel", pixel = [u, v]: the
//   surface that size_m = [0.4, 0.4, 0.4]  # the console's picture shows there
struct EditConfig {
  std::string kind = "clear";
  double at_s = 0;
  std::string source = "point";  // or "pixel"
  std::array<double, 3> position_m{};
  std::array<double, 2> pixel{};                // u right, v down, of the depth image
  std::array<double, 3> size_m{0.3, 0.3, 0.3};  // edges; of a no-go box the first two
  double radius_m = 0.15;                       // of a disc
  double yaw_deg = 0;                           // of a no-go box
  int id = 1;                                   // of a no-go area; erase: 0 = all of them
  void describe(config::Section& s);
  // `centre_W`: position_m, or what the pixel showed.
  [[nodiscard]] tasks::SceneEdit edit(const perception::Vec3& centre_W) const;
};

// Section [operator]: what the person at the desk does beside moving the hand.
struct OperatorScript {
  double engage_after_s = 1.0;
  double re_engage_after_s = 1.0;  // 0: never
  std::deque<EditConfig> edits;    // in order of time
  void describe(config::Section& s) {
    s.list(
        "edit", [this](config::Section& item) { edits.emplace_back().describe(item); },
        "what the operator asks of the scene");
    s.number("engage_after_s", engage_after_s, 0, 3600,
             "the operator engages the robot then, and again until it is followed");
    s.number("re_engage_after_s", re_engage_after_s, 0, 3600,
             "after a fault that has cleared, the operator engages again, after a safe stop "
             "clears first; 0: never");
  }
};

// Section [link].
struct LinkConfig {
  std::string address = "127.0.0.1";
  int port = 0;  // 0: the kernel chooses
  drivers::LinkShapeConfig shape;
  drivers::NetworkConfig network;
  void describe(config::Section& s) {
    s.text("address", address, {}, "loopback only, until the link is authenticated");
    s.integer("port", port, 0, 65535, "0: chosen by the kernel");
    shape.describe(s.section("shape", "effect: the loopback link shaped like a network"));
    network.describe(s.section("network", "effect: a bad network between the boxes"));
  }
  // Delay, jitter and rate of the way as it begins, whichever of the two says so.
  [[nodiscard]] drivers::LinkShapeConfig way() const;
};

struct Scene {
  std::string title = "scene";
  drivers::WorldConfig world;
  drivers::SyntheticCameraConfig camera;
  drivers::CameraChoice camera_choice;
  drivers::ScriptedArmConfig arm;
  drivers::RobotPlantConfig plant;
  drivers::VirtualYoubotConfig bus;
  std::string bus_kind = "direct";
  drivers::can::CanMotorConfig can;
  drivers::gpio::GpioConfig gpio;
  std::deque<drivers::gpio::TwinEvent> gpio_events;
  std::string bus_interface, bus_chain = "any", arm_rest = "hold", bus_calibration;
  int ignored_flags = 0;
  double most_current_A = 0;
  drivers::OmegaTwinConfig device;
  HapticChoice choice;
  drivers::HandScriptConfig hand;
  OperatorScript operator_script;
  LinkConfig link;
  tasks::GraphConfig graph;

  std::shared_ptr<const perception::RobotDescription> robot;  // null: no arm in view

  // Of a recording: the camera is the recording's, world and robot are not in it.
  std::string rgbd_dir;
  double hold_s = 15.0;

  config::Section schema;  // describes this object; it must not move
  Scene() {
    // Effects too: a scene asks for them.
    plant.speed_loop_order = 0;
    device.coulomb_N = 0;
    device.quantum_m = 0;
    describe(schema);
  }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  [[nodiscard]] drivers::WorkspaceMap workspace() const;
  // Radius of the base for planning and the pose at the start, in the forms the tasks take.
  [[nodiscard]] perception::Pose start_X_WB() const;

 private:
  void describe(config::Section& s);
};

// Reads the file, then the overrides ("a.b=value"). Throws std::runtime_error with one line.
[[nodiscard]] std::unique_ptr<Scene> load_scene(const std::string& path,
                                                const std::vector<std::string>& overrides);
// A scene by name ("default_room") or path: looks beside the program, in the source tree and in the
// installed share folder.
[[nodiscard]] std::string find_config(const std::string& folder, const std::string& name);

}  // namespace teletact
