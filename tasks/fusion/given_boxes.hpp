// The boxes of an object that the operator gives, one edit after the other.
#pragma once

#include "perception/objects/given_object.hpp"
#include "tasks/contract/scene_edit.hpp"

namespace tasks {

class GivenBoxes {
 public:
  // A box or the point that ends them. False, and all boxes are forgotten: out of order, too many,
  // numbers that are none, a point that is in no box, or an edit of another kind.
  [[nodiscard]] bool apply(const SceneEdit& edit) noexcept;
  // Was the newest edit such a point? Then all of the object; else null.
  [[nodiscard]] const perception::GivenObject* whole() const noexcept {
    return whole_ ? &object_ : nullptr;
  }

 private:
  [[nodiscard]] bool add(const SceneEdit& edit) noexcept;
  [[nodiscard]] bool end(const SceneEdit& edit) noexcept;
  perception::GivenObject object_;
  bool whole_ = false;
};

}  // namespace tasks
