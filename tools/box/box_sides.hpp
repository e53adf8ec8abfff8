// What differs between the two boxes' processes: what they hold, and which end of the demo's one
// connection they are.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "drivers/link/tcp_link.hpp"
#include "rt/sched/task.hpp"
#include "tools/box/box_main.hpp"
#include "tools/box/release_follower.hpp"
#include "tools/host/run_results.hpp"
#include "tools/scene/box_devices.hpp"

namespace teletact {

class OperatorSide {
 public:
  static constexpr rt::Box kBox = rt::Box::kOperator;
  static constexpr const char* kName = "operator";

  OperatorSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
               const BoxOptions& box_options);
  static void complete(BoxOptions& box_options) { box_options.real_devices = true; }
  // Connects to the port that the robot's process wrote down.
  [[nodiscard]] static rt::Result<std::unique_ptr<drivers::TcpLink>> open_link(const Scene& scene,
                                                                               const BoxPlan& plan);
  void tick(rt::Time t, drivers::LinkTransport& link);
  // With a page, between two ticks: sleeps so long at most. What the page asks for, and the mesh
  // that it shows, do not wait for the next tick.
  void rest(rt::Nanos most, const std::function<rt::Time()>& now);
  // From now on fusion, one of `placed`, is released when pictures are typically decoded.
  void keep_phase(std::vector<rt::PlacedTask>& placed);
  void make_safe() { box.device().make_safe(); }
  // What it has seen so far, with `half`, into the run's folder. False: the disk refused it.
  [[nodiscard]] bool save(const std::string& folder) const {
    return save_half(folder, half_, console.seen(), console.link());
  }
  [[nodiscard]] OperatorHalf& half() noexcept { return half_; }  // but for what the console holds
  void finish(rt::NonRealtime& nrt, const drivers::LinkTransport& link);

  OperatorBox box;
  OperatorConsole console;

 private:
  const Scene& scene_;
  const DemoOptions& options_;
  ReleaseFollower fusion_;
  rt::Time epoch_, next_line_;
  bool cut_ = false;
  OperatorHalf half_;
};

class RobotSide {
 public:
  static constexpr rt::Box kBox = rt::Box::kRobot;
  static constexpr const char* kName = "robot";

  RobotSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions&,
            const BoxOptions& box_options);
  static void complete(BoxOptions& box_options) {
    box_options.threaded_camera = box_options.real_devices = true;
  }
  [[nodiscard]] static rt::Result<std::unique_ptr<drivers::TcpLink>> open_link(const Scene& scene,
                                                                               const BoxPlan& plan);
  void tick(rt::Time t, drivers::LinkTransport&);
  // From now on capture, one of `placed`, is released when frames have typically come.
  void keep_phase(std::vector<rt::PlacedTask>& placed);
  void make_safe() { box.make_safe(); }
  [[nodiscard]] bool save(const std::string& folder) const {
    return save_half(folder, half_, console.seen());
  }
  [[nodiscard]] RobotHalf& half() noexcept { return half_; }
  void finish(rt::NonRealtime&, const drivers::LinkTransport&);

  RobotBox box;
  RobotConsole console;

 private:
  rt::Time epoch_;
  ReleaseFollower capture_;
  RobotHalf half_;
};

}  // namespace teletact
