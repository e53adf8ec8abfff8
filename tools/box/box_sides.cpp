#include "tools/box/box_sides.hpp"

#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "rt/clock/box_time.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/scene/page_hook.hpp"
#include "tools/touch/force_check.hpp"

namespace teletact {

OperatorSide::OperatorSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                           const BoxOptions& box_options)
    : box(nrt, scene, camera_of(scene), box_options),
      console(box, scene, box_options.epoch),
      scene_(scene),
      options_(options),
      epoch_(box_options.epoch),
      next_line_(epoch_ + std::chrono::seconds{1}) {
  half_.epoch_ns = rt::ns_of(epoch_);
  if (options.page != nullptr)
    options.page->open(box, console, scene, epoch_, PageHook::Clock::kReal);
}

rt::Result<std::unique_ptr<drivers::TcpLink>> OperatorSide::open_link(const Scene& scene,
                                                                      const BoxPlan& plan) {
  int port = 0;
  while (port == 0) {
    std::ifstream(plan.folder + "/robot.port") >> port;
    if (rt::monotonic_ns() > plan.epoch_host_ns)
      throw std::runtime_error("the robot's process opened no port; its own message says why");
    ::usleep(5000);
  }
  return drivers::TcpLink::connect(scene.link.address, port, std::chrono::seconds{2});
}

void OperatorSide::keep_phase(std::vector<rt::PlacedTask>& placed) {
  fusion_.keep(placed, tasks::TaskId::kFusion, epoch_);
}

void OperatorSide::tick(rt::Time t, drivers::LinkTransport& link) {
  console.tick(t);
  const std::string moved = fusion_.follow(box.decoded(), "pictures are decoded");
  if (!moved.empty()) console.say(t, moved);
  if (options_.page != nullptr) options_.page->tick(t);
  if (!options_.quiet) std::fputs(console.news().c_str(), stdout);
  if (!options_.quiet && t >= next_line_) {
    next_line_ += std::chrono::seconds{1};
    std::printf("%s\n", console.status_line(t).c_str());
    std::fflush(stdout);
  }
  if (!cut_ && options_.cut_link_at_s >= 0 && rt::seconds(t - epoch_) >= options_.cut_link_at_s) {
    cut_ = true;
    std::ofstream(options_.report + "/raw/link.cut") << rt::monotonic_ns() << '\n';
    link.cut();
  }
}

void OperatorSide::rest(rt::Nanos most, const std::function<rt::Time()>& now) {
  if (options_.page->await_acts(most)) options_.page->take_acts(now());
  console.glance(now());
}

void OperatorSide::finish(rt::NonRealtime& nrt, const drivers::LinkTransport& link) {
  if (options_.page != nullptr) options_.page->close();
  half_.link_round_trip_ns = link.round_trip_ns();
  half_.link_uncertainty_ns = link.clock_uncertainty_ns();
  // Of a recording from two seconds after its last image on: by then the map hardly changes.
  const rt::Time since =
      scene_.rgbd_dir.empty()
          ? rt::Time{}
          : epoch_ + rt::nanos_from_seconds(recording_seconds(scene_.rgbd_dir) + 2.3);
  half_.force_check =
      check_force(box.graph().fusion().map(), console.seen().haptic,
                  scene_.graph.haptic.stiffness_N_per_m, scene_.graph.haptic.scale, since);
  // Last: the disk may refuse it.
  save_scene(nrt, console, box.graph().fusion(), options_.report + "/raw", options_.save_map);
}

RobotSide::RobotSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions&,
                     const BoxOptions& box_options)
    : box(nrt, scene, box_options), console(box), epoch_(box_options.epoch) {
  half_.epoch_ns = rt::ns_of(box_options.epoch);
}

void RobotSide::keep_phase(std::vector<rt::PlacedTask>& placed) {
  if (box.frame_arrivals() != nullptr) capture_.keep(placed, tasks::TaskId::kCapture, epoch_);
}

void RobotSide::tick(rt::Time t, drivers::LinkTransport&) {
  console.tick(t);
  if (box.frame_arrivals() == nullptr) return;
  const std::string moved = capture_.follow(*box.frame_arrivals(), "frames come");
  if (!moved.empty()) console.say(t, moved);
}

rt::Result<std::unique_ptr<drivers::TcpLink>> RobotSide::open_link(const Scene& scene,
                                                                   const BoxPlan& plan) {
  auto link = drivers::TcpLink::listen(scene.link.address, scene.link.port);
  if (!link) return link;
  const std::string port = plan.folder + "/robot.port";
  std::ofstream(port + ".tmp") << link.value()->port() << '\n';
  std::rename((port + ".tmp").c_str(), port.c_str());  // whole or not there
  return link;
}

void RobotSide::finish(rt::NonRealtime&, const drivers::LinkTransport&) {
  half_.camera_twin_cpu_ns = box.camera_twin_cpu_ns();
}

}  // namespace teletact
