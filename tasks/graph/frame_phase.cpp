#include "tasks/graph/frame_phase.hpp"

#include <algorithm>

namespace tasks {

namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
// Of either end's link thread: its loop waits up to a millisecond for something to do.
constexpr rt::Nanos kPoll = milliseconds{1};
// Reading, checking and decoding a frame by the link's thread: p50 and p99 of an ordinary thread
// beside the tasks (docs/timing.md).
constexpr rt::Nanos kDecodeTypical = milliseconds{2}, kDecodeLate = milliseconds{6};

rt::Nanos on_the_line(std::uint64_t bytes, double rate_Mbit_per_s) noexcept {
  if (rate_Mbit_per_s <= 0) return rt::Nanos{0};
  return rt::Nanos{static_cast<std::int64_t>(static_cast<double>(bytes) * 8e3 / rate_Mbit_per_s)};
}

}  // namespace

FrameArrival frame_arrival(const FrameWay& way) noexcept {
  const auto& s = way.shape;
  const rt::Nanos delay{static_cast<std::int64_t>(s.delay_ms * 1e6)};
  const rt::Nanos jitter{static_cast<std::int64_t>(s.jitter_ms * 1e6)};
  FrameArrival a;
  a.earliest =
      way.capture_typical + on_the_line(way.bytes_min, s.rate_Mbit_per_s) + delay + kDecodeTypical;
  a.latest = way.capture_bound + kPoll + on_the_line(way.bytes_max, s.rate_Mbit_per_s) + delay +
             jitter + kPoll + kDecodeLate;
  a.latest = std::max(a.latest, a.earliest);
  return a;
}

rt::Nanos fusion_offset(const FrameArrival& arrival, rt::Nanos period) noexcept {
  const rt::Nanos spread = arrival.latest - arrival.earliest;
  // Arrivals all round the period: no phase is free of them, so as far as can be from the early
  // ones.
  const rt::Nanos free = std::max(period - spread, rt::Nanos{0});
  const rt::Nanos at =
      arrival.earliest + std::min(spread, period) + std::min(free / 2, kFrameMargin);
  return at % period;
}

rt::Nanos capture_offset(rt::Nanos exposure, rt::Nanos period) noexcept {
  return (exposure + kWhole) % period;
}

void set_fusion_phase(std::vector<rt::TaskSpec>& specs, const rt::Admission& admission,
                      const Calibration& calibration, const drivers::LinkShapeConfig& shape) {
  const auto& capture = admission.tasks[index_of(TaskId::kCapture)];
  FrameWay way;
  way.shape = shape;
  way.capture_bound = capture.R;
  // On one core with fusion the analysis lets a whole job of fusion fall on capture. At the phase
  // chosen here it lies elsewhere in the period; only one of the longest still reaches capture's
  // release.
  const auto& above = admission.tasks[index_of(TaskId::kFusion)];
  if (above.core >= 0 && above.core == capture.core && above.priority > capture.priority)
    way.capture_bound = std::max(capture.C, capture.R - above.C);
  // Not measured on this host: what the room's camera gives.
  way.bytes_min = 60000;
  way.bytes_max = 160000;
  for (const auto& row : calibration.rows) {
    if (row.name != capture.name || row.level != capture.level) continue;
    way.capture_typical = rt::Nanos{static_cast<std::int64_t>(row.p50_us * 1e3)};
    way.bytes_min = static_cast<std::uint64_t>(row.work_min);
    way.bytes_max = static_cast<std::uint64_t>(row.work_max);
  }
  auto& fusion = specs[index_of(TaskId::kFusion)];
  fusion.offset = fusion_offset(frame_arrival(way), fusion.period());
}

}  // namespace tasks
