// Of the desk: what is taken back.
#include "tools/desk/intents/desk_undo.hpp"

#include <nlohmann/json.hpp>

#include "tools/desk/desk_acts.hpp"

namespace teletact {

ConsoleAnswer DeskActs::undo(rt::Time now) {
  if (undo_.empty()) return {false, "there is nothing to undo", {}};
  if (undo_.newest().kind == UndoStep::Kind::kForget) {
    undo_.drop_newest();
    return {false,
            "what is forgotten does not come back; undo again takes back what was done before it",
            {}};
  }
  const std::string text = text_of(undo_.newest());
  ConsoleAnswer answer = take_back(undo_.newest(), now);
  if (!answer.ok) return answer;
  undo_.drop_newest();
  events_.add(now, "undo", text);
  answer.result = nlohmann::json{{"text", "Undone: " + text + "."}}.dump();
  return answer;
}

ConsoleAnswer DeskActs::take_back(UndoStep& step, rt::Time now) {
  ConsoleAnswer answer{true, {}, {}};
  switch (step.kind) {
    case UndoStep::Kind::kObstacles:
      return put_back_obstacles(step, now);
    case UndoStep::Kind::kGoal:
      if (!goal_is_the_hands()) answer = cancel(now);
      return answer;
    case UndoStep::Kind::kMark:
      if (!goal_is_the_hands()) answer = cancel(now);
      if (answer.ok) hide_mark(step.mark.id);
      return answer;
    case UndoStep::Kind::kUnmark:
      show_mark(step.mark);
      return answer;
    case UndoStep::Kind::kObject:
      if (!objects_.drop(step.serial, now)) answer = {false, kRingFull, {}};
      return answer;
    case UndoStep::Kind::kForget:
      break;
  }
  return answer;
}

// As many as the tasks take now; what is left stays to be undone.
ConsoleAnswer DeskActs::put_back_obstacles(UndoStep& step, rt::Time now) {
  while (!step.before.empty()) {
    const auto& [id, before] = step.before.back();
    ConsoleAnswer answer = before ? draw(*before, now, false) : erase(id, now, false);
    if (!answer.ok) return answer;
    step.before.pop_back();
  }
  return {true, {}, {}};
}

std::string DeskActs::text_of(const UndoStep& step) const {
  switch (step.kind) {
    case UndoStep::Kind::kGoal:
      return goal_is_the_hands() ? "the goal has long given way to the hand's mark, which stays"
                                 : "the goal is dropped";
    case UndoStep::Kind::kMark:
      return "mark " + std::to_string(step.mark.id) +
             (goal_is_the_hands() ? " is gone; the goal of the hand's mark stays"
                                  : " and its goal are gone");
    case UndoStep::Kind::kUnmark:
      return "mark " + std::to_string(step.mark.id) + " is drawn again";
    case UndoStep::Kind::kObject:
      return objects_.name_of(step.serial) + " is no object any more";
    case UndoStep::Kind::kObstacles:
    case UndoStep::Kind::kForget:
      break;
  }
  if (step.before.size() != 1) return std::to_string(step.before.size()) + " keep-outs are back";
  const auto& [id, before] = step.before.front();
  return "keep-out " + std::to_string(id) + (before ? " is as it was" : " is gone");
}

}  // namespace teletact
