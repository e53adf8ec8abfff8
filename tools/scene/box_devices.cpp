#include "tools/scene/box_devices.hpp"

#include <cmath>
#include <cstdio>
#include <numbers>
#include <stdexcept>

#include "drivers/camera/passing_camera.hpp"
#include "drivers/can/socket_port.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/gpio/chip_find.hpp"
#include "drivers/gpio/chip_lines.hpp"
#include "drivers/youbot_bus/chain_wait.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/clock/box_time.hpp"

namespace teletact {

namespace {

// Recordings start this long after the epoch: half a camera period off the releases of capture, so
// that every frame is complete well before the poll that takes it.
constexpr rt::Nanos kRecordingLead = std::chrono::milliseconds{317};

drivers::MotorBus* wrapped(drivers::MotorBus& motors, const BoxOptions& options) {
  return options.wrap_bus ? options.wrap_bus(motors) : &motors;
}

// How the camera of a recording was held is not known: level, at the height of a chest.
perception::Pose held_level() {
  drivers::SyntheticCameraConfig held;
  held.mount_position_m = {0, 0, 1.2};
  held.mount_pitch_deg = 0;
  return held.X_BC();
}

}  // namespace

drivers::TumSequence open_recording(const std::string& dir) {
  drivers::TumOptions options;
  options.register_colour = true;
  auto sequence = drivers::TumSequence::open(dir, options);
  if (sequence && sequence.value().intrinsics().width == 640 &&
      sequence.value().intrinsics().height == 480) {
    options.to_512x424 = true;
    sequence = drivers::TumSequence::open(dir, options);
  }
  if (!sequence) throw std::runtime_error(sequence.error());
  return std::move(sequence).value();
}

bool counts_from_epoch(const Scene& scene) {
  return scene.rgbd_dir.empty() && scene.camera_choice.in_process() && !scene.camera.own_clock();
}

perception::Intrinsics camera_of(const Scene& scene) {
  return scene.rgbd_dir.empty() ? scene.camera.intrinsics()
                                : open_recording(scene.rgbd_dir).intrinsics();
}

namespace {

std::unique_ptr<drivers::youbot_bus::EtherCatYoubot> open_youbot(
    rt::NonRealtime& nrt, const Scene& scene,
    std::unique_ptr<drivers::ethercat::CardClaim>& claim) {
  namespace yb = drivers::youbot_bus;
  const auto refuse = [](const std::string& why) { throw std::runtime_error("robot.bus: " + why); };
  if (scene.bus_interface.empty()) refuse("kind ethercat wants the key robot.bus.interface");
  yb::YoubotConfig c;
  if (!scene.bus_calibration.empty()) {
    auto read = yb::load_calibration(scene.bus_calibration);
    if (!read) refuse("calibration: " + read.error());
    c.calibration = std::move(read.value());
  }
  auto port = drivers::ethercat::RawPort::open(nrt, scene.bus_interface);
  if (!port) refuse(port.error());
  auto claimed = drivers::ethercat::claim_silent_card(nrt, scene.bus_interface);
  if (!claimed) refuse(claimed.error());
  claim = std::move(claimed.value());
  c.chain = scene.bus_chain;
  c.gear_ratio = scene.graph.robot_io.base.gear_ratio;
  c.ignored_flags = static_cast<std::uint32_t>(scene.ignored_flags);
  c.most_current_mA = static_cast<std::int32_t>(std::lround(1e3 * scene.most_current_A));
  c.arm_rest = scene.arm_rest == "free" ? yb::ArmRest::kFree : yb::ArmRest::kHold;
  auto youbot = yb::EtherCatYoubot::open(nrt, std::move(port.value()), c);
  if (!youbot) refuse(scene.bus_interface + ": " + youbot.error());
  youbot.value()->keep_alive(nrt);
  return std::move(youbot.value());
}

}  // namespace

void check_motor_bus(rt::NonRealtime& nrt, const Scene& scene) {
  if (scene.bus_kind == "can")
    (void)drivers::can::open_socket_port(nrt, {scene.can.iface, {}, 1 << 18});
  if (scene.bus_kind != "ethercat" || scene.bus_interface.empty()) return;
  const auto port = drivers::ethercat::RawPort::open(nrt, scene.bus_interface);
  if (!port) throw std::runtime_error("robot.bus: " + port.error());
  const auto claim = drivers::ethercat::CardClaim::take(nrt, scene.bus_interface);
  if (!claim) throw std::runtime_error("robot.bus: " + claim.error());
}

void await_motor_bus(rt::NonRealtime& nrt, const Scene& scene, const std::function<bool()>& ends) {
  if (scene.bus_kind != "ethercat") return;
  const auto& card = scene.bus_interface;
  const auto refuse = [](const std::string& why) { throw std::runtime_error("robot.bus: " + why); };
  if (card.empty()) refuse("kind ethercat wants the key robot.bus.interface");
  auto port = drivers::ethercat::RawPort::open(nrt, card);
  if (!port) refuse(port.error());
  const auto claim = drivers::ethercat::claim_silent_card(nrt, card);
  if (!claim) refuse(claim.error());
  std::string told;
  rt::Time again{};
  const rt::Time begun = port.value()->now();
  const auto all = drivers::youbot_bus::await_chain(
      nrt, *port.value(), scene.bus_chain, [&](const std::string& missing) {
        const rt::Time now = port.value()->now();
        if (missing != told || now >= again) {
          std::fprintf(stderr, "robot.bus: %s: %s; this box waits for it\n", card.c_str(),
                       missing.c_str());
          again = now + std::chrono::minutes{1};
          told = missing;
        }
        return !ends();
      });
  if (!all) refuse(card + ": " + all.error());
  if (told.empty()) return;
  std::fprintf(stderr, "robot.bus: %s: %d slaves answer, after %.0f s\n", card.c_str(), all.value(),
               1e-9 * static_cast<double>((port.value()->now() - begun).count()));
}

// The camera rides on the robot's true pose.
class RobotBox::BasePose final : public drivers::PoseSource {
 public:
  BasePose(const drivers::VirtualYoubot& bus, const perception::Pose& X_BC,
           const perception::Pose& X_WB0)
      : bus_(bus), X_BC_(X_BC), X_WB_(X_WB0) {}
  [[nodiscard]] perception::Pose X_WC_at(rt::Time t) noexcept override {
    drivers::PoseHistory::Sample s;
    if (bus_.history().at(t, s)) {
      X_WB_.linear() = perception::rotation_about_z(s.X_WB.yaw);
      X_WB_.translation() = perception::Vec3(s.X_WB.x, s.X_WB.y, 0);
    }
    return X_WB_ * X_BC_;
  }

 private:
  const drivers::VirtualYoubot& bus_;
  perception::Pose X_BC_, X_WB_;
};

drivers::MotorBus& RobotBox::open_motors(rt::NonRealtime& nrt, const Scene& scene,
                                         const BoxOptions& options) {
  bus_->set_cpu_clock(&rt::thread_cpu_ns);
  if (scene.bus_kind == "can" || scene.bus_kind == "can-twin") {
    can_ = std::make_unique<CanMotors>(nrt, scene, *bus_, options.real_devices);
    return can_->bus();
  }
  if (scene.bus_kind == "ethercat" && options.real_devices) {
    youbot_ = open_youbot(nrt, scene, card_claim_);
    return *youbot_;
  }
  // Where no device is opened the virtual chain stands in for the robot's.
  if (scene.bus_kind == "direct") return *bus_;
  drivers::youbot_bus::MotorBusConfig motors;
  motors.gear_ratio = scene.graph.robot_io.base.gear_ratio;
  wire_ = std::make_unique<drivers::youbot_bus::EtherCatTwinBus>(
      nrt, *bus_, drivers::youbot_bus::EtherCatTwinBus::base_alone(), motors);
  wire_->port().set_cpu_clock(&rt::thread_cpu_ns);
  return *wire_;
}

drivers::SafetyIo* RobotBox::open_safety(rt::NonRealtime& nrt, const Scene& scene,
                                         const BoxOptions& options) {
  if (!scene.gpio.fitted()) return nullptr;
  if (options.real_devices && scene.gpio.kind == "chip") {
    const auto found =
        drivers::gpio::find_chip(scene.gpio, drivers::gpio::chips_of_this_machine(nrt));
    std::printf("robot.gpio: %s\n", found.text.c_str());
    std::fflush(stdout);
    lines_ = drivers::gpio::open_chip_lines(nrt, found.config);
  } else {
    auto twin = std::make_unique<drivers::gpio::GpioTwin>(nrt, scene.gpio.lines());
    twin->follow(nrt, {scene.gpio_events.begin(), scene.gpio_events.end()}, options.epoch);
    simulated_lines_ = twin.get();
    lines_ = std::move(twin);
  }
  safety_ = std::make_unique<drivers::gpio::SafetyChain>(nrt, scene.gpio, *lines_);
  return options.wrap_safety ? options.wrap_safety(*safety_) : safety_.get();
}

RobotTwins RobotBox::twins() noexcept {
  return {bus_.get(), wire_.get(), can_ ? can_->twin() : nullptr, simulated_lines_};
}

void RobotBox::make_safe() noexcept {
  bus_->make_safe();
  if (wire_) wire_->make_safe();
  if (youbot_) youbot_->make_safe();
  if (can_) can_->bus().make_safe();
}

std::int64_t RobotBox::motor_twin_cpu_ns() const noexcept {
  return bus_->twin_cpu_ns() + (wire_ ? wire_->port().twin_cpu_ns() : 0) +
         (can_ ? can_->twin_cpu_ns() : 0);
}

RobotBox::RobotBox(rt::NonRealtime& nrt, const Scene& scene, const BoxOptions& options)
    : world_(std::make_unique<drivers::World>(
          nrt, scene.rgbd_dir.empty() ? scene.world : drivers::WorldConfig{}, options.epoch)),
      endpoint_(nrt, rt::Box::kRobot) {
  const auto& io = scene.graph.robot_io;
  const drivers::World* world = world_.get();
  drivers::CollisionTest collides = [world](const perception::Pose2& X, rt::Time t) {
    return world->robot_collision(X.x, X.y, X.yaw, t) >= 0;
  };
  drivers::RobotPlant plant(nrt, scene.plant, io.base,
                            perception::Pose2{io.start_x_m, io.start_y_m, io.start_yaw_rad},
                            std::move(collides));
  if (world->moves()) plant.things_move();
  bus_ = std::make_unique<drivers::VirtualYoubot>(nrt, scene.bus, std::move(plant));

  tasks::RobotSetup setup;
  setup.bus = wrapped(open_motors(nrt, scene, options), options);
  setup.safety = open_safety(nrt, scene, options);
  setup.bus_twin_cpu = [this] { return motor_twin_cpu_ns(); };
  setup.hash_outputs = options.hash_outputs;
  setup.faults = options.faults;
  setup.mode_gate = options.mode_gate;
  if (!scene.rgbd_dir.empty()) {
    const auto sequence = open_recording(scene.rgbd_dir);
    for (const auto& line : sequence.assumed())
      camera_said_ += (camera_said_.empty() ? "" : "; ") + line;
    camera_ = std::make_unique<drivers::RecordedCamera>(
        nrt, sequence, options.epoch + kRecordingLead, scene.hold_s, options.progress);
  } else if (options.real_devices && !scene.camera_choice.in_process()) {
    camera_ = drivers::open_camera(nrt, scene.camera_choice, options.now, camera_said_);
  } else {
    open_synthetic(nrt, scene, options, setup);
  }
  frame_arrivals_ = camera_->arrivals();
  camera_ = drivers::without_bias(nrt, std::move(camera_), scene.camera_choice.bias);
  if (options.passer_from) {
    camera_ = std::make_unique<drivers::PassingCamera>(
        nrt, std::move(camera_), scene.rgbd_dir.empty() ? scene.camera.true_X_BC() : held_level(),
        *options.passer_from);
  }
  setup.camera = options.wrap_camera ? options.wrap_camera(*camera_) : camera_.get();
  graph_ = std::make_unique<tasks::RobotGraph>(nrt, scene.graph, setup);
  graph_->bind_link(nrt, endpoint_);
}

void RobotBox::open_synthetic(rt::NonRealtime& nrt, const Scene& scene, const BoxOptions& options,
                              tasks::RobotSetup& setup) {
  pose_ = std::make_unique<BasePose>(*bus_, scene.camera.true_X_BC(), scene.start_X_WB());
  auto synthetic =
      std::make_unique<drivers::SyntheticCamera>(nrt, scene.camera, *world_, *pose_, options.epoch);
  camera_effects_ = synthetic->noise().constructed();
  mount_off_ = scene.camera.true_mount.differs;
  if (scene.robot != nullptr) {
    synthetic->carry(
        nrt, std::make_unique<drivers::ScriptedArm>(nrt, scene.arm, *scene.robot, options.epoch));
    arm_effects_ = synthetic->arm()->effects();
  }
  if (options.threaded_camera) {
    auto threaded =
        std::make_unique<drivers::ThreadedCamera>(nrt, std::move(synthetic), options.now);
    threaded_ = threaded.get();
    camera_ = std::move(threaded);
  } else {
    synthetic_ = synthetic.get();
    setup.camera_twin_cpu = [this] { return synthetic_->twin_cpu_ns(); };
    camera_ = std::move(synthetic);
  }
}

std::int64_t RobotBox::camera_twin_cpu_ns() const noexcept {
  return threaded_ != nullptr    ? threaded_->twin_cpu_ns()
         : synthetic_ != nullptr ? synthetic_->twin_cpu_ns()
                                 : 0;
}

Effects RobotBox::effects() const {
  Effects out;
  if (!camera_said_.empty()) out.emplace_back("camera: " + camera_said_, "camera.kind");
  for (const auto& name : camera_effects_)
    out.emplace_back("camera noise: " + name, "camera.noise");
  if (mount_off_) out.emplace_back("camera: true_mount", "camera.true_mount");
  if (world_->moves()) out.emplace_back("world: things that move", "world.mover");
  for (const auto& name : arm_effects_) out.emplace_back("robot: " + name, "robot.arm");
  if (youbot_) out.emplace_back("motors: youBot " + youbot_->description(), "robot.bus.interface");
  for (const auto& name : bus_->plant().effects())
    out.emplace_back("robot: " + name, "robot.plant");
  return out;
}

OperatorBox::OperatorBox(rt::NonRealtime& nrt, const Scene& scene,
                         const perception::Intrinsics& camera, const BoxOptions& options)
    : scene_(scene), camera_(camera), endpoint_(nrt, rt::Box::kOperator) {
  hand_ = std::make_unique<drivers::HandScript>(nrt, scene.hand, scene.workspace());
  device_ = open_haptic_device(nrt, scene, *hand_, options.epoch, options.real_devices);

  tasks::OperatorSetup setup;
  setup.device = options.wrap_device ? options.wrap_device(device_->device()) : &device_->device();
  setup.device_twin_cpu = device_->twin_cpu();
  setup.hash_outputs = options.hash_outputs;
  setup.faults = options.faults;
  setup.mode_gate = options.mode_gate;
  if (options.now) setup.decoded = [this, now = options.now] { decoded_.try_push(now()); };
  setup.fusion.camera = camera;
  if (scene.rgbd_dir.empty()) {
    setup.fusion.X_BC = scene.camera.X_BC();
    // A real camera's frames come without joints: nobody reports them yet.
    if (!options.real_devices || scene.camera_choice.in_process()) setup.fusion.robot = scene.robot;
    setup.fusion.X_WC0 = scene.start_X_WB() * setup.fusion.X_BC;
    setup.fusion.ground.up_known = true;
    setup.fusion.ground.start_W = scene.start_X_WB().translation();
    setup.fusion.ground.camera_height_m = scene.camera.mount_position_m[2];
  } else {
    setup.odometry_prior = false;
  }
  graph_ = std::make_unique<tasks::OperatorGraph>(nrt, scene.graph, setup, 1e-3);
  graph_->bind_link(nrt, endpoint_);
}

Effects OperatorBox::effects() const {
  Effects out;
  for (const auto& name : device_->effects()) out.emplace_back("device: " + name, "device");
  if (scene_.link.shape.any()) out.emplace_back("link shape", "link.shape");
  if (scene_.link.network.any()) out.emplace_back("link network", "link.network");
  const auto& h = scene_.graph.haptic;
  const auto add = [&](bool on, const char* name, const char* key) {
    if (on) out.emplace_back(name, key);
  };
  add(h.friction_static > 0, "touch: friction", "haptic.friction_static");
  add(h.texture_amplitude_m > 0, "touch: texture", "haptic.texture_amplitude_m");
  add(h.viscosity_N_s_per_m > 0, "touch: viscosity", "haptic.viscosity_N_s_per_m");
  add(h.materials, "touch: materials", "haptic.materials");
  add(h.asks_for_ray_cast(), "touch: force shading", "haptic.method");
  add(scene_.graph.fusion.objects.enabled, "objects in the map", "fusion.objects.enabled");
  add(scene_.graph.fusion.mesh_blocks > 0, "mesh for the console", "fusion.mesh_blocks");
  return out;
}

}  // namespace teletact
