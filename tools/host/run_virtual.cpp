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

// Before the epoch: as on the real clock, and of a late link what a Hello and a clock exchange
// take, with one to spare.
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

// Returns the instant at which it ended: that of the plan, or of the first completed job after a
// request to stop.
template <class Faults>
std::int64_t execute_all(std::vector<rt::PlacedTask> placed, rt::CostModel& costs,
                         const Faults& faults,
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

// Both boxes of a run, what connects and watches them, and the run itself. The members end in the
// reverse of their order: what is attached to something ends before it.
class VirtualStack {
 public:
  // `run` gets what the run leaves; it outlives the stack.
  VirtualStack(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
               const tasks::Calibration& given, VirtualRun& run)
      : nrt_(nrt),
        scene_(scene),
        options_(options),
        run_(run),
        calibration_(as_asked(given, scene)),
        handshake_(handshake_ns(scene.link.way())),
        epoch_(std::max<std::int64_t>(1000000000, handshake_ + 500000000)),
        keep_(options, run) {}

  void admit(const tasks::Calibration& given);
  void build();
  void place();
  void execute();
  void finish();

 private:
  void set_box_options();
  void build_boxes();
  void connect();
  void open_consoles();
  void tick(std::int64_t host_ns);
  void add_events();
  void add_once(double at_s, std::function<void(std::int64_t)> body);
  void open_black_boxes();
  void run_placed(const std::function<void(const rt::JobRecord&)>& sink);
  void end_consoles();

  rt::NonRealtime& nrt_;
  Scene& scene_;
  const DemoOptions& options_;
  VirtualRun& run_;
  tasks::Calibration calibration_;
  std::int64_t handshake_;
  std::int64_t epoch_;  // any instant; fixed, so that runs repeat
  HostPlan host_;
  std::vector<rt::TaskSpec> specs_;
  rt::FaultPlan faults_;
  BoxOptions op_options_, robot_options_;
  std::unique_ptr<InputRecorder> op_inputs_, robot_inputs_;
  std::unique_ptr<RobotBox> robot_;
  std::unique_ptr<OperatorBox> op_;
  std::unique_ptr<SimLink> link_;
  std::unique_ptr<OperatorConsole> op_console_;
  std::unique_ptr<RobotConsole> robot_console_;
  std::unique_ptr<BoxRecorder> op_last_, robot_last_;  // black boxes
  std::optional<ForceChecker> forces_;  // of a recording: the hand presses while the map grows
  JobKeepers keep_;
  std::vector<std::unique_ptr<rt::Actor>> owned_;
  std::vector<rt::Actor*> actors_;
  std::optional<Periodic> minutes_;
  std::optional<Pacer> pacer_;
  std::vector<rt::PlacedTask> placed_;
  std::int64_t end_ = 0;
};

void VirtualStack::admit(const tasks::Calibration& given) {
  std::vector<int> cpus;
  for (int i = 0; i < options_.cores; ++i) cpus.push_back(i);
  host_ = admit_host(scene_, given, cpus, {0.30, 0.5 * declared_link_share(scene_, given)},
                     options_.force_choice);
  run_.admission = host_.admission;
  run_.modes = host_.modes;
  if (!host_.refusal.empty()) throw std::runtime_error("admission: " + host_.refusal);
  if (!options_.quiet) std::printf("%s\n", admission_text(host_).c_str());
  scene_.graph.fusion.tsdf.voxel_size_m = host_.voxel_m;
  specs_ = host_.specs;
  specs_.insert(specs_.end(), host_.workers.begin(), host_.workers.end());
  set_box_options();
}

void VirtualStack::set_box_options() {
  op_options_.mode_gate = robot_options_.mode_gate = host_.modes.gate;
  faults_ = plan_of(options_);
  op_options_.hash_outputs = robot_options_.hash_outputs = true;
  op_options_.faults = robot_options_.faults = faults_;
  op_options_.epoch = kOperatorClock.from_host(epoch_);
  robot_options_.epoch = kRobotClock.from_host(epoch_);
  if (options_.passer_from_s >= 0) {
    robot_options_.passer_from =
        robot_options_.epoch + rt::nanos_from_seconds(options_.passer_from_s);
  }
}

void VirtualStack::build() {
  build_boxes();
  connect();
  open_consoles();
  if (!scene_.rgbd_dir.empty())
    forces_.emplace(scene_.graph.haptic.stiffness_N_per_m, scene_.graph.haptic.scale);
  add_events();
  actors_.push_back(options_.wrap_link ? options_.wrap_link(*link_) : link_.get());
  for (auto& a : owned_) actors_.push_back(a.get());
  run_.effects = robot_->effects();
  for (auto& e : op_->effects()) run_.effects.push_back(e);
}

void VirtualStack::build_boxes() {
  const perception::Intrinsics camera = camera_of(scene_);
  if (options_.record) {
    const std::string folder = options_.report + "/raw";
    save_setup(folder, scene_, options_.fault_plan);
    op_inputs_ = make_recorder(nrt_, folder, rt::Box::kOperator, scene_, camera);
    robot_inputs_ = make_recorder(nrt_, folder, rt::Box::kRobot, scene_, camera);
    op_inputs_->wrap(op_options_);
    robot_inputs_->wrap(robot_options_);
  }
  put_page_hand(nrt_, options_.page, op_options_);
  if (options_.robot_options) options_.robot_options(robot_options_);
  robot_ = std::make_unique<RobotBox>(nrt_, scene_, robot_options_);
  if (options_.robot_built) options_.robot_built(*robot_);
  op_ = std::make_unique<OperatorBox>(nrt_, scene_, camera, op_options_);
  if (options_.record) {
    op_inputs_->attach(op_->graph(), op_->endpoint());
    robot_inputs_->attach(robot_->graph(), robot_->endpoint());
  }
}

void VirtualStack::connect() {
  link_ = std::make_unique<SimLink>(
      SimLink::End{&op_->endpoint(), &op_->graph().link(), kOperatorClock},
      SimLink::End{&robot_->endpoint(), &robot_->graph().link(), kRobotClock}, scene_.link.shape,
      epoch_ - handshake_);
  link_->emulate(scene_.link.network, epoch_);
  if (!link_->handshake(epoch_ - handshake_, epoch_))
    throw std::runtime_error(
        "link: no handshake before the start; lower the delay of link.shape or link.network");
}

void VirtualStack::open_consoles() {
  op_console_ = std::make_unique<OperatorConsole>(*op_, scene_, op_options_.epoch);
  robot_console_ = std::make_unique<RobotConsole>(*robot_);
  if (!options_.log_folder.empty())
    log_both(nrt_, options_.log_folder, *op_console_, op_last_, *robot_console_, robot_last_);
  if (options_.page != nullptr)
    options_.page->open(*op_, *op_console_, scene_, op_options_.epoch,
                        options_.paced ? PageHook::Clock::kPaced : PageHook::Clock::kFree);
}

// What the ordinary threads of both boxes do every 20 ms.
void VirtualStack::tick(std::int64_t host_ns) {
  op_console_->tick(kOperatorClock.from_host(host_ns));
  if (options_.page != nullptr) options_.page->tick(kOperatorClock.from_host(host_ns));
  if (forces_) forces_->look(op_->graph().fusion().map(), op_console_->seen().haptic);
  robot_console_->tick(kRobotClock.from_host(host_ns));
  if (!options_.quiet) std::fputs(op_console_->news().c_str(), stdout);
  keep_.look(op_console_->seen().mode, robot_console_->seen().mode, op_->graph().link().spared(),
             host_ns);
  if (op_last_) op_last_->watch(op_console_->seen().mode, kOperatorClock.from_host(host_ns));
  if (robot_last_) robot_last_->watch(robot_console_->seen().mode, kRobotClock.from_host(host_ns));
  for (auto* inputs : {op_inputs_.get(), robot_inputs_.get()}) {
    if (inputs != nullptr) inputs->drain();
  }
}

void VirtualStack::add_events() {
  owned_.push_back(
      std::make_unique<Periodic>(epoch_ + 7000000, 20000000, [this](std::int64_t t) { tick(t); }));
  if (!options_.quiet) {
    owned_.push_back(
        std::make_unique<Periodic>(epoch_ + 1000000000, 1000000000, [this](std::int64_t t) {
          std::printf("%s\n", op_console_->status_line(kOperatorClock.from_host(t)).c_str());
          std::fflush(stdout);
        }));
  }
  if (options_.cut_link_at_s >= 0)
    add_once(options_.cut_link_at_s, [this](std::int64_t) { link_->cut(); });
  if (options_.meddle)
    add_once(options_.meddle_at_s, [this](std::int64_t) { options_.meddle(*op_); });
}

void VirtualStack::add_once(double at_s, std::function<void(std::int64_t)> body) {
  owned_.push_back(std::make_unique<Periodic>(epoch_ + static_cast<std::int64_t>(at_s * 1e9),
                                              std::int64_t{1} << 60, std::move(body)));
}

void VirtualStack::place() {
  minutes_.emplace(options_.each_minute ? epoch_ + kMinute_ns : kNever_ns, kMinute_ns,
                   [this](std::int64_t t) { options_.each_minute(t - epoch_); });
  actors_.push_back(&*minutes_);
  pacer_.emplace(epoch_, &rt::monotonic_ns, &sleep_until);
  if (options_.paced) actors_.push_back(&*pacer_);
  for (std::size_t i = 0; i < specs_.size(); ++i) {
    const auto id = static_cast<tasks::TaskId>(i);
    const bool of_op = specs_[i].box == rt::Box::kOperator;
    rt::PlacedTask p = placed_task(host_, i);
    if (!options_.stub_bodies && !specs_[i].is_worker()) {
      p.body = of_op ? &op_->graph().body(id) : &robot_->graph().body(id);
      if (options_.record) p.body = &(of_op ? *op_inputs_ : *robot_inputs_).body(id, *p.body);
      if (options_.wrap_body) p.body = options_.wrap_body(id, *p.body);
    }
    placed_.push_back(p);
  }
  run_.op.log = log_header(placed_, rt::Box::kOperator, calibration_);
  run_.robot.log = log_header(placed_, rt::Box::kRobot, calibration_);
  if (!options_.log_folder.empty() && !options_.stub_bodies) open_black_boxes();
}

void VirtualStack::open_black_boxes() {
  remove_black_boxes(options_.log_folder);
  if (!(options_.black_box_s > 0)) return;
  op_last_ = std::make_unique<BoxRecorder>(options_.log_folder, rt::Box::kOperator, run_.op.log,
                                           options_.black_box_s);
  robot_last_ = std::make_unique<BoxRecorder>(options_.log_folder, rt::Box::kRobot, run_.robot.log,
                                              options_.black_box_s);
}

void VirtualStack::execute() {
  rt::LogHasher hasher;
  keep_.start(op_options_.epoch, robot_options_.epoch);
  run_placed([&](const rt::JobRecord& r) {
    hasher.add(r);
    const bool of_op = specs_[r.task].box == rt::Box::kOperator;
    keep_.add(of_op, r);
    if (auto* last = of_op ? op_last_.get() : robot_last_.get()) last->add(r);
  });
  if (link_) {
    const std::uint64_t bytes = link_->byte_hash();
    hasher.add_bytes(&bytes, sizeof bytes);
  }
  keep_.finish();
  run_.sched_hash = hasher.sched();
  run_.log_hash = hasher.log();
}

void VirtualStack::run_placed(const std::function<void(const rt::JobRecord&)>& sink) {
  rt::RunPlan plan;
  plan.epoch_host_ns = epoch_;
  plan.duration = rt::nanos_from_seconds(options_.seconds);
  plan.clock[0] = kOperatorClock;
  plan.clock[1] = kRobotClock;
  rt::QuantileCosts costs(options_.cost_seed, tasks::make_costs(calibration_, specs_));
  const rt::VirtualOptions how{options_.stub_bodies};
  std::vector<std::string> names;
  for (const auto& s : specs_) names.push_back(s.name);
  rt::with_faults(options_.fault_plan.empty() ? nullptr : &faults_, names, [&](const auto& faults) {
    end_ = execute_all(placed_, costs, faults, sink, how, actors_, plan, run_.op.totals,
                       run_.robot.totals);
  });
  run_.wall_s = 1e-9 * static_cast<double>(pacer_->wall_ns());
  run_.lag_s = 1e-9 * static_cast<double>(pacer_->lag_ns());
  run_.stopped_early = end_ < epoch_ + plan.duration.count();
  run_.seconds = 1e-9 * static_cast<double>(end_ - epoch_);
}

void VirtualStack::finish() {
  run_.op.epoch_ns = rt::ns_of(op_options_.epoch);
  run_.robot.epoch_ns = rt::ns_of(robot_options_.epoch);
  for (auto* inputs : {op_inputs_.get(), robot_inputs_.get()}) {
    if (inputs != nullptr) inputs->finish();
  }
  if (op_ && options_.page != nullptr) options_.page->close();
  if (op_) end_consoles();
  run_.op.complete = run_.robot.complete = true;
  if (op_) keep_.save_views();
}

void VirtualStack::end_consoles() {
  op_console_->tick(kOperatorClock.from_host(end_));
  robot_console_->tick(kRobotClock.from_host(end_));
  for (auto* last : {op_last_.get(), robot_last_.get()}) {
    if (last != nullptr) last->end(run_.stopped_early ? kAskedToEnd : "");
  }
  if (op_last_) say_black_boxes(options_.log_folder);
  save_scene(nrt_, *op_console_, op_->graph().fusion(), options_.log_folder, options_.save_map);
  run_.op.link_round_trip_ns = op_->endpoint().round_trip().count();
  take_views(run_, *op_console_, *robot_console_);
  run_.op.force_check =
      forces_ ? forces_->result()
              : check_force(op_->graph().fusion().map(), run_.op.view.haptic,
                            scene_.graph.haptic.stiffness_N_per_m, scene_.graph.haptic.scale);
  run_.link_cpu_ns = link_->cpu_ns();
  run_.robot.camera_twin_cpu_ns = robot_->camera_twin_cpu_ns();
}

}  // namespace

VirtualRun run_virtual(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
                       const tasks::Calibration& given) {
  VirtualRun run;
  VirtualStack stack(nrt, scene, options, given, run);
  stack.admit(given);
  if (!options.stub_bodies) stack.build();
  stack.place();
  stack.execute();
  stack.finish();
  return run;
}

}  // namespace teletact
