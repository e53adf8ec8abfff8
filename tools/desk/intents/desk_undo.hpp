// What can be taken back, newest last. Each act is one step, however many keep-outs it changed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/desk/intents/intent.hpp"

namespace teletact {

struct ShownMark {
  std::uint64_t id = 0;
  std::vector<perception::Vec3> points_W;
};

struct UndoStep {
  enum class Kind : std::uint8_t {
    kObstacles,  // `before`
    kGoal,       // dropped
    kMark,       // `mark` is none any more, and its goal is dropped
    kUnmark,     // `mark` is drawn again; no goal is set
    kObject,     // `serial`
    kForget,     // does not come back: this is said once, and what was done before it is next
  };
  Kind kind = Kind::kGoal;
  std::vector<std::pair<std::uint16_t, std::optional<DrawnObstacle>>> before;  // none: erased
  ShownMark mark;
  std::uint32_t serial = 0;  // of an object
};

class DeskUndo {
 public:
  static constexpr std::size_t kMost = 64;
  void add(UndoStep step) {
    steps_.push_back(std::move(step));
    if (steps_.size() > kMost) steps_.erase(steps_.begin());
  }
  [[nodiscard]] bool empty() const noexcept { return steps_.empty(); }
  [[nodiscard]] UndoStep& newest() noexcept { return steps_.back(); }
  void drop_newest() { steps_.pop_back(); }
  void clear() noexcept { steps_.clear(); }

 private:
  std::vector<UndoStep> steps_;
};

}  // namespace teletact
