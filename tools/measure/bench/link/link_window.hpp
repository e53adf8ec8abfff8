// What a part of a run over the link was like, from what the operator's box saw arrive. Pure.
//
// Ages are true ones: both boxes run on one machine here and stamp with its one clock, so what the
// link believes of the clocks plays no part.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tasks/graph/samples.hpp"
#include "tools/host/console.hpp"

namespace teletact {

struct LinkWindow {
  double seconds = 0;
  std::uint64_t pictures = 0, states = 0;
  double fps = 0;                           // distinct pictures that were decoded, a second
  double age_p50_ms = 0, age_p95_ms = 0;    // of a picture at its arrival; NaN: none arrived
  double age_max_ms = 0, state_p95_ms = 0;  // likewise
  double mbit_s = 0;                        // of pictures
  double spared_share = 0;                  // of them with anything lowered
  double key_share = 0;
};

struct Span_ns {
  std::int64_t from = 0, to = 0;
};

[[nodiscard]] inline std::int64_t later(std::int64_t from_ns, double s) {
  return from_ns + static_cast<std::int64_t>(s * 1e9);
}
// After the first picture, or a change of the road, everything has settled so long later.
inline constexpr double kSettled_s = 3;
// From then to a moment before the last picture.
[[nodiscard]] Span_ns settled(std::span<const tasks::LinkSample> samples);

// Arrivals in all of `spans`, taken together.
[[nodiscard]] LinkWindow link_window(std::span<const tasks::LinkSample> samples,
                                     std::span<const Span_ns> spans);

// Of the pictures that arrived in `span`, the most by which one is older than the stall, the path
// and its own transmission; below 0: none is. NaN: none arrived.
[[nodiscard]] double over_stall_ms(std::span<const tasks::LinkSample> samples, Span_ns span,
                                   double stall_ms, double path_ms, double rate_Mbit_per_s);

// When the base moved, by the twin's truth: stretches of at least `least_s` in which it was never
// slower than `speed_m_per_s` (of the lens, turning included) for longer than .2 s.
[[nodiscard]] std::vector<Span_ns> moving_spans(const std::vector<TruthSample>& truth,
                                                double speed_m_per_s, double least_s);

// After instants at which the road fell silent: how long the base moved on (above 0.01 m/s), the
// longest, looking no further than `until_ms` behind each. `driving` counts those at which it did.
struct Silence {
  double stands_ms = 0;
  int driving = 0;
};
[[nodiscard]] Silence after_silences(const std::vector<tasks::RobotSample>& robot,
                                     std::span<const std::int64_t> silences_ns, double until_ms);

// The same after the last new goal before each gap of more than `least_ms` in them, as the robot's
// box counts them; looked at until the next one.
[[nodiscard]] Silence after_gaps(std::span<const tasks::RobotSample> robot, double least_ms);

// An image that the map took in, its arrival, and the first tick of the hand in contact whose force
// knows it. `link`: by time. Images whose arrival is not among them are left out.
struct Felt {
  const tasks::FusionSample* image = nullptr;
  const tasks::LinkSample* picture = nullptr;
  const tasks::HapticSample* tick = nullptr;
};
[[nodiscard]] std::vector<Felt> felt_images(std::span<const tasks::HapticSample> haptic,
                                            std::span<const tasks::FusionSample> fusion,
                                            std::span<const tasks::LinkSample> link);

// From the exposure of an image to the first tick of the hand in contact whose force knows it, ms,
// one for each image that the map took in. Both boxes must read one clock: the exposure is the
// robot's own stamp of it. The link's measure of the other clock errs by some milliseconds, from
// exchange to exchange by others, and would be taken for time that passed.
[[nodiscard]] std::vector<double> felt_after_ms(std::span<const tasks::HapticSample> haptic,
                                                std::span<const tasks::FusionSample> fusion,
                                                std::span<const tasks::LinkSample> link);

}  // namespace teletact
