// What the haptic task of `teletact touch` is given at a tick beside the hand.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "rt/time.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/touch/touch_input.hpp"
#include "tools/touch/view_cast.hpp"

namespace teletact::touch {

// Publishes windows as fusion does: every 1/30 s, and at once when another field becomes visible.
// The newest one waits until the task takes it, so a window that the task still blends is never
// overwritten, however fast the fields change.
class WindowSource {
 public:
  // `fields` and `o` must outlive it.
  WindowSource(const FieldList& fields, const Options& o, const perception::Vec3& origin);
  // The newest window at time t for a task that takes one (`wanted`); null: none.
  const perception::SurfacePatch* at(double t, rt::Time now, const perception::Vec3& hand,
                                     const perception::Vec3& velocity, bool wanted);
  // Fields that were visible so far.
  [[nodiscard]] std::size_t visible() const { return visible_; }
  // Throws std::runtime_error if no field was known anywhere on the hand's path, since its zero
  // forces would mean nothing.
  void check_met(const std::vector<HandRow>& hand, bool touched) const;

 private:
  [[nodiscard]] bool known_round(const perception::Vec3& p) const;
  const FieldList& fields_;
  const Options& options_;
  const perception::Vec3 origin_;
  // The task holds two at most, and one is filled only when it holds a single one.
  std::array<std::unique_ptr<perception::SurfacePatch>, 3> slots_;
  std::size_t visible_ = 0, current_ = 0;
  std::uint64_t seq_ = 0;
  double next_ = 0;
  bool met_ = false;
  perception::Vec3 low_ = perception::Vec3::Constant(1e9), high_ = -low_;  // of the hand
  rt::Time fused_{};                                                       // of the newest
  perception::Vec3 centre_ = perception::Vec3::Zero();
};

// The points that force_shading reduces over: one full ray cast of each field, when it becomes
// visible.
class SurfaceSource {
 public:
  // `fields` and `o` must outlive it. Throws std::runtime_error: --view.
  SurfaceSource(const FieldList& fields, const Options& o, const perception::Vec3& origin,
                const std::vector<HandRow>& hand);
  // Null: as before.
  const tasks::SurfacePoints* at(std::size_t visible);
  // Throws std::runtime_error: --view was given, and nothing was ever seen from there.
  void check_seen() const;

 private:
  const FieldList& fields_;
  const Options& options_;
  bool wanted_ = false, seen_ = false;
  View view_;
  std::array<tasks::SurfacePoints, 2> points_;
  std::size_t cast_ = 0, current_ = 0;
};

}  // namespace teletact::touch
