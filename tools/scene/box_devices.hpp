// The two boxes with their devices' twins: what a process of the demo holds.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/camera/recorded_camera.hpp"
#include "drivers/camera/synthetic_camera.hpp"
#include "drivers/camera/threaded_camera.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "drivers/ethercat/card_claim.hpp"
#include "drivers/gpio/safety_chain.hpp"
#include "drivers/gpio/twin/gpio_twin.hpp"
#include "drivers/haptic/hand_script.hpp"
#include "drivers/link/endpoint.hpp"
#include "drivers/omega/omega_twin.hpp"
#include "drivers/world/world.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/fault/plan.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/robot_graph.hpp"
#include "tools/scene/can_motors.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

struct BoxOptions {
  rt::Time epoch{};  // in this box's clock
  bool hash_outputs = false;
  bool real_devices = false;      // opens the devices that the scene names; else twins stand in
  bool threaded_camera = false;   // real clock: render on an ordinary thread
  std::function<rt::Time()> now;  // box clock, for ordinary threads; empty: the virtual clock
  rt::FaultPlan faults;
  rt::ModeGate mode_gate;
  std::function<void(int, int)> progress;  // of decoding a recording
  // Calibration: from this instant on somebody walks before the camera (passing_camera.hpp).
  std::optional<rt::Time> passer_from;
  // What stands between a task and its device's twin; empty: nothing.
  std::function<drivers::HapticDevice*(drivers::HapticDevice&)> wrap_device;
  std::function<drivers::MotorBus*(drivers::MotorBus&)> wrap_bus;
  std::function<drivers::Camera*(drivers::Camera&)> wrap_camera;
  std::function<drivers::SafetyIo*(drivers::SafetyIo&)> wrap_safety;
};

// What a twin or effect constructed in this run is called, and which key called for it.
using Effects = std::vector<std::pair<std::string, std::string>>;

// The robot's simulated devices, for what a test does to them; null: this scene has none.
struct RobotTwins {
  drivers::VirtualYoubot* base = nullptr;
  drivers::youbot_bus::EtherCatTwinBus* chain = nullptr;
  drivers::can::CanTwinBus* can = nullptr;
  drivers::gpio::GpioTwin* lines = nullptr;
};

class RobotBox {
 public:
  RobotBox(rt::NonRealtime&, const Scene&, const BoxOptions&);
  [[nodiscard]] tasks::RobotGraph& graph() noexcept { return *graph_; }
  [[nodiscard]] drivers::LinkEndpoint& endpoint() noexcept { return endpoint_; }
  [[nodiscard]] drivers::VirtualYoubot& bus() noexcept { return *bus_; }
  [[nodiscard]] RobotTwins twins() noexcept;
  // Motor stop on whatever bus there is, from any thread.
  void make_safe() noexcept;
  [[nodiscard]] const drivers::World& world() const noexcept { return *world_; }
  [[nodiscard]] Effects effects() const;
  [[nodiscard]] std::int64_t camera_twin_cpu_ns() const noexcept;
  // When frames come, where they come by themselves; else null.
  [[nodiscard]] drivers::FrameArrivals* frame_arrivals() noexcept { return frame_arrivals_; }

 private:
  class BasePose;
  // What robot_io drives, and what of its CPU is the twins'.
  drivers::MotorBus& open_motors(rt::NonRealtime&, const Scene&, const BoxOptions&);
  [[nodiscard]] std::int64_t motor_twin_cpu_ns() const noexcept;
  void open_synthetic(rt::NonRealtime&, const Scene&, const BoxOptions&, tasks::RobotSetup&);
  // Null: the scene asks for no safety lines.
  drivers::SafetyIo* open_safety(rt::NonRealtime&, const Scene&, const BoxOptions&);
  std::unique_ptr<drivers::World> world_;
  std::unique_ptr<drivers::VirtualYoubot> bus_;
  // Before it, or in its place, as the scene asks.
  std::unique_ptr<drivers::youbot_bus::EtherCatTwinBus> wire_;
  std::unique_ptr<CanMotors> can_;
  std::unique_ptr<drivers::gpio::GpioLines> lines_;
  drivers::gpio::GpioTwin* simulated_lines_ = nullptr;
  std::unique_ptr<drivers::gpio::SafetyChain> safety_;
  std::unique_ptr<drivers::ethercat::CardClaim> card_claim_;  // outlives the youBot
  std::unique_ptr<drivers::youbot_bus::EtherCatYoubot> youbot_;
  std::unique_ptr<drivers::PoseSource> pose_;
  std::unique_ptr<drivers::Camera> camera_;
  drivers::SyntheticCamera* synthetic_ = nullptr;
  drivers::ThreadedCamera* threaded_ = nullptr;
  drivers::FrameArrivals* frame_arrivals_ = nullptr;
  std::vector<std::string> camera_effects_, arm_effects_;
  bool mount_off_ = false;
  std::string camera_said_;  // of a real one
  std::unique_ptr<tasks::RobotGraph> graph_;
  drivers::LinkEndpoint endpoint_;
};

class OperatorBox {
 public:
  OperatorBox(rt::NonRealtime&, const Scene&, const perception::Intrinsics& camera,
              const BoxOptions&);
  // Of the frames that arrive.
  [[nodiscard]] const perception::Intrinsics& camera() const noexcept { return camera_; }
  [[nodiscard]] tasks::OperatorGraph& graph() noexcept { return *graph_; }
  [[nodiscard]] drivers::LinkEndpoint& endpoint() noexcept { return endpoint_; }
  [[nodiscard]] drivers::HandScript& hand() noexcept { return *hand_; }
  [[nodiscard]] drivers::HapticDevice& device() noexcept { return device_->device(); }
  [[nodiscard]] bool person_simulated() const noexcept { return device_->person_simulated(); }
  // When fusion could take each picture. On the virtual clock none is told of.
  [[nodiscard]] drivers::FrameArrivals& decoded() noexcept { return decoded_; }
  [[nodiscard]] Effects effects() const;

 private:
  const Scene& scene_;
  perception::Intrinsics camera_;
  std::unique_ptr<drivers::HandScript> hand_;
  std::unique_ptr<OpenedDevice> device_;
  drivers::FrameArrivals decoded_;
  std::unique_ptr<tasks::OperatorGraph> graph_;
  drivers::LinkEndpoint endpoint_;
};

// A recording as the demo plays it: 640 x 480 brought to the 512 x 424 of a Kinect v2, as `teletact
// fuse` does. Throws std::runtime_error with the reader's message.
[[nodiscard]] drivers::TumSequence open_recording(const std::string& dir);

// The camera's frames begin at the box's epoch and keep its clock: a twin without a clock of its
// own. Of a recording or a real camera the phase is not known.
[[nodiscard]] bool counts_from_epoch(const Scene& scene);

// Before anything is measured: throws std::runtime_error with one line if the motor bus that the
// scene names can not be opened, or belongs to another program. It sends nothing.
void check_motor_bus(rt::NonRealtime&, const Scene& scene);

// Waits until the boards of the chain that the scene names answer; says on standard error what is
// missing, when it changes and once a minute. Throws std::runtime_error where `ends` says so, with
// what is missing. Where there is nothing to wait for it does nothing.
void await_motor_bus(rt::NonRealtime&, const Scene& scene, const std::function<bool()>& ends);

// Depth camera of the scene: the recording's if it names one, else the synthetic one's.
[[nodiscard]] perception::Intrinsics camera_of(const Scene& scene);

}  // namespace teletact
