// Of the desk: marks, goals, obstacles, regions, accepted objects, undo; all of them saved, opened.
#include <algorithm>
#include <cstdio>
#include <limits>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/desk/desk_acts.hpp"

namespace teletact {

using perception::Vec3;
using tasks::Mode;

namespace {

ConsoleAnswer yes() { return {true, {}, {}}; }
ConsoleAnswer no(std::string why) { return {false, std::move(why), {}}; }
constexpr const char* kRingFull = "too many acts wait for the tasks: ask again";
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

void DeskActs::remember(Undo step) {
  undo_.push_back(std::move(step));
  if (undo_.size() > kMostUndo) undo_.erase(undo_.begin());
}

ConsoleAnswer DeskActs::mark(const Intent& in, rt::Time now) {
  if (const std::string why = no_goal_now(console_.seen()); !why.empty()) return no(why);
  tasks::OperatorAct act;
  act.kind = tasks::OperatorAct::Kind::kMark;
  act.p_W = marked_point(in.points_W);
  act.normal_W = facing(act.p_W, console_.seen().camera.X_WC);
  if (!push(act, now)) return no(kRingFull);
  marks_.push_back({++mark_id_, in.points_W});
  if (marks_.size() > kMostMarks) marks_.erase(marks_.begin());
  remember({Undo::Kind::kGoal, 0, std::nullopt});
  events_.add(now, "mark", "mark at " + at_text(act.p_W));
  return yes();
}

ConsoleAnswer DeskActs::go_to(const Intent& in, rt::Time now) {
  if (const std::string why = no_goal_now(console_.seen()); !why.empty()) return no(why);
  tasks::OperatorAct act;
  act.kind = tasks::OperatorAct::Kind::kGoTo;
  act.p_W = in.p_W;
  act.turns = in.turns;
  act.yaw_rad = in.yaw_rad;
  if (!push(act, now)) return no(kRingFull);
  remember({Undo::Kind::kGoal, 0, std::nullopt});
  events_.add(now, "go to", at_text(act.p_W));
  return yes();
}

ConsoleAnswer DeskActs::draw(const DrawnObstacle& o, rt::Time now, bool undoable) {
  const auto known = obstacles_.find(o.id);
  if (known == obstacles_.end() && obstacles_.size() >= kMostObstacles)
    return no("32 obstacles are drawn: erase one first");
  if (!push(edit_of(o), now)) return no(kRingFull);
  if (undoable) {
    remember({Undo::Kind::kObstacle, o.id,
              known == obstacles_.end() ? std::nullopt : std::optional(known->second)});
    events_.add(now, "obstacle",
                std::to_string(o.id) + (known == obstacles_.end() ? " drawn at " : " moved to ") +
                    at_text(o.centre_W));
  }
  obstacles_[o.id] = o;
  steps_.obstacle = true;
  return yes();
}

ConsoleAnswer DeskActs::erase(std::uint16_t id, rt::Time now, bool undoable) {
  const auto known = obstacles_.find(id);
  if (id != 0 && known == obstacles_.end()) return no("no such obstacle is drawn");
  tasks::SceneEdit e;
  e.kind = tasks::SceneEdit::Kind::kErase;
  e.id = id;
  if (!push(e, now)) return no(kRingFull);
  for (const auto& [each, o] : obstacles_) {
    if (undoable && (id == 0 || each == id)) remember({Undo::Kind::kObstacle, each, o});
  }
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
  events_.add(now, "forget", "region about " + at_text(in.p_W) + " forgotten");
  return yes();
}

// What is forgotten of the map does not come back; all else does.
ConsoleAnswer DeskActs::undo(rt::Time now) {
  if (undo_.empty()) return no("there is nothing to undo");
  const Undo step = undo_.back();
  ConsoleAnswer answer = take_back(step, now);
  if (!answer.ok) return answer;
  undo_.pop_back();
  events_.add(now, "undo", text_of(step));
  return answer;
}

ConsoleAnswer DeskActs::take_back(const Undo& step, rt::Time now) {
  switch (step.kind) {
    case Undo::Kind::kGoal:
      return push(tasks::OperatorAct{}, now) ? yes() : no(kRingFull);
    case Undo::Kind::kObject:
      return objects_.drop(step.serial, now) ? yes() : no(kRingFull);
    case Undo::Kind::kObstacle:
      break;
  }
  return step.before ? draw(*step.before, now, false) : erase(step.id, now, false);
}

std::string DeskActs::text_of(const Undo& step) const {
  switch (step.kind) {
    case Undo::Kind::kGoal:
      return "goal dropped";
    case Undo::Kind::kObject:
      return objects_.name_of(step.serial) + " is no object any more";
    case Undo::Kind::kObstacle:
      break;
  }
  return "obstacle " + std::to_string(step.id);
}

void DeskActs::keep_objects(rt::Time now, const Answer& answer) {
  for (const std::string& line : objects_.take_missed()) events_.add(now, "object", line);
  const auto named = objects_.keep(console_.seen(), now, answer);
  if (!named) return;
  remember({Undo::Kind::kObject, 0, std::nullopt, named->serial});
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
