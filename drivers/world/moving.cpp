// What of a World depends on the instant.
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "drivers/world/world.hpp"
#include "rt/effect_count.hpp"

namespace drivers {

using perception::Pose;

void World::add(const MoverConfig& c) {
  const auto refuse = [&c](const std::string& what) {
    throw std::runtime_error("world: mover '" + c.name + "': " + what);
  };
  int carrier = -1;
  for (std::size_t i = 0; i < movers_.size(); ++i) {
    if (movers_[i].mover.name() == c.name) refuse("the name is used twice");
    if (!c.on.empty() && movers_[i].mover.name() == c.on) carrier = static_cast<int>(i);
  }
  if (c.name.empty()) refuse("it has no name");
  if (!c.on.empty() && carrier < 0) refuse("on = '" + c.on + "' is no mover before it");
  movers_.push_back({Mover(c), carrier});
  rt::effect_built(rt::Effect::kMovers);
  const int self = static_cast<int>(movers_.size()) - 1;
  bool tilts = false;
  for (int m = self; m >= 0; m = movers_[static_cast<std::size_t>(m)].carrier) {
    const Mover& mover = movers_[static_cast<std::size_t>(m)].mover;
    tilts |= mover.turns() && std::abs(mover.axis_W().z()) < 1 - 1e-12;
  }
  std::istringstream names(c.shapes);
  std::string name;
  bool any = false;
  while (std::getline(names, name, ',')) {
    const auto first = name.find_first_not_of(' ');
    if (first == std::string::npos) continue;
    name = name.substr(first, name.find_last_not_of(' ') - first + 1);
    const int at = find(name);
    if (at < 0) refuse("there is no shape '" + name + "'");
    Shape& s = shapes_[static_cast<std::size_t>(at)];
    if (s.kind == Shape::Kind::kPlane) refuse("'" + name + "' is a plane, which does not move");
    if (s.kind == Shape::Kind::kCylinder && tilts) refuse("cylinder '" + name + "' would tilt");
    if (s.mover >= 0) refuse("'" + name + "' has a mover already");
    s.mover = self;
    any = true;
  }
  if (!any) refuse("shapes names none");
}

const Pose& World::pose(const Shape& s, rt::Time t, Pose& moved) const noexcept {
  if (s.mover < 0) return s.X_WS;
  rt::effect_ran(rt::Effect::kMovers);
  const double t_s = t > t0_ ? rt::seconds(t - t0_) : 0.0;
  moved = s.X_WS;
  for (int m = s.mover; m >= 0; m = movers_[static_cast<std::size_t>(m)].carrier) {
    moved = movers_[static_cast<std::size_t>(m)].mover.moved(t_s) * moved;
  }
  return moved;
}

Pose World::X_WS_at(int shape, rt::Time t) const noexcept {
  Pose moved;
  return pose(shapes_[static_cast<std::size_t>(shape)], t, moved);
}

}  // namespace drivers
