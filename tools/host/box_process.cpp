#include "tools/host/box_process.hpp"

#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <thread>

#include "drivers/link/tcp_link.hpp"
#include "rt/audit/run_file.hpp"
#include "rt/fault/planned.hpp"
#include "rt/sched/real_executor.hpp"
#include "rt/sched/registry.hpp"
#include "tools/record/black_box.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/record/recording_truth.hpp"
#include "tools/touch/force_check.hpp"

namespace teletact {

namespace {

constexpr const char* kRegistry = "teletact";
// From the request to the last job: outputs are at zero within 200 ms of the signal, polls included.
// The base needs 125 ms from its speed limit (robot_io.trajectory), the hand 100 (haptic.ramp_s).
constexpr std::int64_t kRampDown = 150000000;
constexpr std::int64_t kPoll = 5000000, kConsolePeriod = 20000000;

std::vector<rt::PlacedTask> placed_tasks(const BoxPlan& plan, rt::Box box,
                                         const std::function<rt::TaskBody&(tasks::TaskId)>& body) {
  std::vector<rt::PlacedTask> placed;
  for (std::size_t i = 0; i < plan.host.specs.size(); ++i) {
    if (plan.host.specs[i].box != box) continue;
    placed.push_back(placed_task(plan.host, i));
    placed.back().body = &body(static_cast<tasks::TaskId>(i));
  }
  for (std::size_t i = 0; i < plan.host.workers.size(); ++i) {
    if (plan.host.workers[i].box == box)
      placed.push_back(placed_task(plan.host, plan.host.specs.size() + i));
  }
  return placed;
}

// Refuses to start beside another teletact whose tasks leave no room on these cores;
// without a box, with the rows of both.
rt::Registry enter_registry(const BoxPlan& plan, std::optional<rt::Box> box) {
  auto registry = rt::Registry::open(kRegistry);
  if (!registry) throw std::runtime_error(registry.error());
  rt::IsMine mine;  // both boxes: all
  if (box) mine = [box](const std::string&, rt::Box b) { return b == *box; };
  const auto rows = rt::registry_entries(plan.host.held, plan.host.held_rows, mine);
  rt::Registry r = std::move(registry).value();
  if (auto ok = r.try_register(rows); !ok) throw std::runtime_error(ok.error());
  return r;
}

// What both boxes do once their graph, link and console stand.
struct BoxRunner {
  const DemoOptions& options;
  const BoxPlan& plan;
  rt::Box box;
  rt::BoxTime clock;
  std::vector<rt::PlacedTask> placed{};
  tasks::OperatorRequests* requests = nullptr;
  drivers::TcpLink* link = nullptr;
  std::function<void(rt::Time)> tick{};    // console
  std::function<void()> save{};            // partial half, so that a kill loses little
  std::function<void()> make_safe{};       // outputs to zero, from any thread
  std::function<tasks::ModeMsg()> mode{};  // newest that the console has seen
  std::vector<BoxTotals> totals{};
  std::uint64_t dropped = 0, hangs = 0;
  std::function<std::int64_t()> camera_twin_cpu{};  // empty: no camera's twin in this process
  OrdinaryCpu ordinary{};
  std::unique_ptr<BoxRecorder> black_box{};

  [[nodiscard]] rt::Time now() const { return clock.from_host(rt::monotonic_ns()); }

  // <folder>/<box>.stop: when this process was asked to end, in its box's clock.
  void note_request(std::int64_t host) const {
    const char* name = box == rt::Box::kOperator ? "/operator.stop" : "/robot.stop";
    std::ofstream(plan.folder + name) << rt::ns_of(clock.from_host(host)) << '\n';
  }

  template <class Record>
  void keep(rt::RunFileWriter& writer, const Record& record) {
    writer.add(record);
    if (black_box) black_box->add(record);
  }
  void look() {
    tick(now());
    if (black_box) black_box->watch(mode(), now());
  }

  // Since their threads began; the console is the thread that asks.
  [[nodiscard]] OrdinaryCpu ordinary_now() const {
    return {link->thread_cpu_ns(), rt::thread_cpu_ns(), camera_twin_cpu ? camera_twin_cpu() : 0,
            rt::monotonic_ns()};
  }

  // Handshake before the epoch, or an error that names what is missing.
  void await_link() const {
    while (link->state() != drivers::TcpLink::State::kReady) {
      if (link->state() == drivers::TcpLink::State::kFault) throw std::runtime_error(link->fault());
      if (rt::monotonic_ns() > plan.epoch_host_ns - 50000000) {
        throw std::runtime_error("link: no handshake in time; the other box's message says why");
      }
      ::usleep(2000);
    }
  }

  template <class Faults>
  void run(rt::NonRealtime& nrt, const Faults& faults, const std::string& file) {
    std::unique_ptr<rt::RunFileWriter> writer;
    rt::RealExecutor<Faults> executor(
        nrt, placed, faults, [&](const auto& r) { keep(*writer, r); },
        [&](const auto& r) { keep(*writer, r); });
    // What the machine refuses is known in part only when the threads run: the header tells what is
    // known now, the rest is appended to the notes of a second header line by the caller's report.
    rt::RunLog header = log_header(placed, box, plan.calibration);
    header.not_realtime = executor.missing();
    writer = std::make_unique<rt::RunFileWriter>(file, header);
    if (options.black_box_s > 0) {
      black_box = std::make_unique<BoxRecorder>(plan.folder, box, header, options.black_box_s);
      black_box->catch_crashes();
    }
    for (const auto& note : executor.notes())
      std::ofstream(plan.folder + "/notes", std::ios::app) << note << '\n';
    const auto missing_before = executor.missing().size();
    rt::RunPlan run_plan;
    run_plan.epoch_host_ns = plan.epoch_host_ns;
    run_plan.duration = rt::nanos_from_seconds(options.seconds);
    run_plan.clock[static_cast<std::size_t>(box)] = clock;
    std::atomic<bool> done{false};
    std::thread runner([&] {
      executor.run(run_plan);
      done.store(true);
    });
    g_ramp_down.store(&requests->ramp_down);
    std::int64_t ramp_from = 0, next_save = plan.epoch_host_ns + 1000000000, next_tick = 0;
    bool stopped = false;
    OrdinaryCpu at_epoch;
    while (!done.load()) {
      const std::int64_t host = rt::monotonic_ns();
      if (at_epoch.span_ns == 0 && host >= plan.epoch_host_ns) at_epoch = ordinary_now();
      if (host >= next_tick) {
        next_tick = host + kConsolePeriod;
        look();
      }
      if (executor.hangs() > 0) requests->watchdog_bit.store(true);
      if (g_stop_requested.load() && ramp_from == 0) {
        ramp_from = g_stop_asked_ns.load();
        requests->ramp_down.store(true);
        note_request(ramp_from);
      }
      // A slow task notices the stop at its next release; the outputs do not wait for it.
      if (ramp_from != 0 && host - ramp_from > kRampDown && !stopped) {
        stopped = true;
        executor.request_stop();
        make_safe();
      }
      if (host > next_save && ramp_from == 0) {
        next_save += 1000000000;
        writer->flush();
        save();
      }
      ::usleep(kPoll / 1000);
    }
    runner.join();
    make_safe();
    if (at_epoch.span_ns != 0) {
      const OrdinaryCpu end = ordinary_now();
      ordinary = {end.link_ns - at_epoch.link_ns, end.console_ns - at_epoch.console_ns,
                  end.camera_twin_ns - at_epoch.camera_twin_ns, end.span_ns - at_epoch.span_ns};
    }
    g_ramp_down.store(nullptr);
    look();
    const auto t = executor.totals();
    for (std::size_t i = 0; i < placed.size(); ++i) totals.push_back({placed[i].id, t[i]});
    dropped = executor.dropped_records();
    std::vector<rt::RunFileTotals> trailer;
    for (const BoxTotals& b : totals) trailer.push_back({b.task, b.totals});
    writer->finish(trailer, dropped);
    writer->flush();
    hangs = executor.hangs();
    if (black_box) {
      black_box->end(ramp_from != 0 ? kAskedToEnd
                     : hangs > 0    ? "a task hung and was made safe"
                                    : "");
    }
    for (std::size_t i = missing_before; i < executor.missing().size(); ++i) {
      std::ofstream(plan.folder + "/not_realtime", std::ios::app) << executor.missing()[i] << '\n';
    }
  }

  void run(rt::NonRealtime& nrt, const std::string& file) {
    std::vector<std::string> names;
    for (const auto& s : plan.host.specs) names.push_back(s.name);
    rt::with_faults(plan.planned ? &plan.faults : nullptr, names,
                    [&](const auto& faults) { run(nrt, faults, file); });
  }
};

// Null when nobody wants the inputs: neither a recording nor a black box.
std::unique_ptr<InputRecorder> start_recorder(rt::NonRealtime& nrt, rt::Box box, const Scene& scene,
                                              const DemoOptions& options, const BoxPlan& plan,
                                              std::function<rt::Time()> now) {
  if (!options.record) {
    return options.black_box_s > 0
               ? std::make_unique<InputRecorder>(nrt, "", InputRecorder::Keys{}, std::move(now))
               : nullptr;
  }
  return make_recorder(nrt, plan.folder, box, scene, camera_of(scene), std::move(now));
}

// ---- what differs between the boxes

class OperatorSide {
 public:
  static constexpr rt::Box kBox = rt::Box::kOperator;
  static constexpr const char* kName = "operator";
  static const rt::BoxTime& clock() { return kOperatorClock; }

  OperatorSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
               const BoxOptions& box_options)
      : box(nrt, scene, camera_of(scene), box_options),
        console(box, scene, box_options.epoch),
        scene_(scene),
        options_(options),
        epoch_(box_options.epoch),
        next_line_(epoch_ + std::chrono::seconds{1}) {
    half_.epoch_ns = rt::ns_of(epoch_);
  }
  static void complete(BoxOptions& box_options) { box_options.real_devices = true; }
  // Connects to the port that the robot's process wrote down.
  static rt::Result<std::unique_ptr<drivers::TcpLink>> open_link(const Scene& scene,
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
  void tick(rt::Time t, drivers::TcpLink& link) {
    console.tick(t);
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
  void make_safe() { box.device().make_safe(); }
  OperatorHalf& half() {
    half_.view = console.copy();
    return half_;
  }
  void finish(rt::NonRealtime& nrt, const drivers::TcpLink& link) {
    save_scene(nrt, console, box.graph().fusion(), options_.report + "/raw", options_.save_map);
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
  }

  OperatorBox box;
  OperatorConsole console;

 private:
  const Scene& scene_;
  const DemoOptions& options_;
  rt::Time epoch_, next_line_;
  bool cut_ = false;
  OperatorHalf half_;
};

class RobotSide {
 public:
  static constexpr rt::Box kBox = rt::Box::kRobot;
  static constexpr const char* kName = "robot";
  static const rt::BoxTime& clock() { return kRobotClock; }

  RobotSide(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions&,
            const BoxOptions& box_options)
      : box(nrt, scene, box_options), console(box) {
    half_.epoch_ns = rt::ns_of(box_options.epoch);
  }
  static void complete(BoxOptions& box_options) {
    box_options.threaded_camera = box_options.real_devices = true;
  }
  static rt::Result<std::unique_ptr<drivers::TcpLink>> open_link(const Scene& scene,
                                                                 const BoxPlan& plan) {
    auto link = drivers::TcpLink::listen(scene.link.address, scene.link.port);
    if (!link) return link;
    const std::string port = plan.folder + "/robot.port";
    std::ofstream(port + ".tmp") << link.value()->port() << '\n';
    std::rename((port + ".tmp").c_str(), port.c_str());  // whole or not there
    return link;
  }
  void tick(rt::Time t, drivers::TcpLink&) { console.tick(t); }
  void make_safe() { box.bus().make_safe(); }
  RobotHalf& half() {
    half_.view = console.seen();
    return half_;
  }
  void finish(rt::NonRealtime&, const drivers::TcpLink&) {
    half_.camera_twin_cpu_ns = box.camera_twin_cpu_ns();
  }

  RobotBox box;
  RobotConsole console;

 private:
  RobotHalf half_;
};

// ---- what does not

// By the link's thread, once a millisecond and when the connection has ended.
void show_link(const drivers::TcpLink& link, tasks::LinkStatus& status) {
  status.last_heard_ns.store(link.last_heard_ns());
  status.round_trip_ns.store(link.round_trip_ns());
  status.uncertainty_ns.store(link.clock_uncertainty_ns());
  status.refused.store(link.state() == drivers::TcpLink::State::kFault);
  status.closed.store(link.ended());
}

template <class Side>
int run_box(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
            const BoxPlan& plan) {
  BoxOptions box_options;
  box_options.epoch = Side::clock().from_host(plan.epoch_host_ns);
  box_options.faults = plan.faults;
  box_options.mode_gate = plan.host.modes.gate;
  box_options.now = [] { return Side::clock().from_host(rt::monotonic_ns()); };
  Side::complete(box_options);
  BoxRunner runner{options, plan, Side::kBox, Side::clock()};
  const auto inputs = start_recorder(nrt, Side::kBox, scene, options, plan, box_options.now);
  if (inputs) inputs->wrap(box_options);
  Side side(nrt, scene, options, box_options);
  auto& graph = side.box.graph();
  if (inputs) inputs->attach(graph, side.box.endpoint());
  side.console.log_to(nrt, plan.folder + "/" + Side::kName + ".log", [&](std::string_view line) {
    if (runner.black_box) runner.black_box->line(line);
  });
  if (inputs) {
    inputs->also(
        [&](const JobOp& op) {
          if (runner.black_box) runner.black_box->add(op);
        },
        [&](const Tally& t) {
          const RecordingMark mark{rt::ns_of(runner.now()), t.ops, t.messages, t.frames};
          if (runner.black_box) runner.black_box->add(mark);
        });
  }
  const auto registry = enter_registry(plan, Side::kBox);

  auto opened = Side::open_link(scene, plan);
  if (!opened) throw std::runtime_error(opened.error());
  drivers::TcpLink& link = *opened.value();
  link.start(side.box.endpoint(), box_options.now, scene.link.shape,
             [&] { show_link(link, graph.link()); });

  runner.placed = placed_tasks(plan, Side::kBox, [&](tasks::TaskId id) -> rt::TaskBody& {
    rt::TaskBody& body = graph.body(id);
    return inputs ? inputs->body(id, body) : body;
  });
  runner.requests = &graph.requests();
  runner.link = &link;
  runner.tick = [&](rt::Time t) {
    side.tick(t, link);
    if (inputs) inputs->drain();
  };
  runner.save = [&] { save_half(plan.folder, side.half()); };
  runner.make_safe = [&] { side.make_safe(); };
  runner.mode = [&] { return side.console.seen().mode; };
  if constexpr (Side::kBox == rt::Box::kRobot)
    runner.camera_twin_cpu = [&] { return side.box.camera_twin_cpu_ns(); };
  save_effects(plan.folder, Side::kName, side.box.effects());
  runner.await_link();
  runner.run(nrt, plan.folder + "/" + Side::kName + ".run");
  side.finish(nrt, link);
  link.stop();
  if (inputs) inputs->finish();
  auto& half = side.half();
  half.totals = runner.totals;
  half.dropped_records = runner.dropped;
  half.hangs = runner.hangs;
  half.ordinary = runner.ordinary;
  half.complete = true;
  save_half(plan.folder, half);
  return runner.hangs > 0 ? 4 : 0;
}

int with_errors(const char* who, const std::function<int()>& body) {
  try {
    return body();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "teletact %s: %s\n", who, e.what());
    return 3;
  }
}

}  // namespace

void check_room(const BoxPlan& plan) { (void)enter_registry(plan, std::nullopt); }

rt::RunLog log_header(const std::vector<rt::PlacedTask>& placed, rt::Box box,
                      const tasks::Calibration& calibration) {
  rt::RunLog log;
  for (const auto& p : placed) {
    if (p.spec.box != box) continue;
    rt::TaskLog t;
    t.spec = p.spec;
    t.id = p.id;
    t.core = p.core;
    t.priority = p.priority;
    t.level = p.level;
    if (const auto* row = calibration.find(p.spec, p.level)) {
      t.work_min = static_cast<std::uint64_t>(row->work_min);
      t.work_max = static_cast<std::uint64_t>(row->work_max);
    }
    log.tasks.push_back(std::move(t));
  }
  return log;
}

int run_operator_process(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                         const BoxPlan& plan) {
  return with_errors("operator", [&] { return run_box<OperatorSide>(nrt, scene, options, plan); });
}

int run_robot_process(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                      const BoxPlan& plan) {
  return with_errors("robot", [&] { return run_box<RobotSide>(nrt, scene, options, plan); });
}

}  // namespace teletact
