// The files that `teletact touch` reads: fields, labels and what they mean, the hand's path.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "tools/touch/field_window.hpp"
#include "tools/touch/touch_options.hpp"

namespace teletact::touch {

// The task takes a device's position beyond it for none at all.
inline constexpr double kDeviceReach_m = 10.0;

struct HandRow {
  double t = 0;
  perception::Vec3 p = perception::Vec3::Zero();
  bool clutch = false;
};

using Palette = std::array<perception::Material, perception::SurfacePatch::kMaxMaterials>;

// The fields and from when each of them is visible; their labels and what these mean.
struct FieldList {
  std::vector<double> from;
  std::vector<DenseField> fields;
  Palette palette{};

  // Those that are visible at t, of which the last one counts.
  [[nodiscard]] std::size_t visible(double t, std::size_t at_least) const {
    while (at_least < from.size() && t >= from[at_least] - 1e-9) ++at_least;
    return at_least;
  }
};

// Throw std::runtime_error naming file, row and what is wrong.
[[nodiscard]] FieldList load_fields(const Options& o);
// The hand at every tick: the rows themselves, or the rows interpolated to another rate. `base`:
// where the device's base lies, at the world's origin, or at the first row if the path leaves the
// reach from there.
struct HandPath {
  std::vector<HandRow> rows;
  double period_s = 1e-3;
  perception::Vec3 base = perception::Vec3::Zero();
};
[[nodiscard]] HandPath load_hand(const Options& o);

}  // namespace teletact::touch
