#include "tools/console/console_sessions.hpp"

#include <openssl/sha.h>

#include <algorithm>
#include <utility>

namespace teletact {

namespace {

SecretHash hash_of(std::string_view text) {
  SecretHash hash{};
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), hash.data());
  return hash;
}

}  // namespace

std::string secret_text(const ConsoleSecret& secret) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t b : secret) {
    text += kDigits[b >> 4U];
    text += kDigits[b & 15U];
  }
  return text;
}

void ConsoleSessions::add_code(const ConsoleSecret& code, bool view_only, std::int64_t now_ns) {
  codes_.push_back({hash_of(secret_text(code)), view_only, now_ns + limits_.code_life.count()});
  const auto same = [&](const Code& c) { return c.view_only == view_only; };
  if (static_cast<std::size_t>(std::count_if(codes_.begin(), codes_.end(), same)) > kMostCodes)
    codes_.erase(std::find_if(codes_.begin(), codes_.end(), same));
}

std::uint32_t ConsoleSessions::exchange(std::string_view code, std::uint32_t before,
                                        const ConsoleSecret& fresh, const std::string& name,
                                        std::int64_t now_ns) {
  forget_old(now_ns);
  const SecretHash hash = hash_of(code);
  const auto found =
      std::find_if(codes_.begin(), codes_.end(), [&](const Code& c) { return c.hash == hash; });
  if (found == codes_.end()) return 0;
  const bool view_only = found->view_only;
  // A view link opened in the operator's browser makes no viewer of it.
  const Session* old = at(before);
  const bool was_operator = old != nullptr && old->person.role == ConsoleRole::kOperator;
  if (old == nullptr && !make_room(now_ns)) return 0;
  codes_.erase(found);
  Session made{hash_of(secret_text(fresh)), {}, now_ns};
  made.person.session = ++last_;
  made.person.view_only = view_only && (old == nullptr || old->person.view_only);
  made.person.name = !name.empty() ? name
                                   : (made.person.view_only ? "viewer " : "operator ") +
                                         std::to_string(made.person.session);
  const bool free_now = the_operator() == nullptr || away(*the_operator(), now_ns) || was_operator;
  sessions_.push_back(std::move(made));
  if ((!view_only || was_operator) && free_now) make_operator(sessions_.back());
  drop(before, now_ns);
  return last_;
}

std::uint32_t ConsoleSessions::find(std::string_view secret, std::int64_t now_ns) {
  forget_old(now_ns);
  const SecretHash hash = hash_of(secret);
  for (const Session& s : sessions_)
    if (s.hash == hash) return s.person.session;
  return 0;
}

void ConsoleSessions::connected(std::uint32_t session, std::int64_t now_ns) {
  Session* s = at(session);
  if (s == nullptr) return;
  s->since_ns = now_ns;
  s->person.connected = true;
  events_.push_back({RoleEvent::Kind::kJoined, s->person, {}});
}

void ConsoleSessions::disconnected(std::uint32_t session, std::int64_t now_ns) {
  Session* s = at(session);
  if (s == nullptr || !s->person.connected) return;
  s->since_ns = now_ns;
  s->person.connected = false;
  if (asker_ == session) asker_ = 0;
  events_.push_back({RoleEvent::Kind::kLeft, s->person, {}});
}

void ConsoleSessions::drop(std::uint32_t session, std::int64_t now_ns) {
  disconnected(session, now_ns);
  std::erase_if(sessions_, [&](const Session& s) { return s.person.session == session; });
}

std::string ConsoleSessions::ask(std::uint32_t session, std::int64_t now_ns) {
  forget_old(now_ns);
  const Session* s = at(session);
  if (s == nullptr) return "no session";
  if (s->person.role == ConsoleRole::kOperator) return "you are the operator";
  if (asker_ != 0 && asker_ != session) return person(asker_).name + " has asked before";
  if (asker_ == session) return {};  // its time goes on
  asker_ = session;
  asked_ns_ = now_ns;
  events_.push_back({RoleEvent::Kind::kAsked, s->person, {}});
  return {};
}

std::string ConsoleSessions::give(std::uint32_t session, std::int64_t now_ns) {
  forget_old(now_ns);
  const Session* s = at(session);
  if (s == nullptr || s->person.role != ConsoleRole::kOperator) return "you are not the operator";
  Session* to = at(asker_);
  if (to == nullptr) return "nobody asks for the operator's role";
  make_operator(*to);
  return {};
}

std::string ConsoleSessions::take(std::uint32_t session, std::int64_t now_ns) {
  forget_old(now_ns);
  Session* s = at(session);
  if (s == nullptr) return "no session";
  if (s->person.role == ConsoleRole::kOperator) return {};
  if (s->person.view_only) return "this session may only look: ask the operator to hand over";
  const Session* now = the_operator();
  const bool unanswered = asker_ == session && now_ns - asked_ns_ >= limits_.asked.count();
  if (now != nullptr && !away(*now, now_ns) && !unanswered)
    return now->person.name + " is the operator: ask for the role";
  make_operator(*s);
  return {};
}

ConsolePerson ConsoleSessions::person(std::uint32_t session) const {
  const Session* s = at(session);
  return s == nullptr ? ConsolePerson{} : s->person;
}

std::vector<ConsolePerson> ConsoleSessions::people() const {
  std::vector<ConsolePerson> all;
  all.reserve(sessions_.size());
  for (const Session& s : sessions_) all.push_back(s.person);
  return all;
}

std::vector<RoleEvent> ConsoleSessions::take_events() { return std::exchange(events_, {}); }

ConsoleSessions::Session* ConsoleSessions::at(std::uint32_t session) noexcept {
  for (Session& s : sessions_)
    if (session != 0 && s.person.session == session) return &s;
  return nullptr;
}

const ConsoleSessions::Session* ConsoleSessions::at(std::uint32_t session) const noexcept {
  return const_cast<ConsoleSessions*>(this)->at(session);
}

ConsoleSessions::Session* ConsoleSessions::the_operator() noexcept {
  for (Session& s : sessions_)
    if (s.person.role == ConsoleRole::kOperator) return &s;
  return nullptr;
}

bool ConsoleSessions::away(const Session& s, std::int64_t now_ns) const noexcept {
  return !s.person.connected && now_ns - s.since_ns >= limits_.absence.count();
}

// The one that has been away the longest goes.
bool ConsoleSessions::make_room(std::int64_t now_ns) {
  if (sessions_.size() < kMostSessions) return true;
  const Session* oldest = nullptr;
  for (const Session& s : sessions_) {
    if (s.person.connected || s.person.role == ConsoleRole::kOperator) continue;
    if (oldest == nullptr || s.since_ns < oldest->since_ns) oldest = &s;
  }
  if (oldest == nullptr) return false;
  drop(oldest->person.session, now_ns);
  return true;
}

void ConsoleSessions::make_operator(Session& s) {
  RoleEvent e{RoleEvent::Kind::kOperator, {}, {}};
  if (Session* before = the_operator(); before != nullptr && before != &s) {
    before->person.role = ConsoleRole::kViewer;
    e.other = before->person;
  }
  s.person.role = ConsoleRole::kOperator;
  if (asker_ == s.person.session) asker_ = 0;
  e.person = s.person;
  events_.push_back(e);
}

void ConsoleSessions::forget_old(std::int64_t now_ns) {
  std::erase_if(codes_, [&](const Code& c) { return now_ns > c.until_ns; });
  std::erase_if(sessions_, [&](const Session& s) {
    return !s.person.connected && now_ns - s.since_ns > limits_.session_life.count();
  });
  if (asker_ != 0 && now_ns - asked_ns_ > kAskingLife.count()) asker_ = 0;
}

}  // namespace teletact
