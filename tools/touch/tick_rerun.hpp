// Runs the task again on a recorded haptic run: unchanged (then every byte of the outputs must
// equal the recorded one), or by another method or with other keys, on the same hand and the same
// windows.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>

#include "rt/memory/non_realtime.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/touch/tick_file.hpp"

namespace teletact {

class HapticRerun {
 public:
  // Makes the ray cast of a window for method force_shading where the run holds none; false: none.
  using Caster = std::function<bool(const perception::SurfacePatch&, tasks::SurfacePoints&)>;

  // `reader` has read the header. The device's stiffness limit is not applied, since nothing is
  // rendered. Throws std::runtime_error as HapticTask does.
  HapticRerun(rt::NonRealtime&, HapticRunReader& reader, const tasks::HapticConfig& config,
              Caster caster = nullptr);

  // The next tick; false at the end of the run. Throws std::runtime_error on a damaged file.
  bool next();
  [[nodiscard]] const HapticRunTick& recorded() const { return tick_; }
  [[nodiscard]] const tasks::HapticTask::Out& out() const { return out_; }
  [[nodiscard]] const tasks::HapticTask& task() const { return task_; }
  // The window that counts now; null before the first.
  [[nodiscard]] const perception::SurfacePatch* window() const { return newest_; }
  // Thread CPU of the last step, the two clock readings included.
  [[nodiscard]] double cpu_us() const { return cpu_us_; }
  // The last answer is the recorded one, byte by byte.
  [[nodiscard]] bool equal() const;

 private:
  // The task holds two windows; a slow blend lasts four periods.
  static constexpr std::size_t kWindows = 8, kSurfaces = 3;
  HapticRunReader& reader_;
  Caster caster_;
  bool casting_ = false;
  tasks::HapticTask task_;
  std::array<std::unique_ptr<perception::SurfacePatch>, kWindows> windows_;
  std::array<tasks::SurfacePoints, kSurfaces> surfaces_;
  std::size_t window_at_ = 0, surface_at_ = 0;
  const perception::SurfacePatch* newest_ = nullptr;
  const tasks::SurfacePoints* fresh_surface_ = nullptr;
  tasks::HapticTask::In in_;
  tasks::HapticTask::Out out_;
  HapticRunTick tick_;
  double cpu_us_ = 0;
};

// Where a run first touches: proxy and direction of the force. False: it never does.
[[nodiscard]] bool first_touch(HapticRunReader& reader, perception::Vec3& p_W,
                               perception::Vec3& normal_W);

}  // namespace teletact
