#include "tasks/fusion/given_boxes.hpp"

#include <cmath>

#include "tasks/fusion/drawn_obstacles.hpp"

namespace tasks {

using perception::GivenObject;
using perception::Vec3;

bool GivenBoxes::apply(const SceneEdit& e) noexcept {
  whole_ = false;
  const bool good = e.kind == SceneEdit::Kind::kObjectBox     ? add(e)
                    : e.kind == SceneEdit::Kind::kObjectPoint ? end(e)
                                                              : false;
  if (!good) object_.count = 0;
  return good;
}

bool GivenBoxes::add(const SceneEdit& e) noexcept {
  constexpr double kFarthest_m = 1000, kLongest_m = 5;
  if (e.id == 1) object_.count = 0;
  if (e.id != object_.count + 1 || object_.count == GivenObject::kMost) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(std::abs(e.centre_W[i]) <= kFarthest_m)) return false;  // also what is no number
    if (!(e.half_m[i] > 0 && e.half_m[i] <= kLongest_m)) return false;
  }
  object_.boxes_W[static_cast<std::size_t>(object_.count++)] = box_of(e);
  return true;
}

bool GivenBoxes::end(const SceneEdit& e) noexcept {
  if (object_.count == 0 || e.id != object_.count) return false;
  object_.p_W = Vec3(e.centre_W[0], e.centre_W[1], e.centre_W[2]);
  whole_ = object_.contains(object_.p_W);  // not of what is no number
  return whole_;
}

}  // namespace tasks
