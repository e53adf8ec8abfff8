// What a page asks for over its WebSocket: checked in this order: form, speed, order, role.
#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>

#include "rt/clock/box_time.hpp"
#include "tools/console/intent_envelope.hpp"
#include "tools/console/server_core.hpp"
#include "tools/console/ws_viewer.hpp"

namespace teletact {

namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
// Too fast for so long: closed.
constexpr std::int64_t kFast_ns = 2 * kSecond_ns;
// Sent many times a second, and answered only where they are refused: acts that are held, and what
// the page has seen.
constexpr std::array<std::string_view, 4> kStreams = {"token", "hand", "drive", "seen"};

// Index in kStreams; -1: none.
int stream_of(std::string_view act) {
  const auto* const at = std::find(kStreams.begin(), kStreams.end(), act);
  return at == kStreams.end() ? -1 : static_cast<int>(at - kStreams.begin());
}

// False: beyond the limit. `too_long`: has been for kFast_ns without a pause of a second.
bool in_time(WsViewer& v, int stream, std::int64_t now_ns, bool& too_long) {
  const bool good = stream < 0 ? v.act_rate.take(now_ns)
                               : v.stream_rates[static_cast<std::size_t>(stream)].take(now_ns);
  if (good) return true;
  if (v.fast_since_ns == 0 || now_ns - v.fast_last_ns > kSecond_ns) v.fast_since_ns = now_ns;
  v.fast_last_ns = now_ns;
  too_long = now_ns - v.fast_since_ns >= kFast_ns;
  return false;
}

ConsoleAnswer refusal(std::string why) { return {false, std::move(why), {}}; }

// A token's `t`, the page's own time, is said back at once beside the box's: by that the page knows
// how late its line is (docs/console_protocol.md, Time).
std::optional<ConsoleAnswer> echo_of(const IntentEnvelope& e) {
  const auto t = e.intent.find("t");
  if (e.act != "token" || t == e.intent.end() || !t->is_number()) return {};
  return ConsoleAnswer{true, {}, nlohmann::json{{"t", *t}}.dump()};
}

// Whoever only looks on may say it too.
bool holds_nothing(const IntentEnvelope& e) {
  const auto holds = e.intent.find("holds");
  return e.act == "token" && holds != e.intent.end() && holds->is_array() && holds->empty();
}

// Of any role, for the server alone.
std::optional<ConsoleAnswer> take_seen(WsViewer& viewer, const IntentEnvelope& e) {
  const auto bytes = e.intent.find("bytes");
  const bool good = e.intent.size() == 3 && bytes != e.intent.end() &&
                    bytes->is_number_unsigned() && viewer.seen(bytes->get<std::uint64_t>());
  if (good) return {};
  return refusal("intent: bytes: as many as have been seen since the connection stands");
}

}  // namespace

ViewBytes ServerCore::answer_view(std::int64_t id, const ConsoleAnswer& answer) {
  nlohmann::json json{{"id", id}, {"ok", answer.ok}};
  if (!answer.why.empty()) json["why"] = answer.why;
  if (!answer.result.empty()) {
    auto result = nlohmann::json::parse(answer.result, nullptr, false);
    if (!result.is_discarded()) json["result"] = std::move(result);
  }
  using Handler = nlohmann::json::error_handler_t;
  std::string text = json.dump(-1, ' ', false, Handler::replace);
  if (text.size() > kMostViewBytes[static_cast<std::size_t>(ViewKind::kAnswer)]) {
    ++tally.views_refused;
    text = nlohmann::json{{"id", id}, {"ok", answer.ok}, {"why", "the result is too long"}}.dump();
  }
  ViewStamp stamp;
  {
    const std::lock_guard held(shared_mutex);
    if (clock_s) stamp.time_s = clock_s();
  }
  const std::lock_guard held(inbox.mutex);
  const auto kind = static_cast<std::size_t>(ViewKind::kAnswer);
  return make_view(ViewKind::kAnswer, inbox.sequence[kind]++, stamp,
                   {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

void ServerCore::act(WsViewer& viewer, std::string_view text) {
  auto read = read_envelope(text);
  std::optional<ConsoleAnswer> answer;
  std::int64_t id = -1;  // of what has none
  if (read) {
    id = read.value().id;
    answer = do_act(viewer, read.value());
  } else {
    bool too_long = false;
    tally.refuse(Refusal::kEnvelope);
    if (!in_time(viewer, -1, rt::monotonic_ns(), too_long)) tally.refuse(Refusal::kRate);
    answer = refusal(read.error());
    if (too_long || ++viewer.refused_form >= WsViewer::kMostRefused)
      viewer.close(kClosePolicy, "not intents");
  }
  if (!answer || viewer.mailbox.put_answer(answer_view(id, *answer))) return;
  tally.refuse(Refusal::kSlow);
  viewer.close(kClosePolicy, "answers are not read");
}

std::optional<ConsoleAnswer> ServerCore::do_act(WsViewer& viewer, const IntentEnvelope& e) {
  if (e.act == "stop") {
    stop_asked(viewer.session);
    return ConsoleAnswer{true, {}, {}};
  }
  const std::int64_t now = rt::monotonic_ns();
  const int stream = stream_of(e.act);
  bool too_long = false;
  if (!in_time(viewer, stream, now, too_long)) {
    tally.refuse(Refusal::kRate);
    if (too_long) viewer.close(kClosePolicy, "too fast");
    if (e.act == "token") return {};
    return refusal("too fast: 200 intents a second, of hand, drive and seen 100 each");
  }
  if (e.id <= viewer.last_id) {
    tally.refuse(Refusal::kEnvelope);
    return refusal("intent: id: not above that of the one before");
  }
  viewer.last_id = e.id;
  if (e.act == "seen") {
    auto refused = take_seen(viewer, e);
    if (!refused) return {};
    tally.refuse(Refusal::kEnvelope);
    if (++viewer.refused_form >= WsViewer::kMostRefused) viewer.close(kClosePolicy, "not intents");
    return refused;
  }
  const bool asks = e.act == "ask_role", gives = e.act == "give_role", takes = e.act == "take_role";
  if (asks || gives || takes) {
    ++tally.acts;
    std::string why = asks    ? sessions.ask(viewer.session, now)
                      : gives ? sessions.give(viewer.session, now)
                              : sessions.take(viewer.session, now);
    if (!why.empty()) tally.refuse(Refusal::kRole);
    tell_roles();
    return ConsoleAnswer{why.empty(), std::move(why), {}};
  }
  const ConsolePerson from = sessions.person(viewer.session);
  if (from.role != ConsoleRole::kOperator) {
    if (holds_nothing(e)) return echo_of(e);
    tally.refuse(Refusal::kRole);
    if (++viewer.refused_role >= WsViewer::kMostRefused)
      viewer.close(kCloseRole, "only the operator may act");
    if (e.act == "token") return {};
    return refusal("only the operator may act: ask for the role");
  }
  ++tally.acts;
  auto answer = ask_callback({from, e.id, e.act, e.intent});
  if (e.act == "token") return echo_of(e);
  if (answer && answer->ok && stream >= 0) return {};
  return answer;
}

std::optional<ConsoleAnswer> ServerCore::ask_callback(const ConsoleAct& act) {
  if (!callbacks.on_act) return refusal("this run takes no acts");
  try {
    return callbacks.on_act(act);
  } catch (const std::exception& e) {
    return refusal(std::string("failed: ") + e.what());
  }
}

}  // namespace teletact
