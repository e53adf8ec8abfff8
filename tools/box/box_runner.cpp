#include "tools/box/box_runner.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "drivers/road/pem.hpp"
#include "rt/fault/planned.hpp"
#include "rt/sched/real_executor.hpp"
#include "tools/files/build_info.hpp"
#include "tools/host/store_watch.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

namespace {

constexpr const char* kRegistry = "teletact";
// From the request to the last job: outputs are at zero within 200 ms of the signal, polls
// included. The base needs 125 ms from its speed limit (robot_io.trajectory), the hand 100
// (haptic.ramp_s).
constexpr std::int64_t kRampDown = 150000000;
constexpr std::int64_t kPoll = 5000000, kConsolePeriod = 20000000, kSavePeriod = 1000000000;
// A box of its own runs until it is stopped.
constexpr rt::Nanos kForEver = std::chrono::hours{24 * 365 * 10};

}  // namespace

std::vector<rt::PlacedTask> placed_tasks(const BoxPlan& plan, rt::Box box,
                                         const std::function<rt::TaskBody&(tasks::TaskId)>& body) {
  std::vector<rt::PlacedTask> placed;
  for (std::size_t i = 0; i < plan.host.specs.size(); ++i) {
    if (plan.host.specs[i].box != box) continue;
    placed.push_back(placed_task(plan.host, i));
    placed.back().body = &body(static_cast<tasks::TaskId>(plan.host.ids[i]));
  }
  for (std::size_t i = 0; i < plan.host.workers.size(); ++i) {
    if (plan.host.workers[i].box == box)
      placed.push_back(placed_task(plan.host, plan.host.specs.size() + i));
  }
  return placed;
}

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

struct BoxRunner::Watch {
  std::int64_t ramp_from = 0, next_save = 0, next_tick = 0;
  bool stopped = false;
  OrdinaryCpu at_epoch{};
  StoreWatch* told = nullptr;
  std::atomic<bool> done{false};
};

// <folder>/<box>.stop: when this process was asked to end, in its box's clock.
void BoxRunner::note_request(std::int64_t host) const {
  const char* name = box == rt::Box::kOperator ? "/operator.stop" : "/robot.stop";
  std::ofstream(plan.folder + name) << rt::ns_of(clock.from_host(host)) << '\n';
}

void BoxRunner::look() {
  tick(now());
  if (black_box) black_box->watch(mode(), now());
  if (plan.lasting()) {
    picture_road.rate_Mbit_per_s = link->notes().rate_Mbit_per_s;
    for (const std::string& line :
         link_news.look(*link, *link_status, picture_road, rt::monotonic_ns())) {
      tell(line);
      if (store != nullptr) store->event(rt::ns_of(now()), line);
    }
  }
  if (status_server) status_server->serve([this] { return status_json(status()); });
}

void BoxRunner::tell(const std::string& line) const {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
  if (say) say(line);
}

void BoxRunner::tell_rights() const {
  for (const std::string& what : *missing) tell("NOT REAL-TIME: " + what);
  if (!missing->empty())
    tell("this box runs all the same; its deadlines hold by chance alone (teletact doctor)");
}

void BoxRunner::answer_status() {
  const auto path = status_socket(box == rt::Box::kRobot ? "robot" : "operator");
  auto opened =
      path ? StatusServer::open(path.value()) : rt::Result<StatusServer>(rt::Error{path.error()});
  if (opened)
    status_server.emplace(std::move(opened).value());
  else
    std::printf("no teletact status of this box: %s\n", opened.error().c_str());
}

void BoxRunner::add_machine(BoxStatus& s) const {
  const auto MiB = [](std::uint64_t bytes) { return static_cast<double>(bytes) / (1U << 20U); };
  if (missing != nullptr) {
    s.real_time = missing->empty() ? "yes" : "no";
    for (const std::string& what : *missing)
      s.real_time += (what == missing->front() ? ": " : "; ") + what;
  }
  if (store != nullptr) s.store_MiB = MiB(store->use().bytes);
  s.store_cap_MiB = MiB(options.store.cap_bytes);
  std::error_code error;
  if (const auto space = std::filesystem::space(plan.folder, error); !error)
    s.disk_free_MiB = MiB(space.available);
}

void BoxRunner::add_link(BoxStatus& s) const {
  using State = drivers::LinkTransport::State;
  const auto ms = [](std::int64_t ns) { return 1e-6 * static_cast<double>(ns); };
  const State state = link->state();
  s.link = state == State::kReady       ? "connected"
           : state == State::kHandshake ? "hand-shake"
                                        : "no other box";
  s.link_fault = state == State::kReady ? std::string() : link->fault();
  s.connections = link->sessions();
  const drivers::LinkNotes notes = link->notes();
  s.peer = notes.peer;
  s.turned_away = notes.refused;
  s.turned_away_newest = notes.refusal;
  s.link_note = notes.note;
  if (notes.certificate_until_s != 0)
    s.certificate_until = drivers::day_of(notes.certificate_until_s);
  s.rate_Mbit_per_s = notes.rate_Mbit_per_s;
  if (link->last_heard_ns() != 0) s.heard_ago_ms = ms(rt::ns_of(now()) - link->last_heard_ns());
  if (link->round_trip_ns() != 0) s.round_trip_ms = ms(link->round_trip_ns());
  s.congestion = link->congestion();
  if (const auto seen = link_status->picture_ns.load(); seen != 0)
    s.picture_age_ms = ms(rt::ns_of(now()) - seen);
  s.pictures_per_s = link_news.pictures_per_s();
  s.pictures = spared_text(link_status->spared());
  if (s.pictures.empty() && state == State::kReady)
    s.pictures = slow_text(picture_road, s.pictures_per_s);
  if (s.pictures.empty()) s.pictures = "whole";
}

BoxStatus BoxRunner::status() const {
  constexpr const char* kModes[] = {"init", "hold", "engaged", "ramp down", "safe stop"};
  const auto ms = [](std::int64_t ns) { return 1e-6 * static_cast<double>(ns); };
  const tasks::ModeMsg newest = mode();
  BoxStatus s;
  s.box = box == rt::Box::kRobot ? "robot" : "operator";
  s.version = kVersion;
  s.pid = ::getpid();
  s.up_s = 1e-3 * ms(rt::monotonic_ns() - plan.epoch_host_ns);
  s.mode = kModes[static_cast<std::size_t>(newest.mode)];
  if (newest.cause != rt::kNoFault) s.cause = fault_text(newest.cause);
  add_link(s);
  add_machine(s);
  s.commands_refused = link_status->commands_refused.load();
  s.commands_refused_reason =
      drivers::to_text(static_cast<drivers::CommandFault>(link_status->commands_newest.load()));
  s.report = options.report;
  return s;
}

// Since their threads began; the console is the thread that asks.
OrdinaryCpu BoxRunner::ordinary_now() const {
  const std::int64_t page = options.page != nullptr ? options.page->cpu_ns() : 0;
  return {link->thread_cpu_ns(), rt::thread_cpu_ns() + page,
          camera_twin_cpu ? camera_twin_cpu() : 0, rt::monotonic_ns()};
}

void BoxRunner::await_link() const {
  while (link->state() != drivers::LinkTransport::State::kReady) {
    if (link->state() == drivers::LinkTransport::State::kFault)
      throw std::runtime_error(link->fault());
    if (rt::monotonic_ns() > plan.epoch_host_ns - 50000000) {
      throw std::runtime_error("link: no handshake in time; the other box's message says why");
    }
    ::usleep(2000);
  }
}

// What is saved grows with the run: of a box of its own it takes a twentieth of this thread at
// most.
void BoxRunner::save_now_and_then(Watch& w, rt::RunStore& writer, std::int64_t host_ns) {
  if (host_ns <= w.next_save || w.ramp_from != 0) return;
  w.next_save += save_period_ns(host_ns - plan.epoch_host_ns);
  writer.flush();
  if (!save())
    refused.tell(name(), plan.folder + "/" + name() + ".view",
                 "the report knows nothing that comes after the last one that was saved");
  if (!plan.lasting()) return;
  const std::int64_t end = rt::monotonic_ns();
  w.next_save = std::max(w.next_save, end + 20 * (end - host_ns));
}

void BoxRunner::watch(Watch& w, rt::RunStore& writer, const std::function<void()>& request_stop,
                      const std::function<std::uint64_t()>& hung,
                      const std::function<const std::vector<std::string>*()>& rights) {
  while (!w.done.load()) {
    const std::int64_t host = rt::monotonic_ns();
    if (w.at_epoch.span_ns == 0 && host >= plan.epoch_host_ns) w.at_epoch = ordinary_now();
    if (host >= w.next_tick) {
      w.next_tick = host + kConsolePeriod;
      look();
      w.told->look(mode(), link_status->spared(), now());
    }
    if (missing == nullptr && (missing = rights()) != nullptr && plan.lasting()) tell_rights();
    if (hung() > 0) requests->watchdog_bit.store(true);
    if (g_stop_requested.load() && w.ramp_from == 0) {
      w.ramp_from = g_stop_asked_ns.load();
      requests->ramp_down.store(true);
      note_request(w.ramp_from);
    }
    // A slow task notices the stop at its next release; the outputs do not wait for it.
    if (w.ramp_from != 0 && host - w.ramp_from > kRampDown && !w.stopped) {
      w.stopped = true;
      request_stop();
      make_safe();
    }
    save_now_and_then(w, writer, host);
    if (rest)
      rest(rt::Nanos{kPoll});
    else
      ::usleep(kPoll / 1000);
  }
}

// A box that comes back on a full disk goes on without one, as when the disk fills later.
void BoxRunner::begin_black_box(const rt::RunLog& header) {
  if (options.black_box_s <= 0) return;
  try {
    black_box = std::make_unique<BoxRecorder>(plan.folder, box, header, options.black_box_s);
    black_box->catch_crashes();
  } catch (const std::system_error& e) {
    const int why = e.code().value();
    if (why != ENOSPC && why != EDQUOT && why != EFBIG) throw;
    refused.tell(name(), plan.folder + "/" + name() + ".blackbox", "this run has no black box");
  }
}

void BoxRunner::end_black_box(bool asked) const {
  if (!black_box) return;
  black_box->end(asked ? kAskedToEnd : hangs > 0 ? "a task hung and was made safe" : "");
}

template <class Faults>
void BoxRunner::run(rt::NonRealtime& nrt, const Faults& faults, const std::string& file) {
  std::unique_ptr<rt::RunStore> writer;
  rt::RealExecutor<Faults> executor(
      nrt, placed, faults, [&](const auto& r) { keep(*writer, r); },
      [&](const auto& r) { keep(*writer, r); });
  // What the machine refuses is known in part only when the threads run: the header tells what is
  // known now, the rest is appended to the notes of a second header line by the caller's report.
  rt::RunLog header = log_header(placed, box, plan.calibration);
  header.not_realtime = executor.missing();
  header.epoch_ns = rt::ns_of(clock.from_host(plan.epoch_host_ns));
  writer = std::make_unique<rt::RunStore>(file, header, options.store);
  store = writer.get();
  StoreWatch told(*writer, box, file, refused);
  begin_black_box(header);
  for (const auto& note : executor.notes())
    std::ofstream(plan.folder + "/notes", std::ios::app) << note << '\n';
  const auto missing_before = executor.missing().size();
  rt::RunPlan run_plan;
  run_plan.epoch_host_ns = plan.epoch_host_ns;
  run_plan.duration = options.seconds > 0 ? rt::nanos_from_seconds(options.seconds) : kForEver;
  run_plan.clock[static_cast<std::size_t>(box)] = clock;
  Watch w;
  w.told = &told;
  w.next_save = plan.epoch_host_ns + kSavePeriod;
  std::thread runner([&] {
    executor.run(run_plan);
    w.done.store(true);
  });
  g_ramp_down.store(&requests->ramp_down);
  watch(
      w, *writer, [&] { executor.request_stop(); }, [&] { return executor.hangs(); },
      [&] { return executor.placed() ? &executor.missing() : nullptr; });
  runner.join();
  make_safe();
  if (w.at_epoch.span_ns != 0) {
    const OrdinaryCpu end = ordinary_now();
    ordinary = {end.link_ns - w.at_epoch.link_ns, end.console_ns - w.at_epoch.console_ns,
                end.camera_twin_ns - w.at_epoch.camera_twin_ns, end.span_ns - w.at_epoch.span_ns};
  }
  g_ramp_down.store(nullptr);
  look();
  const auto t = executor.totals();
  for (std::size_t i = 0; i < placed.size(); ++i) totals.push_back({placed[i].id, t[i]});
  dropped = executor.dropped_records();
  std::vector<rt::RunFileTotals> trailer;
  for (const BoxTotals& b : totals) trailer.push_back({b.task, b.totals});
  writer->finish(trailer, dropped);
  told.look(mode(), link_status->spared(), now());
  store = nullptr;
  missing = nullptr;
  hangs = executor.hangs();
  end_black_box(w.ramp_from != 0);
  for (std::size_t i = missing_before; i < executor.missing().size(); ++i) {
    std::ofstream(plan.folder + "/not_realtime", std::ios::app) << executor.missing()[i] << '\n';
  }
}

// A page is served by the operator's process alone.
void BoxRunner::tell_page(const rt::JobRecord& record) const {
  if (options.page != nullptr && box == rt::Box::kOperator) options.page->job(record);
}
void BoxRunner::tell_page(const rt::SentinelRecord& record) const {
  if (options.page != nullptr && box == rt::Box::kOperator) options.page->sentinel(record);
}

void BoxRunner::run(rt::NonRealtime& nrt, const std::string& file) {
  if (options.page != nullptr && box == rt::Box::kOperator)
    options.page->tasks(log_header(placed, box, plan.calibration));
  std::vector<std::string> names;
  for (const auto& s : plan.host.specs) names.push_back(s.name);
  rt::with_faults(plan.planned ? &plan.faults : nullptr, names,
                  [&](const auto& faults) { run(nrt, faults, file); });
}

}  // namespace teletact
