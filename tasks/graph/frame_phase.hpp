// Where in the camera's period fusion is released.
//
// Both boxes count their releases from one epoch, so the frame that capture takes at its release
// reaches fusion's cell at a phase that hardly changes from frame to frame. The cell keeps the
// newest frame only. With fusion released in the midst of the arrivals, a frame that is a little
// late is seen one release later, and there the next one, on time, has overwritten it. So fusion is
// released when the frame of this period has typically arrived, and the next one can not be there
// yet:
//
//   capture's release                          fusion's release
//   |--- response --- line --- delay ---|earliest  latest|--- margin --|
//
// Clocks that drift apart move the arrivals by their difference: 50 ppm are 3 ms a minute.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/link/shaper.hpp"
#include "rt/sched/admission.hpp"
#include "rt/time.hpp"
#include "tasks/graph/calibration.hpp"

namespace tasks {

// What happens to a frame before it is in fusion's cell, counted from capture's release.
struct FrameWay {
  rt::Nanos capture_typical{0}, capture_bound{0};  // to the end of capture's job
  std::uint64_t bytes_min = 0, bytes_max = 0;      // of a coded frame
  drivers::LinkShapeConfig shape;                  // all zero: loopback
};

struct FrameArrival {
  rt::Nanos earliest{0}, latest{0};
};
[[nodiscard]] FrameArrival frame_arrival(const FrameWay& way) noexcept;

// Within [0, period). The margin is half of what the arrivals leave free of the period, and at most
// kFrameMargin: waiting longer only makes the map older.
inline constexpr rt::Nanos kFrameMargin = std::chrono::milliseconds{6};
[[nodiscard]] rt::Nanos fusion_offset(const FrameArrival& arrival, rt::Nanos period) noexcept;

// Where in the period capture is first released, of a box with a camera of its own that counts from
// the box's epoch: when a frame has been whole for kWhole. On the epoch's grid itself it would find
// the frame of the period before, and a picture would be a period less its exposure older.
inline constexpr rt::Nanos kWhole =
    std::chrono::milliseconds{4};  // the twin may be late by as much
[[nodiscard]] rt::Nanos capture_offset(rt::Nanos exposure, rt::Nanos period) noexcept;

// Sets the offset of fusion in `specs` (by task id): capture's response and the sizes of its frames
// from admission and calibration, the line from the scene. Once, before the start; the same on
// every machine for the same admission, calibration and scene.
void set_fusion_phase(std::vector<rt::TaskSpec>& specs, const rt::Admission& admission,
                      const Calibration& calibration, const drivers::LinkShapeConfig& shape);

}  // namespace tasks
