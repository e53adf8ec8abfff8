#include "tools/desk/desk.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "config/schema.hpp"
#include "rt/clock/box_time.hpp"

namespace teletact {

namespace {

DeskOptions complete(DeskOptions o, const Scene& scene) {
  if (!o.clock) o.clock = &rt::monotonic_ns;
  if (!o.sessions.folder.empty()) o.sessions.scene_toml = config::effective(scene.schema);
  return o;
}

}  // namespace

Desk::Desk(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
           DeskOptions options, DeskPort port)
    : console_(console),
      options_(complete(std::move(options), scene)),
      port_(std::move(port)),
      events_(epoch, options_.log),
      acts_(box, console, events_, options_.hand, options_.clicks_at_once,
            std::move(options_.sessions)),
      show_(box, console, scene, epoch, port_, figures_, options_.tasks) {}

std::optional<ConsoleAnswer> Desk::take(std::uint32_t session, std::int64_t id,
                                        std::string_view act, const nlohmann::json& intent) {
  const auto refuse = [this](std::string why) {
    refused_.fetch_add(1);
    return ConsoleAnswer{false, std::move(why), {}};
  };
  auto read = read_intent(act, intent);
  if (!read) return refuse(read.error());
  if (!options_.no_acts.empty()) return refuse(options_.no_acts);
  DeskItem item;
  item.session = session;
  item.id = id;
  item.arrived_ns = clock_ns();
  item.intent = std::move(read).value();
  if (!inbox_.put(std::move(item))) return refuse("too much at once");
  return std::nullopt;
}

// The operator's page came, went, or handed over: what it held is to end, and nothing that waits
// from before counts for another.
void Desk::role(const RoleEvent& event) {
  using Kind = RoleEvent::Kind;
  const bool mine = event.person.role == ConsoleRole::kOperator;
  DeskItem item;
  item.session = event.person.session;
  item.who = event.person.name + " (session " + std::to_string(event.person.session) + ")";
  item.arrived_ns = clock_ns();
  if (event.kind == Kind::kLeft && mine)
    item.kind = DeskItem::Kind::kLeft;
  else if ((event.kind == Kind::kJoined && mine) || event.kind == Kind::kOperator)
    item.kind = DeskItem::Kind::kJoined;
  else
    return;
  static_cast<void>(inbox_.put(std::move(item)));
}

void Desk::answer(std::uint32_t session, std::int64_t id, const ConsoleAnswer& a) {
  if (!a.ok) refused_.fetch_add(1);
  events_.note(now_, "answer",
               "session " + std::to_string(session) + ", " + std::to_string(id) + ": " +
                   (a.ok ? std::string("done") : "refused: " + a.why));
  if (port_.answer) port_.answer(session, id, a);
}

void Desk::do_acts(rt::Time now) {
  const std::int64_t clock = clock_ns();
  const rt::Time before = std::exchange(now_, now);
  const auto said = [&](const DeskItem& item) {
    figures_.intent_ms.add(1e-6 * static_cast<double>(clock - item.arrived_ns));
    const rt::Time at = now - rt::Nanos{std::max<std::int64_t>(0, clock - item.arrived_ns)};
    // A paced clock may be slower than the one of arrivals; but it came after the last look.
    return options_.paced ? std::max(at, std::min(before, now)) : at;
  };
  for (const DeskItem& item : inbox_.take()) {
    if (item.kind == DeskItem::Kind::kLeft) {
      acts_.left();
      events_.add(now, "page", "the operator's page is gone");
      events_.note(now, "role", item.who + " has left");
    } else if (item.kind == DeskItem::Kind::kJoined) {
      events_.note(now, "role", item.who + " acts from now on");
      acts_.left();
      acts_.keep(now, [this](auto s, auto id, const auto& a) { answer(s, id, a); });
      acts_.joined();
    } else if (item.intent.act == Act::kDrive || item.intent.act == Act::kHand) {
      const std::string why = item.intent.act == Act::kDrive
                                  ? acts_.drive(item.intent, said(item), now)
                                  : acts_.hand(item.intent, now);
      if (!why.empty()) answer(item.session, item.id, {false, why, {}});
    } else {
      if (item.intent.act != Act::kToken)
        events_.note(now, "act",
                     "session " + std::to_string(item.session) + ", " + std::to_string(item.id) +
                         ": " + std::string(name_of(item.intent.act)));
      if (auto a = acts_.act(item, said(item), now)) answer(item.session, item.id, *a);
    }
  }
}

void Desk::take_acts(rt::Time now) {
  do_acts(now);
  acts_.keep(now, [this](auto s, auto id, const auto& a) { answer(s, id, a); });
}

void Desk::tick(rt::Time now) {
  take_acts(now);
  for (const ShownProposal& p : acts_.objects().take_shown()) show_.show_proposal(p, now);
  events_.watch(console_.seen(), now);
  DeskFacts facts;
  facts.paced = options_.paced;
  facts.takes_acts = options_.no_acts.empty();
  facts.device = options_.device;
  show_.tick(acts_, events_, facts, now);
}

}  // namespace teletact
