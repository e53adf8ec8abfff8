#include "tools/scene/effect_catalogue.hpp"

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>

#include "tasks/graph/static_choices.hpp"
#include "tools/scene/box_devices.hpp"

namespace teletact {

namespace {

constexpr const char* kCamera = "camera's twin";
constexpr const char* kBase = "base's twin";
constexpr const char* kDevice = "device's twin";

constexpr std::array kRows{
    EffectRow{"camera noise: axial", "camera.noise.axial", kCamera,
              "readings scatter along the ray as a Kinect v2's do",
              "[camera.noise]\naxial = 1.0\n"},
    EffectRow{"camera noise: lateral_px", "camera.noise.lateral_px", kCamera,
              "a ray goes beside its pixel", "[camera.noise]\nlateral_px = 0.3\n"},
    EffectRow{"camera noise: edge_dropout", "camera.noise.edge_dropout", kCamera,
              "no reading beside depth edges", "[camera.noise]\nedge_dropout = 0.5\n"},
    EffectRow{"camera noise: flying", "camera.noise.flying", kCamera,
              "readings between the near and the far side of an edge",
              "[camera.noise]\nflying = 0.02\n"},
    EffectRow{"camera: true_mount", "camera.true_mount.differs", kCamera,
              "the camera is not mounted as mount_* says",
              "[camera.true_mount]\ndiffers = true\npitch_deg = 28\n"},
    EffectRow{"world: things that move", "world.mover", kCamera,
              "shapes of the place follow a path, in view and in the base's way",
              "[[world.box]]\nname = \"block\"\nsize_m = [0.2, 0.2, 0.2]\nposition_m = [3, 0, 1]\n"
              "[[world.mover]]\nname = \"slide\"\nshapes = \"block\"\nkind = \"shuttle\"\n"
              "way_m = [0.3, 0, 0]\n"},
    EffectRow{"robot: an arm before the camera", "robot.arm.key", kCamera,
              "the robot's own arm is in the image, and its joints are in the frames",
              "[robot.arm]\ndescription = \"youbot\"\n[[robot.arm.key]]\ntime_s = 1\n"
              "angles_deg = [169, 10, -10, 10, 167.5]\n"},
    EffectRow{"robot: joints reported late", "robot.arm.joint_delay_ms", kCamera,
              "the arm's joints in a frame are older than the image",
              "[robot.arm]\ndescription = \"youbot\"\njoint_delay_ms = 20\n[[robot.arm.key]]\n"
              "time_s = 1\nangles_deg = [169, 10, -10, 10, 167.5]\n"},
    EffectRow{"robot: joints reported wrong", "robot.arm.joint_error_deg", kCamera,
              "each joint of the arm is reported so far off",
              "[robot.arm]\ndescription = \"youbot\"\njoint_error_deg = 0.5\n[[robot.arm.key]]\n"
              "time_s = 1\nangles_deg = [169, 10, -10, 10, 167.5]\n"},
    EffectRow{"robot: motor_dynamics", "robot.plant.speed_loop_order", kBase,
              "motors with a speed loop on the base's inertia",
              "[robot.plant]\nspeed_loop_order = 2\n"},
    EffectRow{"robot: slip", "robot.plant.slip_ratio", kBase,
              "travel is lost between wheel and floor", "[robot.plant]\nslip_ratio = 0.05\n"},
    EffectRow{"robot: wheel_slip", "robot.plant.wheel_slip_max", kBase,
              "each wheel loses a share of its travel, drawn anew every wheel_slip_redraw_s",
              "[robot.plant]\nwheel_slip_max = 0.1\n"},
    EffectRow{"robot: wheel_radius", "robot.plant.wheel_radius_error", kBase,
              "wheels are not of the radius that odometry takes them for",
              "[robot.plant]\nwheel_radius_error = [-0.01, -0.01, -0.01, -0.01]\n"},
    EffectRow{"robot: encoder_quantisation", "robot.plant.encoder_ticks_per_motor_turn", kBase,
              "wheel angles come in whole encoder ticks",
              "[robot.plant]\nencoder_ticks_per_motor_turn = 4000\n"},
    EffectRow{"robot: dead_time", "robot.plant.dead_time_s", kBase,
              "a setpoint reaches the motor late", "[robot.plant]\ndead_time_s = 0.005\n"},
    EffectRow{"robot: gear_friction", "robot.plant.gear_friction_Nm", kBase,
              "Coulomb friction at the wheels", "[robot.plant]\ngear_friction_Nm = 0.3\n"},
    EffectRow{"device: device_friction", "device.coulomb_N", kDevice,
              "dry friction of the haptic device", "[device]\ncoulomb_N = 0.1\n"},
    EffectRow{"device: position_quantum", "device.quantum_m", kDevice,
              "positions come in steps of the encoders", "[device]\nquantum_m = 1e-5\n"},
    EffectRow{"device: device_delay", "device.delay_s", kDevice, "a force acts later than the hold",
              "[device]\ndelay_s = 0.0005\n"},
    EffectRow{"device: time_guard", "device.time_guard_s", kDevice,
              "reads too near to each other repeat the sample",
              "[device]\ntime_guard_s = 0.0005\n"},
    EffectRow{"device: gravity", "device.gravity_mass_kg", kDevice, "weight of the device's arm",
              "[device]\ngravity_mass_kg = 0.2\n"},
    EffectRow{"device: hand", "hand.segment", kDevice,
              "a hand of mass, spring and damping moves the device by a script, and forces move it",
              "[[hand.segment]]\nkind = \"move\"\npoint_m = [1, 0, 0.3]\nnormal = [0, 0, 1]\n"
              "time_s = 1\n"},
    EffectRow{"link shape", "link.shape", "link's thread",
              "messages are delayed, jittered and limited in rate as on a network",
              "[link.shape]\ndelay_ms = 30\n"},
    EffectRow{
        "link network", "link.network", "link's thread",
        "the link's bytes meet a bad network: rate, queue, delay, stalls, cuts, flaps, damage",
        "[link.network]\nrate_Mbit_per_s = 100\ndelay_ms = 30\n"},
    EffectRow{"touch: friction", "haptic.friction_static", "haptic",
              "the tip sticks to a surface and slides along it",
              "[haptic]\nfriction_static = 0.3\n"},
    EffectRow{"touch: texture", "haptic.texture_amplitude_m", "haptic",
              "a fine relief on every surface", "[haptic]\ntexture_amplitude_m = 0.0002\n"},
    EffectRow{"touch: viscosity", "haptic.viscosity_N_s_per_m", "haptic",
              "drag while the hand is in contact", "[haptic]\nviscosity_N_s_per_m = 1\n"},
    EffectRow{"touch: materials", "haptic.materials", "haptic",
              "stiffness and friction of each object", "[haptic]\nmaterials = true\n"},
    EffectRow{"touch: force shading", "haptic.method", "fusion",
              "touch by the published method: a ray cast of the map, some rows a period; haptic "
              "takes the "
              "nearest of its points every tick",
              "[haptic]\nmethod = \"force_shading\"\n"},
    EffectRow{"objects in the map", "fusion.objects.enabled", "fusion",
              "each voxel knows which object it is of", "[fusion.objects]\nenabled = true\n"},
    EffectRow{"mesh for the console", "fusion.mesh_blocks", "fusion",
              "changed blocks are meshed and sent to a viewer", "[fusion]\nmesh_blocks = 100\n"},
};

// The value in force at a dotted key, as the scene's effective file has it.
std::string value_of(const Scene& scene, const std::string& key) {
  const auto cut = key.rfind('.');
  const std::string table = "[" + key.substr(0, cut) + "]", name = key.substr(cut + 1) + " = ";
  std::istringstream in(config::effective(scene.schema));
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    if (line.rfind('[', 0) == 0) inside = line == table;
    if (inside && line.rfind(name, 0) == 0) return line.substr(name.size());
  }
  return "";
}

}  // namespace

std::span<const EffectRow> effect_catalogue() { return kRows; }

const EffectRow* effect_named(const std::string& name) {
  const auto row =
      std::find_if(kRows.begin(), kRows.end(), [&](const EffectRow& r) { return name == r.name; });
  return row == kRows.end() ? nullptr : &*row;
}

Explained explain_effects(rt::NonRealtime& nrt, Scene& scene) {
  // What admission would choose; effects do not hang on it.
  if (!scene.schema.section("fusion").section("tsdf").named("voxel_size_m"))
    scene.graph.fusion.tsdf.voxel_size_m = tasks::kFloorVoxel_m;
  const BoxOptions options;
  Effects built;
  {
    const RobotBox robot(nrt, scene, options);
    built = robot.effects();
  }
  const OperatorBox op(nrt, scene, camera_of(scene), options);
  for (const auto& effect : op.effects()) built.push_back(effect);
  Explained out;
  for (const auto& [name, key] : built) {
    const EffectRow* row = effect_named(name);
    if (row == nullptr) throw std::logic_error("effect '" + name + "' is not in the catalogue");
    out.asked.push_back({row, value_of(scene, row->key)});
  }
  for (const EffectRow& row : kRows) {
    if (std::none_of(out.asked.begin(), out.asked.end(),
                     [&](const ExplainedEffect& e) { return e.row == &row; }))
      out.not_asked.push_back(&row);
  }
  return out;
}

}  // namespace teletact
