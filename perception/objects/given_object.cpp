#include "perception/objects/given_object.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

// Guessed, and judged on the default room's bin alone.
constexpr std::size_t kLeastReadings = 48;
constexpr double kFewOthers = 0.02;   // of a box's readings: it is not cut for so few others
constexpr double kTrim = 0.005;       // of the mask's readings, on either side along each axis
constexpr double kWider_m = 0.02;     // than the readings: their noise and that of poses
constexpr double kMostOthers = 0.01;  // of a box's readings, that widening may take in
constexpr int kMostSamples = 20000;   // of the mask

using Points = std::vector<Vec3>;
using Box = Eigen::AlignedBox3d;

struct Part {
  Points own;  // readings of the mask
  Box box;     // tight about them
  int others = 0;
};

int inside(const Box& box, const Points& points) {
  return static_cast<int>(
      std::count_if(points.begin(), points.end(), [&](const Vec3& p) { return box.contains(p); }));
}

Part part_of(Points own, const Points& others) {
  Part part;
  for (const Vec3& p : own) part.box.extend(p);
  part.own = std::move(own);
  part.others = inside(part.box, others);
  return part;
}

// The value below which this share of them lies along an axis. Not the rank of rt/quantile.hpp,
// which is one higher for some counts: that would change the map.
double quantile(Points& points, int axis, double share) {
  const auto last = static_cast<double>(points.size() - 1);
  const auto at = points.begin() + static_cast<std::ptrdiff_t>(share * last);
  std::nth_element(points.begin(), at, points.end(),
                   [axis](const Vec3& a, const Vec3& b) { return a(axis) < b(axis); });
  return (*at)(axis);
}

// A few readings of a mask lie on what is behind it.
void trim(Points& points) {
  Vec3 low, high;
  for (int axis = 0; axis < 3; ++axis) {
    low(axis) = quantile(points, axis, kTrim);
    high(axis) = quantile(points, axis, 1 - kTrim);
  }
  const Box keep(low, high);
  std::erase_if(points, [&](const Vec3& p) { return !keep.contains(p); });
}

// The cut that leaves the fewest others in both halves.
std::optional<std::pair<Part, Part>> cut(Part& part, const Points& others) {
  std::optional<std::pair<Part, Part>> best;
  int least = part.others;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double share : {0.25, 0.5, 0.75}) {
      const double at = quantile(part.own, axis, share);
      Points low, high;
      for (const Vec3& p : part.own) (p(axis) < at ? low : high).push_back(p);
      if (low.size() < kLeastReadings || high.size() < kLeastReadings) continue;
      Part a = part_of(std::move(low), others), b = part_of(std::move(high), others);
      if (a.others + b.others >= least) continue;
      least = a.others + b.others;
      best.emplace(std::move(a), std::move(b));
    }
  }
  return best;
}

// The box with the most others is cut, as long as that helps.
std::vector<Part> cut_up(Part whole, const Points& others) {
  std::vector<Part> parts, done;
  parts.push_back(std::move(whole));
  while (!parts.empty() && parts.size() + done.size() < GivenObject::kMost) {
    const auto worst =
        std::max_element(parts.begin(), parts.end(),
                         [](const Part& a, const Part& b) { return a.others < b.others; });
    if (worst->others <= kFewOthers * static_cast<double>(worst->own.size())) break;
    auto halves = cut(*worst, others);
    Part was = std::move(*worst);
    parts.erase(worst);
    if (halves) {
      parts.push_back(std::move(halves->first));
      parts.push_back(std::move(halves->second));
    } else {
      done.push_back(std::move(was));
    }
  }
  for (Part& p : parts) done.push_back(std::move(p));
  return done;
}

Box widened(const Part& part, const Points& others) {
  constexpr double kLeast_m = 0.001;  // so that no side is flat, and no reading lies on one
  Box box = part.box;
  box.min().array() -= kLeast_m;
  box.max().array() += kLeast_m;
  int held = part.others;
  const double most = kMostOthers * static_cast<double>(part.own.size());
  for (int side = 0; side < 6; ++side) {
    for (const double by_m : {kWider_m, kWider_m / 2}) {
      Box wider = box;
      if (side < 3)
        wider.min()(side) -= by_m;
      else
        wider.max()(side - 3) += by_m;
      const int now = inside(wider, others);
      if (now - held > most) continue;
      box = wider;
      held = now;
      break;
    }
  }
  return box;
}

struct Readings {
  Points own, others;  // in W; others only near the mask
  Vec3 nearest_W = Vec3::Zero();
};

// Readings at a depth step belong to neither side.
bool at_step(const FrameView& f, int u, int v) {
  constexpr double kBase_mm = 20, kPart = 0.02;
  const double here = f.depth_mm.at(u, v), gate = kBase_mm + kPart * here;
  const auto apart = [&](int a, int b) {
    return f.depth_mm.contains(a, b) && reads(f.depth_mm.at(a, b)) &&
           std::abs(f.depth_mm.at(a, b) - here) > gate;
  };
  return apart(u - 1, v) || apart(u + 1, v) || apart(u, v - 1) || apart(u, v + 1);
}

Readings readings_of(const FrameView& f, ImageView<const std::uint8_t> mask, const Pose& X_WC,
                     const Click& at) {
  Readings r;
  std::int64_t pixels = 0;
  for (int v = 0; v < mask.height; ++v)
    pixels += std::count_if(mask.row(v), mask.row(v) + mask.width, [](auto m) { return m != 0; });
  int step = 1;
  while (pixels / (step * step) > kMostSamples) ++step;
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  for (int v = 0; v < mask.height; v += step) {
    for (int u = 0; u < mask.width; u += step) {
      const std::uint16_t mm = f.depth_mm.at(u, v);
      if (!reads(mm) || at_step(f, u, v)) continue;
      const Vec3 p_W = X_WC * f.intrinsics.unproject(u, v, 1e-3 * mm);
      if (mask.at(u, v) == 0) {
        r.others.push_back(p_W);
        continue;
      }
      r.own.push_back(p_W);
      const std::int64_t off =
          std::int64_t{u - at.u} * (u - at.u) + std::int64_t{v - at.v} * (v - at.v);
      if (off < least) least = off, r.nearest_W = p_W;
    }
  }
  return r;
}

}  // namespace

bool GivenObject::contains(const Vec3& at_W) const noexcept {
  for (const Box& box_W : boxes())
    if (box_W.contains(at_W)) return true;
  return false;
}

Eigen::AlignedBox3d GivenObject::bounds() const noexcept {
  Box all;
  for (const Box& box_W : boxes()) all.extend(box_W);
  return all;
}

GivenObject boxes_of(const FrameView& frame, ImageView<const std::uint8_t> mask, const Pose& X_WC,
                     const Click& at) {
  GivenObject out;
  if (mask.width != frame.intrinsics.width || mask.height != frame.intrinsics.height) return out;
  Readings r = readings_of(frame, mask, X_WC, at);
  if (r.own.size() < kLeastReadings) return out;
  trim(r.own);
  if (r.own.size() < kLeastReadings) return out;
  Box near;
  for (const Vec3& p : r.own) near.extend(p);
  near.min().array() -= kWider_m;
  near.max().array() += kWider_m;
  std::erase_if(r.others, [&](const Vec3& p) { return !near.contains(p); });
  // The reading that was clicked may have been trimmed away.
  out.p_W = *std::min_element(r.own.begin(), r.own.end(), [&](const Vec3& a, const Vec3& b) {
    return (a - r.nearest_W).squaredNorm() < (b - r.nearest_W).squaredNorm();
  });
  for (const Part& part : cut_up(part_of(std::move(r.own), r.others), r.others))
    out.boxes_W[static_cast<std::size_t>(out.count++)] = widened(part, r.others);
  return out;
}

}  // namespace perception
