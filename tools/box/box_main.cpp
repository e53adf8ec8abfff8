#include "tools/box/box_main.hpp"

#include <cstdio>
#include <stdexcept>

#include "tools/box/box_runner.hpp"
#include "tools/box/box_sides.hpp"
#include "tools/files/take.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

namespace {

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

// A recorder outside of a page's hand.
void wrap_devices(rt::NonRealtime& nrt, InputRecorder* inputs, PageHook* page,
                  BoxOptions& box_options) {
  if (inputs != nullptr) inputs->wrap(box_options);
  put_page_hand(nrt, page, box_options);
}

// By the link's thread, once a millisecond and when the connection has ended. A link that lasts may
// find another peer after one that it had to refuse: that is no fault that only a restart clears.
// It is closed while there is no connection that is ready.
void show_link(const drivers::LinkTransport& link, const drivers::LinkEndpoint& endpoint,
               bool lasting, tasks::LinkStatus& status) {
  using State = drivers::LinkTransport::State;
  const State state = link.state();
  status.last_heard_ns.store(link.last_heard_ns());
  status.round_trip_ns.store(link.round_trip_ns());
  status.uncertainty_ns.store(link.clock_uncertainty_ns());
  constexpr auto kFrame = static_cast<std::size_t>(drivers::MessageId::kFrame);
  status.pictures.store(endpoint.stats().sent[kFrame] + endpoint.stats().received[kFrame]);
  status.session.store(link.sessions());
  status.refused.store(state == State::kFault && !lasting);
  status.closed.store(lasting ? state != State::kReady : state >= State::kClosed);
}

template <class Side>
std::unique_ptr<drivers::LinkTransport> open_link(const Scene& scene, const BoxPlan& plan) {
  std::unique_ptr<drivers::LinkTransport> link;
  if (plan.lasting())
    link = take(plan.open_link());
  else
    link = take(Side::open_link(scene, plan));
  if (!link->emulate(scene.link.network, plan.epoch_host_ns))
    throw std::runtime_error(
        "link.network: the emulator carries the plain link alone (--plain); not TLS");
  return link;
}

// Log lines and inputs to the black box; what the disk refuses of either is told.
template <class Side>
void feed_black_box(rt::NonRealtime& nrt, BoxRunner& runner, Side& side, InputRecorder* inputs) {
  runner.say = [&](std::string_view line) { side.console.say(runner.now(), line); };
  const std::string file = runner.plan.folder + "/" + Side::kName + ".log";
  side.console.log_to(
      nrt, file,
      [&runner](std::string_view line) {
        if (runner.black_box) runner.black_box->line(line);
      },
      [&runner, file] {
        runner.refused.tell(runner.name(), file, "the log is short from here on");
      });
  if (inputs == nullptr) return;
  inputs->also(
      [&runner](const JobOp& op) {
        if (runner.black_box) runner.black_box->add(op);
      },
      [&runner](const Tally& t) {
        const RecordingMark mark{rt::ns_of(runner.now()), t.ops, t.messages, t.frames};
        if (runner.black_box) runner.black_box->add(mark);
      });
}

// At the end each file is tried, whatever became of the others.
void try_write(BoxRunner& runner, const std::function<void()>& write) {
  try {
    write();
  } catch (const std::exception& e) {
    runner.refused.tell(runner.name(), e.what());
  }
}

template <class Side>
void save_whole(const std::string& folder, Side& side, BoxRunner& runner) {
  auto& half = side.half();
  half.totals = runner.totals;
  half.dropped_records = runner.dropped;
  half.hangs = runner.hangs;
  half.ordinary = runner.ordinary;
  half.complete = true;
  if (!side.save(folder))
    runner.refused.tell(runner.name(), folder + "/" + runner.name() + ".view",
                        "the report lacks the end of the run");
}

// What comes from a page between two ticks of the console.
void attend_page(BoxRunner& runner, OperatorSide& side) {
  if (runner.options.page == nullptr) return;
  runner.rest = [&](rt::Nanos most) { side.rest(most, [&runner] { return runner.now(); }); };
}
void attend_page(BoxRunner&, RobotSide&) {}

template <class Side>
int run_side(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
             const BoxPlan& plan) {
  BoxOptions box_options;
  const auto clock = plan.clock_of(Side::kBox);
  box_options.epoch = clock.from_host(plan.epoch_host_ns);
  box_options.faults = plan.faults;
  box_options.mode_gate = plan.host.modes.gate;
  box_options.now = [clock] { return clock.from_host(rt::monotonic_ns()); };
  Side::complete(box_options);
  BoxRunner runner{options, plan, Side::kBox, clock};
  runner.picture_road.lossless = scene.graph.capture.pictures.depth_codec == "lossless";
  const auto inputs = start_recorder(nrt, Side::kBox, scene, options, plan, box_options.now);
  wrap_devices(nrt, inputs.get(), options.page, box_options);
  Side side(nrt, scene, options, box_options);
  auto& graph = side.box.graph();
  if (inputs) inputs->attach(graph, side.box.endpoint());
  feed_black_box(nrt, runner, side, inputs.get());
  const auto registry = enter_registry(plan, Side::kBox);
  const auto opened = open_link<Side>(scene, plan);
  auto& link = *opened;
  link.start(side.box.endpoint(), box_options.now, scene.link.shape,
             [&] { show_link(link, side.box.endpoint(), plan.lasting(), graph.link()); });

  runner.placed = placed_tasks(plan, Side::kBox, [&](tasks::TaskId id) -> rt::TaskBody& {
    rt::TaskBody& body = graph.body(id);
    return inputs ? inputs->body(id, body) : body;
  });
  if (plan.lasting()) side.keep_phase(runner.placed);
  runner.requests = &graph.requests();
  runner.link = &link;
  runner.link_status = &graph.link();
  runner.tick = [&](rt::Time t) {
    side.tick(t, link);
    if (!inputs) return;
    inputs->drain();
    if (const auto line = inputs->problem(); !line.empty())
      runner.refused.tell(runner.name(), line);
  };
  attend_page(runner, side);
  runner.save = [&] { return side.save(plan.folder); };
  runner.make_safe = [&] { side.make_safe(); };
  runner.mode = [&] { return side.console.seen().mode; };
  if constexpr (Side::kBox == rt::Box::kRobot)
    runner.camera_twin_cpu = [&] { return side.box.camera_twin_cpu_ns(); };
  save_effects(plan.folder, Side::kName, side.box.effects());
  if (plan.lasting())
    runner.answer_status();
  else
    runner.await_link();
  runner.run(nrt, plan.folder + "/" + Side::kName + ".run");
  try_write(runner, [&] { side.finish(nrt, link); });
  link.stop();
  if (inputs) try_write(runner, [&] { inputs->finish(); });
  save_whole(plan.folder, side, runner);
  if (runner.hangs > 0) return kTaskHung;
  return runner.refused.any() ? kFileRefused : 0;
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

void check_room(const BoxPlan& plan, std::optional<rt::Box> box) {
  (void)enter_registry(plan, box);
}

int run_operator_process(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                         const BoxPlan& plan) {
  return with_errors("operator", [&] { return run_side<OperatorSide>(nrt, scene, options, plan); });
}

int run_robot_process(rt::NonRealtime& nrt, const Scene& scene, const DemoOptions& options,
                      const BoxPlan& plan) {
  return with_errors("robot", [&] { return run_side<RobotSide>(nrt, scene, options, plan); });
}

}  // namespace teletact
