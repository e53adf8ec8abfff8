#include "tools/desk/page_desk.hpp"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "perception/map_file/map_file.hpp"
#include "rt/clock/box_time.hpp"

namespace teletact {

// Until the desk stands nothing is taken: the server starts with it in hand, but not at once.
ConsoleCallbacks PageDesk::callbacks() {
  ConsoleCallbacks c;
  c.on_act = [this](const ConsoleAct& act) -> std::optional<ConsoleAnswer> {
    if (!open_.load()) return ConsoleAnswer{false, "the box is not up yet", {}};
    return desk_->take(act.from.session, act.id, act.act, act.intent);
  };
  c.on_stop = [this](const ConsolePerson&) {
    if (open_.load()) desk_->stop();
  };
  c.on_role = [this](const RoleEvent& event) {
    if (open_.load()) desk_->role(event);
  };
  return c;
}

DeskPort PageDesk::port() {
  DeskPort p;
  p.viewers = [this] { return server_->viewers(); };
  p.publish = [this](ViewKind kind, const ViewStamp& at, std::span<const std::uint8_t> body) {
    return server_->publish(kind, at, body);
  };
  p.wants_whole_mesh = [this] { return server_->wants_whole_mesh(); };
  p.mesh = [this](const perception::MeshDelta& d, const ViewStamp& at, double edge_m) {
    return server_->publish_mesh(d, at, edge_m);
  };
  p.answer = [this](std::uint32_t session, std::int64_t id, const ConsoleAnswer& a) {
    server_->answer(session, id, a);
  };
  p.people = [this] { return server_->people(); };
  p.text_to = [this](std::uint32_t session, const ViewStamp& at, std::string_view text) {
    return server_->send_to(
        session, ViewKind::kText, at,
        std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
  };
  p.view_to = [this](std::uint32_t session, ViewKind kind, const ViewStamp& at,
                     std::span<const std::uint8_t> body) {
    return server_->send_to(session, kind, at, body);
  };
  p.server_cpu_ns = [this] { return server_->counts().cpu_ns; };
  return p;
}

drivers::HapticDevice* PageDesk::hand_over(rt::NonRealtime& nrt, drivers::HapticDevice& device) {
  hand_ = std::make_unique<PageHand>(nrt, device, options_.hand);
  return hand_.get();
}

void PageDesk::open(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
                    Clock clock) {
  epoch_ = epoch;
  box_ = &box;
  options_.desk.paced = clock != Clock::kReal;
  if (clock == Clock::kFree)
    options_.desk.no_acts =
        "the simulated clock runs as fast as it goes, ahead of any person: use --clock paced";
  options_.desk.hand = hand_.get();
  options_.desk.tasks = &tasks_;
  if (hand_) hand_->bind(box.graph().haptic());
  auto started = ConsoleServer::start(options_.server, callbacks());
  if (!started) throw std::runtime_error("--console: " + started.error());
  server_ = std::move(started).value();
  server_->set_clock([this] { return clock_s(); });
  desk_ = std::make_unique<Desk>(box, console, scene, epoch, options_.desk, port());
  open_.store(true);
  offer_.emplace(rt::monotonic_ns());
  const std::string url = server_->url();
  if (options_.tell) options_.tell(url);
  if (!options_.quiet) {
    std::printf("console: %s\n", url.c_str());
    std::fflush(stdout);
  }
  if (options_.open_browser && !door_.open(url)) say_no_browser();
}

void PageDesk::say_no_browser() {
  std::printf("--open: there is no desktop to open a browser on; open the address above\n");
  std::fflush(stdout);
}

// Seconds of the box's clock, for what the server makes between two ticks. A simulated clock stands
// between them; the real one goes on even if the console's thread does not.
double PageDesk::clock_s() const {
  const std::int64_t ahead = ahead_ns_.load();
  if (options_.desk.paced || ahead == kNoTick) return now_s_.load();
  return 1e-9 * static_cast<double>(rt::monotonic_ns() - ahead);
}

void PageDesk::keep_clock(rt::Time now) {
  now_s_.store(rt::seconds(now - epoch_));
  // `now` was read a little earlier: the least is the nearest.
  ahead_ns_.store(std::min(ahead_ns_.load(), rt::monotonic_ns() - (now - epoch_).count()));
}

void PageDesk::tick(rt::Time now) {
  keep_clock(now);
  if (desk_) desk_->tick(now);
  // It has led there; what a browser ends with afterwards is no failure.
  offer_again();
  const bool shown = server_ && server_->viewers() > 0;
  if (shown) door_.remove();
  if (door_.look() == BrowserDoor::Asked::kFailed && !shown) say_no_browser();
}

// Whoever closed the browser, or came an hour late, needs a new code.
void PageDesk::offer_again() {
  if (!server_ || !open_.load()) return;
  const auto people = server_->people();
  const bool there = std::any_of(people.begin(), people.end(), [](const ConsolePerson& p) {
    return p.role == ConsoleRole::kOperator && p.connected;
  });
  if (!offer_->due(there, rt::monotonic_ns())) return;
  const std::string url = server_->url();
  if (options_.tell) options_.tell(url);
  if (options_.quiet) return;
  std::printf("console: nobody operates; a new address: %s\n", url.c_str());
  std::fflush(stdout);
}

bool PageDesk::await_acts(rt::Nanos most) {
  return open_.load() ? desk_->await_acts(most) : PageHook::await_acts(most);
}

void PageDesk::take_acts(rt::Time now) {
  keep_clock(now);
  desk_->take_acts(now);
}

// Figures of what happened with somebody there.
void PageDesk::write_figures() const {
  const DeskFigures& f = desk_->figures();
  const auto over = [&](double v) { return f.seconds > 0 ? v / f.seconds : -1; };
  const nlohmann::json all{{"console.intent_p95_ms", f.intent_ms.percentile(0.95)},
                           {"console.mesh_p95_ms", f.mesh_ms.percentile(0.95)},
                           {"console.server_share", over(f.cpu_s)},
                           {"console.fps", over(f.pictures)}};
  std::ofstream(options_.figures) << all.dump(1) << '\n';
}

// Of the sessions that this run has saved: the tasks have ended, nobody writes the map any more. A
// session whose map the disk refuses is told, and starts no run.
void PageDesk::write_maps() const {
  const DeskSessions& sessions = desk_->acts().sessions();
  if (sessions.saved().empty()) return;
  rt::Startup startup;
  const tasks::FusionTask& fusion = box_->graph().fusion();
  const std::string bytes =
      perception::encode_map(startup.token(), fusion.map(), fusion.keyframes());
  for (const std::string& name : sessions.saved()) {
    const auto written = sessions.store().save_map(name, bytes);
    if (!written)
      std::fprintf(stderr, "session %s: its map: %s\n", name.c_str(), written.error().c_str());
    if (written && !options_.quiet)
      std::printf("session %s: whole; teletact demo --console --session %s goes on with it\n",
                  name.c_str(), name.c_str());
  }
}

void PageDesk::close() {
  shut();
  if (box_ != nullptr && desk_) write_maps();
  box_ = nullptr;
}

void PageDesk::shut() {
  if (server_) server_->stop();
  door_.remove();
  if (open_.load() && desk_ && !options_.figures.empty()) write_figures();
  open_.store(false);
}

}  // namespace teletact
