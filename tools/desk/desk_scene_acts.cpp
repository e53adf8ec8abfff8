// Of the desk: marks, goals, obstacles, regions, accepted objects; all of them saved, opened.
#include <algorithm>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/desk/desk_acts.hpp"

namespace teletact {

using perception::Vec3;
using tasks::Mode;

namespace {

ConsoleAnswer yes() { return {true, {}, {}}; }
ConsoleAnswer no(std::string why) { return {false, std::move(why), {}}; }
std::string json_text(const std::string& text) { return nlohmann::json{{"text", text}}.dump(); }
// So long fusion needs for a full ring of edits, one a job.
constexpr rt::Nanos kRing = std::chrono::milliseconds{1500};

tasks::SceneEdit edit_of(const DrawnObstacle& o) {
  tasks::SceneEdit e;
  e.kind = o.box ? tasks::SceneEdit::Kind::kDrawBox : tasks::SceneEdit::Kind::kDrawDisc;
  e.id = o.id;
  for (int i = 0; i < 3; ++i) {
    e.centre_W[static_cast<std::size_t>(i)] = o.centre_W(i);
    e.half_m[static_cast<std::size_t>(i)] = o.half_m(i);
  }
  e.yaw_rad = o.yaw_rad;
  return e;
}

// The drawn point nearest to the mean of all, as planning takes it of a mark of the hand.
Vec3 marked_point(const std::vector<Vec3>& points) {
  Vec3 mean = Vec3::Zero(), best = points.front();
  for (const Vec3& p : points) mean += p / static_cast<double>(points.size());
  double least = std::numeric_limits<double>::infinity();
  for (const Vec3& p : points) {
    const double d = (p - mean).squaredNorm();
    if (d < least) least = d, best = p;
  }
  return best;
}

// A page shows what the camera has seen, so a marked surface that is no floor faces the camera.
Vec3 facing(const Vec3& p_W, const perception::Pose& X_WC) {
  constexpr double kFloor_m = 0.05;
  Vec3 to_eye = X_WC.translation() - p_W;
  to_eye.z() = 0;
  if (p_W.z() < kFloor_m || to_eye.norm() < 1e-6) return Vec3::UnitZ();
  return to_eye.normalized();
}

std::string at_text(const Vec3& p) {
  char text[64];
  std::snprintf(text, sizeof text, "(%.2f, %.2f) m", p.x(), p.y());
  return text;
}

// Empty: planning may be asked for a goal.
std::string no_goal_now(const OperatorView& seen) {
  if (seen.map->seq == 0) return "there is no map of the floor yet";
  if (seen.mode.mode == Mode::kSafeStop || seen.mode.mode == Mode::kRampDown)
    return "the stack is stopped";
  return {};
}

}  // namespace

bool DeskActs::push(tasks::OperatorAct act, rt::Time now) {
  act.seq = act_seq_ + 1;
  act.stamp = now;
  if (!box_.graph().act(act)) return false;
  ++act_seq_;
  return true;
}

bool DeskActs::push(tasks::SceneEdit edit, rt::Time now) {
  edit.seq = edit_seq_ + 1;
  edit.stamp = now;
  if (!box_.graph().edit(edit)) return false;
  ++edit_seq_;
  // The boxes of an object and its point are one act.
  if (edit.kind != tasks::SceneEdit::Kind::kObjectBox) console_.count(&OperatorView::edits);
  return true;
}

ConsoleAnswer DeskActs::mark(const Intent& in, rt::Time now) {
  if (const std::string why = no_goal_now(console_.seen()); !why.empty()) return no(why);
  if (const std::string why = beyond_map(*console_.seen().map, in.points_W); !why.empty())
    return no("the mark lies " + why);
  tasks::OperatorAct act;
  act.kind = tasks::OperatorAct::Kind::kMark;
  act.p_W = marked_point(in.points_W);
  act.normal_W = facing(act.p_W, console_.seen().camera.X_WC);
  if (!push(act, now)) return no(kRingFull);
  show_mark({++mark_id_, in.points_W});
  note_goal(mark_id_);
  steps_.mark = true;
  undo_.add({UndoStep::Kind::kMark, {}, marks_.back(), 0});
  events_.add(now, "mark", "mark " + std::to_string(mark_id_) + " at " + at_text(act.p_W));
  return yes();
}

// A goal that came of it goes with it.
ConsoleAnswer DeskActs::unmark(std::uint64_t id, rt::Time now) {
  const auto known =
      std::find_if(marks_.begin(), marks_.end(), [id](const ShownMark& m) { return m.id == id; });
  if (known == marks_.end()) return no("no such mark is drawn");
  if (goals_.mark == id && !goal_is_the_hands() && !cancel(now).ok) return no(kRingFull);
  undo_.add({UndoStep::Kind::kUnmark, {}, *known, 0});
  marks_.erase(known);
  events_.add(now, "mark", "mark " + std::to_string(id) + " deleted");
  return yes();
}

void DeskActs::show_mark(ShownMark mark) {
  marks_.push_back(std::move(mark));
  if (marks_.size() > kMostMarks) marks_.erase(marks_.begin());
}

void DeskActs::hide_mark(std::uint64_t id) {
  std::erase_if(marks_, [id](const ShownMark& m) { return m.id == id; });
}

ConsoleAnswer DeskActs::cancel(rt::Time now) {
  if (!push(tasks::OperatorAct{}, now)) return no(kRingFull);
  goals_.mark = 0;
  return yes();
}

std::uint64_t DeskActs::hand_marks() const {
  return console_.seen().task.marks -
         std::min<std::uint64_t>(console_.seen().task.marks, goals_.asked);
}

bool DeskActs::goal_is_the_hands() const { return hand_marks() > goals_.hand_marks; }

void DeskActs::note_goal(std::uint64_t mark) {
  goals_.hand_marks = hand_marks();
  ++goals_.asked;
  goals_.mark = mark;
}

ConsoleAnswer DeskActs::go_to(const Intent& in, rt::Time now) {
  if (const std::string why = no_goal_now(console_.seen()); !why.empty()) return no(why);
  const std::string beyond = beyond_floor(*console_.seen().map, in.p_W.x(), in.p_W.y());
  if (!beyond.empty()) return no("the place lies " + beyond);
  tasks::OperatorAct act;
  act.kind = tasks::OperatorAct::Kind::kGoTo;
  act.p_W = in.p_W;
  act.turns = in.turns;
  act.yaw_rad = in.yaw_rad;
  if (!push(act, now)) return no(kRingFull);
  note_goal(0);
  undo_.add({UndoStep::Kind::kGoal, {}, {}, 0});
  events_.add(now, "go to", at_text(act.p_W));
  return yes();
}

ConsoleAnswer DeskActs::draw(const DrawnObstacle& o, rt::Time now, bool undoable) {
  const auto known = obstacles_.find(o.id);
  const std::string beyond = undoable ? beyond_map(*console_.seen().map, o) : std::string();
  if (!beyond.empty()) return no("the keep-out is " + beyond);
  if (known == obstacles_.end() && obstacles_.size() >= kMostObstacles)
    return no("32 obstacles are drawn: erase one first");
  if (!push(edit_of(o), now)) return no(kRingFull);
  if (undoable) {
    const bool fresh = known == obstacles_.end();
    undo_.add({UndoStep::Kind::kObstacles,
               {{o.id, fresh ? std::nullopt : std::optional(known->second)}},
               {},
               0});
    events_.add(now, "obstacle",
                std::to_string(o.id) + (fresh ? " drawn at " : " moved to ") + at_text(o.centre_W));
  }
  obstacles_[o.id] = o;
  steps_.obstacle = true;
  return undoable ? drawn(o) : yes();
}

// The base stands where it is drawn: it does not set off to a goal from there.
ConsoleAnswer DeskActs::drawn(const DrawnObstacle& o) const {
  const auto base_W = base_in_world(console_.seen());
  const double radius_m = box_.graph().config().planning.robot_radius_m;
  if (!base_W || reaches_into({{o.id, o}}, base_W->x, base_W->y, radius_m) == 0) return yes();
  return {true,
          {},
          json_text("Keep-out " + std::to_string(o.id) + " is placed, and the base stands in it.")};
}

ConsoleAnswer DeskActs::erase(std::uint16_t id, rt::Time now, bool undoable) {
  const auto known = obstacles_.find(id);
  if (id != 0 && known == obstacles_.end()) return no("no such obstacle is drawn");
  tasks::SceneEdit e;
  e.kind = tasks::SceneEdit::Kind::kErase;
  e.id = id;
  if (!push(e, now)) return no(kRingFull);
  UndoStep step{UndoStep::Kind::kObstacles, {}, {}, 0};
  for (const auto& [each, o] : obstacles_)
    if (id == 0 || each == id) step.before.emplace_back(each, o);
  if (undoable && !step.before.empty()) undo_.add(std::move(step));
  if (id == 0)
    obstacles_.clear();
  else
    obstacles_.erase(known);
  if (undoable)
    events_.add(now, "obstacle", id == 0 ? "all erased" : std::to_string(id) + " erased");
  return yes();
}

ConsoleAnswer DeskActs::forget(const Intent& in, rt::Time now) {
  const Eigen::AlignedBox3d box_W(in.p_W - in.half_m, in.p_W + in.half_m);
  if (!tasks::FusionTask::clearable(box_W))
    return no("the region is too large to be forgotten at once");
  tasks::SceneEdit e;
  e.kind = tasks::SceneEdit::Kind::kClear;
  for (int i = 0; i < 3; ++i) {
    e.centre_W[static_cast<std::size_t>(i)] = in.p_W(i);
    e.half_m[static_cast<std::size_t>(i)] = in.half_m(i);
  }
  if (!push(e, now)) return no(kRingFull);
  undo_.add({UndoStep::Kind::kForget, {}, {}, 0});
  events_.add(now, "forget", "region about " + at_text(in.p_W) + " forgotten");
  return yes();
}

void DeskActs::keep_objects(rt::Time now, const Answer& answer) {
  for (const std::string& line : objects_.take_missed()) events_.add(now, "object", line);
  const auto named = objects_.keep(console_.seen(), now, answer);
  if (!named) return;
  undo_.add({UndoStep::Kind::kObject, {}, {}, named->serial});
  events_.add(now, "object", named->name + " accepted");
}

// ---- saved sessions -----------------------------------------------------------------------------

SavedSession DeskActs::to_save() const {
  SavedSession s;
  for (const auto& [id, o] : obstacles_) s.obstacles.push_back(o);
  for (const ShownMark& m : marks_) s.marks_W.push_back(m.points_W);
  s.objects = objects_.to_save(console_.seen());
  for (const SavedObject& o : sessions_.objects_left()) s.objects.push_back(o);
  if (s.objects.size() > SavedSession::kMostObjects) s.objects.resize(SavedSession::kMostObjects);
  return s;
}

void DeskActs::keep_sessions(rt::Time now, const Answer& answer) {
  SessionHands hands;
  hands.why_not = [this] {
    // Wanted still, it may come back by itself when a fault is over.
    const bool may = console_.seen().mode.mode != Mode::kEngaged && !engage_wanted_;
    return may ? std::string() : std::string("hold first: keep-outs change while a session opens");
  };
  // What was undoable is no more: it belonged to a scene that is gone.
  hands.erase_all = [this, now] {
    if (!erase(0, now, false).ok) return false;
    undo_.clear();
    objects_.forget_unseen();
    return true;
  };
  hands.draw = [this, now](const DrawnObstacle& o) {
    give_from_ = now + kRing;
    return draw(o, now, false).ok;
  };
  hands.marks = [this](std::vector<std::vector<Vec3>> marks_W) {
    marks_.clear();
    for (auto& points_W : marks_W) marks_.push_back({++mark_id_, std::move(points_W)});
  };
  hands.give = [this, now](const SavedObject& object) {
    if (now < give_from_) return false;
    const auto given = objects_.give(object, console_.seen(), now);
    if (given == DeskObjects::Given::kNoRoom) give_from_ = now + kRing;
    return given == DeskObjects::Given::kDone;
  };
  hands.tell = [this, now](const std::string& text) { events_.add(now, "session", text); };
  sessions_.keep(hands, answer);
}

}  // namespace teletact
