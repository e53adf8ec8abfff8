#include "tools/desk/desk_sessions.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace teletact {

namespace {

ConsoleAnswer no_session(std::string why) { return {false, std::move(why), {}}; }
ConsoleAnswer with_text(const std::string& text) {
  return {true, {}, nlohmann::json{{"text", text}}.dump()};
}

std::string count_of(std::size_t n, const char* one) {
  return std::to_string(n) + " " + one + (n == 1 ? "" : "s");
}
std::string counts(const SavedSession& s) {
  return count_of(s.obstacles.size(), "keep-out") + ", " + count_of(s.marks_W.size(), "mark") +
         ", " + count_of(s.objects.size(), "object");
}

}  // namespace

DeskSessions::DeskSessions(SessionPlace place, bool at_once)
    : place_(std::move(place)), worker_(place_.folder, at_once) {}

bool DeskSessions::put(SessionWorker::Job job) {
  if (asked_ || opening_) return false;
  return asked_ = worker_.put(std::move(job));
}

std::optional<ConsoleAnswer> DeskSessions::save(const DeskItem& item, SavedSession now) {
  if (place_.folder.empty()) return no_session("this run keeps no sessions");
  now.name = item.intent.text;
  now.world = place_.world;
  if (!put({SessionWorker::Job::Kind::kSave, item.session, item.id, std::move(now),
            place_.scene_toml}))
    return no_session("another session is being saved or opened: in a moment");
  return std::nullopt;
}

std::optional<ConsoleAnswer> DeskSessions::open(const DeskItem& item) {
  if (place_.folder.empty()) return no_session("this run keeps no sessions");
  SavedSession wanted;
  wanted.name = item.intent.text;
  if (!put({SessionWorker::Job::Kind::kOpen, item.session, item.id, std::move(wanted), {}}))
    return no_session("another session is being saved or opened: in a moment");
  return std::nullopt;
}

void DeskSessions::begin(Opening opening, const SessionHands& hands, const Answer& answer) {
  if (const std::string why = hands.why_not(); !why.empty())
    return answer(opening.asker, opening.id, no_session(why));
  opening_ = std::move(opening);
  objects_.clear();
}

void DeskSessions::take(SessionWorker::Done done, const SessionHands& hands, const Answer& answer) {
  using Kind = SessionWorker::Job::Kind;
  if (done.kind != Kind::kOpen) rows_ = std::move(done.rows);
  if (rows_.size() > kMostRows) rows_.resize(kMostRows);
  if (done.kind == Kind::kList) return;
  asked_ = false;
  const std::string& name = done.session.name;
  if (!done.why.empty()) return answer(done.asker, done.id, no_session(done.why));
  if (done.kind == Kind::kSave) {
    if (std::find(saved_.begin(), saved_.end(), name) == saved_.end()) saved_.push_back(name);
    hands.tell(name + " saved: " + counts(done.session));
    return answer(done.asker, done.id,
                  with_text("Saved: " + counts(done.session) +
                            ". The map follows when this run ends: end it by Ctrl-C."));
  }
  if (done.session.world != place_.world)
    return answer(done.asker, done.id,
                  no_session(name +
                             " belongs to another map: end this run, then teletact demo "
                             "--console --session " +
                             name));
  begin({done.asker, done.id, std::move(done.session)}, hands, answer);
}

// As far as the ring takes it.
void DeskSessions::put_back(const SessionHands& hands, const Answer& answer) {
  Opening& o = *opening_;
  if (!o.erased && !hands.erase_all()) return;
  o.erased = true;
  for (; o.drawn < o.session.obstacles.size(); ++o.drawn)
    if (!hands.draw(o.session.obstacles[o.drawn])) return;
  const std::string what = counts(o.session);
  hands.marks(std::move(o.session.marks_W));
  for (SavedObject& object : o.session.objects) objects_.push_back(std::move(object));
  hands.tell(o.session.name + " opened: " + what);
  if (o.asker != 0)
    answer(o.asker, o.id,
           with_text("Opened: " + what +
                     (objects_.empty() ? "." : ". Objects follow as they are seen.")));
  opening_.reset();
}

void DeskSessions::keep(const SessionHands& hands, const Answer& answer) {
  if (place_.folder.empty()) return;
  if (!listed_) listed_ = worker_.put({});
  if (place_.at_start && hands.why_not().empty()) {
    begin({0, 0, std::move(*place_.at_start)}, hands, answer);
    place_.at_start.reset();
  }
  for (SessionWorker::Done& done : worker_.take()) take(std::move(done), hands, answer);
  if (opening_) put_back(hands, answer);
  if (!opening_ && !objects_.empty() && hands.give(objects_.front())) objects_.pop_front();
}

}  // namespace teletact
