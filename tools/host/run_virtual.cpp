// The whole stack on the virtual clock: both boxes in one process, the link an actor in between.
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>

#include "config/fault_plan.hpp"
#include "rt/audit/log_hash.hpp"
#include "rt/fault/planned.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "tasks/edges/edge_faults.hpp"
#include "tools/files/take.hpp"
#include "tools/host/job_keeper.hpp"
#include "tools/host/pacer.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/sim_link.hpp"
#include "tools/record/box_recorder.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/page_hook.hpp"
#include "tools/touch/force_check.hpp"

namespace teletact {

namespace {

// Before the epoch: as on the real clock, and of a late link what a Hello and a clock exchange take, with one to spare.
std::int64_t handshake_ns(const drivers::LinkShapeConfig& shape) {
  return std::max<std::int64_t>(
      500000000, 4 * static_cast<std::int64_t>(1e6 * (shape.delay_ms + shape.jitter_ms)));
}

// What the run is to suffer; none without --faults.
rt::FaultPlan plan_of(const DemoOptions& options) {
  if (options.fault_plan.empty()) return {};
  auto loaded = take(config::load_fault_plan(options.fault_plan));
  if (auto good = tasks::check_faults(loaded); !good)
    throw std::runtime_error(options.fault_plan + ": " + good.error());
  return loaded;
}
constexpr std::int64_t kMinute_ns = 60000000000;
constexpr std::int64_t kNever_ns = std::numeric_limits<std::int64_t>::max();

// Something that happens every so often beside the tasks.
class Periodic final : public rt::Actor {
 public:
  Periodic(std::int64_t first, std::int64_t period, std::function<void(std::int64_t)> body)
      : next_(first), period_(period), body_(std::move(body)) {}
  [[nodiscard]] std::int64_t next_host_ns() const noexcept override { return next_; }
  void act(std::int64_t host_ns) override {
    next_ += period_;
    body_(host_ns);
  }

 private:
  std::int64_t next_, period_;
  std::function<void(std::int64_t)> body_;
};

// Sooner when the run is asked to end.
void sleep_until(std::int64_t host_ns) {
  const timespec at{host_ns / 1000000000, host_ns % 1000000000};
  while (!g_stop_requested.load() &&
         clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
}

// Returns the instant at which it ended: that of the plan, or of the first completed job after a request to stop.
template <class Faults>
std::int64_t execute(std::vector<rt::PlacedTask> placed, rt::CostModel& costs, const Faults& faults,
                     const typename rt::VirtualExecutor<Faults>::Sink& sink,
                     const rt::VirtualOptions& options, const std::vector<rt::Actor*>& actors,
                     const rt::RunPlan& plan, std::vector<BoxTotals>& op,
                     std::vector<BoxTotals>& robot) {
  rt::Executor* running = nullptr;
  bool stopped = false;
  const auto watched = [&](const rt::JobRecord& r) {
    sink(r);
    if (!g_stop_requested.load()) return;
    stopped = true;
    running->request_stop();
  };
  rt::VirtualExecutor<Faults> executor(placed, costs, faults, watched, options);
  running = &executor;
  for (auto* a : actors) executor.add_actor(*a);
  executor.run(plan);
  const auto totals = executor.totals();
  for (std::size_t i = 0; i < placed.size(); ++i) {
    (placed[i].spec.box == rt::Box::kOperator ? op : robot).push_back({placed[i].id, totals[i]});
  }
  return stopped ? executor.now_host_ns() : plan.epoch_host_ns + plan.duration.count();
}

// Ends the consoles' use.
void take_views(VirtualRun& run, OperatorConsole& op, RobotConsole& robot) {
  run.op.link = op.link();
  run.op.view = op.take();
  run.robot.view = robot.take();
}

// The tasks' logs into files, and to the black boxes that there will be.
void log_both(rt::NonRealtime& nrt, const std::string& folder, OperatorConsole& op,
              const std::unique_ptr<BoxRecorder>& op_last, RobotConsole& robot,
              const std::unique_ptr<BoxRecorder>& robot_last) {
  std::filesystem::create_directories(folder);
  op.log_to(nrt, folder + "/operator.log", [&](std::string_view line) {
    if (op_last) op_last->line(line);
  });
  robot.log_to(nrt, folder + "/robot.log", [&](std::string_view line) {
    if (robot_last) robot_last->line(line);
  });
}

}  // namespace

VirtualRun run_virtual(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
                       const tasks::Calibration& given) {
  VirtualRun run;
  const tasks::Calibration calibration = as_asked(given, scene);
  const std::int64_t handshake = handshake_ns(scene.link.way());
  // Any instant; fixed, so that runs repeat.
  const std::int64_t epoch = std::max<std::int64_t>(1000000000, handshake + 500000000);
  std::vector<int> cpus;
  for (int i = 0; i < options.cores; ++i) cpus.push_back(i);
  const HostPlan host = admit_host(scene, given, cpus, {0.30}, options.force_choice);
  run.admission = host.admission;
  run.modes = host.modes;
  if (!host.refusal.empty()) throw std::runtime_error("admission: " + host.refusal);
  if (!options.quiet) std::printf("%s\n", admission_text(host).c_str());
  scene.graph.fusion.tsdf.voxel_size_m = host.voxel_m;
  std::vector<rt::TaskSpec> specs = host.specs;
  specs.insert(specs.end(), host.workers.begin(), host.workers.end());

  BoxOptions op_options, robot_options;
  op_options.mode_gate = robot_options.mode_gate = host.modes.gate;
  const rt::FaultPlan plan_of_faults = plan_of(options);
  op_options.hash_outputs = robot_options.hash_outputs = true;
  op_options.faults = robot_options.faults = plan_of_faults;
  op_options.epoch = kOperatorClock.from_host(epoch);
  robot_options.epoch = kRobotClock.from_host(epoch);
  if (options.passer_from_s >= 0) {
    robot_options.passer_from = robot_options.epoch + rt::nanos_from_seconds(options.passer_from_s);
  }
  std::unique_ptr<InputRecorder> op_inputs, robot_inputs;  // outlive what they are attached to
  std::unique_ptr<RobotBox> robot;
  std::unique_ptr<OperatorBox> op;
  std::unique_ptr<SimLink> link;
  std::unique_ptr<OperatorConsole> op_console;
  std::unique_ptr<RobotConsole> robot_console;
  std::unique_ptr<BoxRecorder> op_last, robot_last;  // black boxes
  std::optional<ForceChecker> forces;  // of a recording: the hand presses while the map grows
  JobKeepers keep(options, run);
  std::vector<std::unique_ptr<rt::Actor>> owned;
  std::vector<rt::Actor*> actors;
  if (!options.stub_bodies) {
    const perception::Intrinsics camera = camera_of(scene);
    if (options.record) {
      const std::string folder = options.report + "/raw";
      save_setup(folder, scene, options.fault_plan);
      op_inputs = make_recorder(nrt, folder, rt::Box::kOperator, scene, camera);
      robot_inputs = make_recorder(nrt, folder, rt::Box::kRobot, scene, camera);
      op_inputs->wrap(op_options);
      robot_inputs->wrap(robot_options);
    }
    put_page_hand(nrt, options.page, op_options);
    robot = std::make_unique<RobotBox>(nrt, scene, robot_options);
    op = std::make_unique<OperatorBox>(nrt, scene, camera, op_options);
    if (options.record) {
      op_inputs->attach(op->graph(), op->endpoint());
      robot_inputs->attach(robot->graph(), robot->endpoint());
    }
    link = std::make_unique<SimLink>(
        SimLink::End{&op->endpoint(), &op->graph().link(), kOperatorClock},
        SimLink::End{&robot->endpoint(), &robot->graph().link(), kRobotClock}, scene.link.shape,
        epoch - handshake);
    link->emulate(scene.link.network, epoch);
    if (!link->handshake(epoch - handshake, epoch))
      throw std::runtime_error(
          "link: no handshake before the start; lower the delay of link.shape or link.network");
    op_console = std::make_unique<OperatorConsole>(*op, scene, op_options.epoch);
    robot_console = std::make_unique<RobotConsole>(*robot);
    if (!options.log_folder.empty())
      log_both(nrt, options.log_folder, *op_console, op_last, *robot_console, robot_last);
    if (options.page != nullptr)
      options.page->open(*op, *op_console, scene, op_options.epoch,
                         options.paced ? PageHook::Clock::kPaced : PageHook::Clock::kFree);
    if (!scene.rgbd_dir.empty())
      forces.emplace(scene.graph.haptic.stiffness_N_per_m, scene.graph.haptic.scale);
    owned.push_back(std::make_unique<Periodic>(epoch + 7000000, 20000000, [&](std::int64_t t) {
      op_console->tick(kOperatorClock.from_host(t));
      if (options.page != nullptr) options.page->tick(kOperatorClock.from_host(t));
      if (forces) forces->look(op->graph().fusion().map(), op_console->seen().haptic);
      robot_console->tick(kRobotClock.from_host(t));
      if (!options.quiet) std::fputs(op_console->news().c_str(), stdout);
      keep.look(op_console->seen().mode, robot_console->seen().mode, op->graph().link().spared(),
                t);
      if (op_last) op_last->watch(op_console->seen().mode, kOperatorClock.from_host(t));
      if (robot_last) robot_last->watch(robot_console->seen().mode, kRobotClock.from_host(t));
      for (auto* inputs : {op_inputs.get(), robot_inputs.get()}) {
        if (inputs != nullptr) inputs->drain();
      }
    }));
    if (!options.quiet) {
      owned.push_back(
          std::make_unique<Periodic>(epoch + 1000000000, 1000000000, [&](std::int64_t t) {
            std::printf("%s\n", op_console->status_line(kOperatorClock.from_host(t)).c_str());
            std::fflush(stdout);
          }));
    }
    if (options.cut_link_at_s >= 0) {
      owned.push_back(
          std::make_unique<Periodic>(epoch + static_cast<std::int64_t>(options.cut_link_at_s * 1e9),
                                     std::int64_t{1} << 60, [&](std::int64_t) { link->cut(); }));
    }
    if (options.meddle) {
      owned.push_back(std::make_unique<Periodic>(
          epoch + static_cast<std::int64_t>(options.meddle_at_s * 1e9), std::int64_t{1} << 60,
          [&](std::int64_t) { options.meddle(*op); }));
    }
    actors.push_back(options.wrap_link ? options.wrap_link(*link) : link.get());
    for (auto& a : owned) actors.push_back(a.get());
    run.effects = robot->effects();
    for (auto& e : op->effects()) run.effects.push_back(e);
  }

  Periodic minutes(options.each_minute ? epoch + kMinute_ns : kNever_ns, kMinute_ns,
                   [&](std::int64_t t) { options.each_minute(t - epoch); });
  actors.push_back(&minutes);
  Pacer pacer(epoch, &rt::monotonic_ns, &sleep_until);
  if (options.paced) actors.push_back(&pacer);

  std::vector<rt::PlacedTask> placed;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const auto id = static_cast<tasks::TaskId>(i);
    rt::PlacedTask p = placed_task(host, i);
    if (!options.stub_bodies && !specs[i].is_worker()) {
      p.body =
          specs[i].box == rt::Box::kOperator ? &op->graph().body(id) : &robot->graph().body(id);
      if (options.record) {
        auto& inputs = specs[i].box == rt::Box::kOperator ? *op_inputs : *robot_inputs;
        p.body = &inputs.body(id, *p.body);
      }
      if (options.wrap_body) p.body = options.wrap_body(id, *p.body);
    }
    placed.push_back(p);
  }
  run.op.log = log_header(placed, rt::Box::kOperator, calibration);
  run.robot.log = log_header(placed, rt::Box::kRobot, calibration);
  if (!options.log_folder.empty() && !options.stub_bodies) {
    remove_black_boxes(options.log_folder);
    if (options.black_box_s > 0) {
      op_last = std::make_unique<BoxRecorder>(options.log_folder, rt::Box::kOperator, run.op.log,
                                              options.black_box_s);
      robot_last = std::make_unique<BoxRecorder>(options.log_folder, rt::Box::kRobot, run.robot.log,
                                                 options.black_box_s);
    }
  }
  rt::LogHasher hasher;
  keep.start(op_options.epoch, robot_options.epoch);
  const auto sink = [&](const rt::JobRecord& r) {
    hasher.add(r);
    const bool of_op = specs[r.task].box == rt::Box::kOperator;
    keep.add(of_op, r);
    if (auto* last = of_op ? op_last.get() : robot_last.get()) last->add(r);
  };
  rt::RunPlan plan;
  plan.epoch_host_ns = epoch;
  plan.duration = rt::nanos_from_seconds(options.seconds);
  plan.clock[0] = kOperatorClock;
  plan.clock[1] = kRobotClock;
  rt::QuantileCosts costs(options.cost_seed, tasks::make_costs(calibration, specs));
  const rt::VirtualOptions how{options.stub_bodies};
  std::vector<std::string> names;
  for (const auto& s : specs) names.push_back(s.name);
  std::int64_t end = epoch;
  rt::with_faults(options.fault_plan.empty() ? nullptr : &plan_of_faults, names,
                  [&](const auto& faults) {
                    end = execute(placed, costs, faults, sink, how, actors, plan, run.op.totals,
                                  run.robot.totals);
                  });
  run.wall_s = 1e-9 * static_cast<double>(pacer.wall_ns());
  run.lag_s = 1e-9 * static_cast<double>(pacer.lag_ns());
  if (link) {
    const std::uint64_t bytes = link->byte_hash();
    hasher.add_bytes(&bytes, sizeof bytes);
  }
  keep.finish();
  run.stopped_early = end < epoch + plan.duration.count();
  run.seconds = 1e-9 * static_cast<double>(end - epoch);
  run.sched_hash = hasher.sched();
  run.log_hash = hasher.log();
  run.op.epoch_ns = rt::ns_of(op_options.epoch);
  run.robot.epoch_ns = rt::ns_of(robot_options.epoch);
  for (auto* inputs : {op_inputs.get(), robot_inputs.get()}) {
    if (inputs != nullptr) inputs->finish();
  }
  if (op && options.page != nullptr) options.page->close();
  if (op) {
    op_console->tick(kOperatorClock.from_host(end));
    robot_console->tick(kRobotClock.from_host(end));
    for (auto* last : {op_last.get(), robot_last.get()}) {
      if (last != nullptr) last->end(run.stopped_early ? kAskedToEnd : "");
    }
    if (op_last) say_black_boxes(options.log_folder);
    save_scene(nrt, *op_console, op->graph().fusion(), options.log_folder, options.save_map);
    run.op.link_round_trip_ns = op->endpoint().round_trip().count();
    take_views(run, *op_console, *robot_console);
    run.op.force_check =
        forces ? forces->result()
               : check_force(op->graph().fusion().map(), run.op.view.haptic,
                             scene.graph.haptic.stiffness_N_per_m, scene.graph.haptic.scale);
    run.robot.camera_twin_cpu_ns = robot->camera_twin_cpu_ns();
  }
  run.op.complete = run.robot.complete = true;
  if (op) keep.save_views();
  return run;
}

}  // namespace teletact
