// Case 20: a hand that leads the device (body.hpp) along a way and holds it there. Frame S of a
// solid, SI.
#pragma once

#include <optional>
#include <vector>

#include "tools/measure/stability/body.hpp"
#include "tools/measure/stability/cases.hpp"

namespace stability {

inline constexpr Grip kGrips[3] = {{0.1, 1, 100}, {0.3, 5, 400}, {1.0, 10, 1000}};

struct Held {
  std::vector<rig::Row> rows;
  double residual = 0, controller = 0, energy = 0;
  std::optional<Twin> then;  // the device and the hand as they were at `then_s` of along()
};
// The hand's goal moves along the path, then rests. The device must be at rest this long after the
// last event.
inline constexpr double kRest_s = 2,
                        kRestAtLimit_s = 7;  // damped well; where the loop only just damps
[[nodiscard]] Held along(rig::Rig& r, const Body& body, const Grip& grip, const rig::Path& path,
                         double event_s, double rest_s, double then_s = 0);

// `paid`: share of the credit.
[[nodiscard]] double least_energy(const std::vector<rig::Row>& rows, double paid = 1);

// The surface steps 5 mm up under a hand that holds on, so deep in it.
[[nodiscard]] Run stepped(const Setting& s, const Grip& grip, double depth_m);

}  // namespace stability
