#include "tools/touch/view_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include <Eigen/Dense>

#include "perception/motion/motion_mask.hpp"

namespace teletact {

using perception::Vec3;
using Kind = TouchPlace::Kind;

namespace {

// chosen on: kitchen 1-75, room; judged on: kitchen 1-75, 76-150 and whole backwards, turn, near, corridor, stairs backwards (docs/recordings.md)
constexpr double kNear_m = 0.3,
                 kFar_m = 3.5;      // of the eye: farther a pixel of the picture spans 40 mm
constexpr double kPlane_m = 0.060;  // radius of the plane
constexpr double kWide_m = 0.100;   // flat to this radius: a wide place
constexpr double kSeed_m = 0.035;   // radius of the first fit
constexpr double kRingFrom_m = 0.045, kRingTo_m = 0.065;  // in which a side is covered or bare
constexpr double kInset_m = 0.022;       // a place is so far from its edge at least
constexpr double kOffPlane_m = 0.008;    // counts as on the plane
constexpr double kRough_m = 0.003;       // RMS
constexpr double kCovered = 0.97;        // of the pixels that look at the plane
constexpr double kStandsOver_m = 0.015;  // something that the hand would meet
constexpr double kGrazing = 0.30;        // least cosine between ray and normal
constexpr double kBehind_m = 0.04;       // beyond an edge the picture shows what lies so far behind
constexpr double kLevel = 0.9, kUpright = 0.25;         // of |up . n|
constexpr double kApart_m = 0.06, kFlatApart_m = 0.08;  // two places of a picture
constexpr int kSides = 8;  // sectors round a point that are judged covered or bare

// The points of the picture round one of them, and the plane through those within kPlane_m.
class Patch {
 public:
  Patch(const tasks::SceneView& view, int u, int v, const Vec3& p_W, double depth)
      : view_(view), X_VW_(view.X_WV.inverse()) {
    const auto& k = view.intrinsics;
    const int half = std::clamp(static_cast<int>(std::ceil(kWide_m * k.fx / depth)) + 1, 2, 30);
    const int step = std::max(1, half / 7);
    for (int y = v - half; y <= v + half; y += step) {
      for (int x = u - half; x <= u + half; x += step) {
        if (x < 0 || y < 0 || x >= k.width || y >= k.height) continue;
        const auto& q =
            view.points[static_cast<std::size_t>(y) * static_cast<std::size_t>(k.width) +
                        static_cast<std::size_t>(x)];
        Vec3 r = Vec3::Constant(1e3);  // nothing shows there
        if (q.depth > 0) {
          r = Vec3(static_cast<double>(q.x) - p_W.x(), static_cast<double>(q.y) - p_W.y(),
                   static_cast<double>(q.z) - p_W.z());
          if (r.squaredNorm() < 4 * kWide_m * kWide_m) points_.push_back(r);
        }
        pixels_.push_back({view.X_WV.linear() * k.unproject(x, y, 1), r});
      }
    }
    centre_ = p_W;
  }

  [[nodiscard]] std::optional<TouchPlace> place(const Vec3& up_W) {
    if (!fit() || stands_over()) return std::nullopt;
    const double rise = n_.dot(up_W);
    TouchPlace out;
    out.p_W = centre_ + offset_ * n_;
    out.n_W = n_;
    out.rough_m = rough_;
    if (share_on_plane(kPlane_m) >= kCovered) {
      out.wide = share_on_plane(kWide_m) >= kCovered;
      out.kind = rise > kLevel               ? Kind::kTop
                 : std::abs(rise) < kUpright ? Kind::kWall
                                             : Kind::kSlope;
    } else if (!at_edge(out)) {
      return std::nullopt;
    }
    return way_free(out) ? std::optional(out) : std::nullopt;
  }

 private:
  // What belongs to the plane there: first what is near, as a rim's side is not far; then all of it
  // that is on the plane.
  bool fit() {
    const auto near = [](double radius) {
      return [radius](const Vec3& r) { return r.squaredNorm() < radius * radius; };
    };
    if (!fit_to(near(kSeed_m), 6) && !fit_to(near(kPlane_m), 9)) return false;
    for (int round = 0; round < 2; ++round) {
      const Vec3 n = n_;
      const double offset = offset_;
      const auto on_plane = [&](const Vec3& r) {
        return r.squaredNorm() < kPlane_m * kPlane_m && std::abs(r.dot(n) - offset) < kOffPlane_m;
      };
      if (!fit_to(on_plane, 9)) return false;
    }
    const Vec3 to_eye = (view_.X_WV.translation() - centre_).normalized();
    return n_.dot(to_eye) > kGrazing && rough_ < kRough_m && std::abs(offset_) < kOffPlane_m;
  }

  template <class Belongs>
  bool fit_to(const Belongs& belongs, int least) {
    Vec3 mean = Vec3::Zero();
    Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
    int n = 0;
    for (const Vec3& r : points_) {
      if (!belongs(r)) continue;
      mean += r;
      square += r * r.transpose();
      ++n;
    }
    if (n < least) return false;
    mean /= n;
    const Eigen::Matrix3d covariance = square / n - mean * mean.transpose();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
    axes.computeDirect(covariance);
    if (axes.info() != Eigen::Success) return false;
    // A line of points is no plane.
    if (!(axes.eigenvalues()(1) > 0.1 * axes.eigenvalues()(2))) return false;
    n_ = axes.eigenvectors().col(0).normalized();
    if (n_.dot(view_.X_WV.translation() - centre_) < 0) n_ = -n_;
    rough_ = std::sqrt(std::max(0.0, axes.eigenvalues()(0)));
    offset_ = mean.dot(n_);
    return true;
  }

  // Height over the plane and distance from the centre along it.
  [[nodiscard]] std::pair<double, double> over(const Vec3& r) const {
    const double h = r.dot(n_) - offset_;
    return {h, (r - r.dot(n_) * n_).norm()};
  }

  [[nodiscard]] bool stands_over() const {
    return std::any_of(points_.begin(), points_.end(), [&](const Vec3& r) {
      const auto [h, along] = over(r);
      return h > kStandsOver_m && along < kPlane_m + 0.02;
    });
  }

  struct Pixel {
    Vec3 ray_W, r;  // r: its point, from the centre
  };
  // Where its ray meets the plane, from the centre's foot on it.
  [[nodiscard]] std::optional<Vec3> foot_of(const Pixel& pixel) const {
    const Vec3 eye = view_.X_WV.translation() - centre_;
    const double s = (offset_ - eye.dot(n_)) / pixel.ray_W.dot(n_);
    return s > 0 ? std::optional(Vec3(eye + s * pixel.ray_W - offset_ * n_)) : std::nullopt;
  }

  // Of the pixels whose ray meets the plane within `radius`: those that show it there; 0 with fewer
  // than `least`.
  [[nodiscard]] double share_on_plane(double radius, int least = 1) const {
    int all = 0, on = 0;
    for (const Pixel& pixel : pixels_) {
      const auto foot = foot_of(pixel);
      if (!foot || foot->norm() > radius) continue;
      ++all;
      on += std::abs(over(pixel.r).first) < kOffPlane_m ? 1 : 0;
    }
    return all >= least ? static_cast<double>(on) / all : 0;
  }

  // A bit a side where most of the pixels that look at the plane's ring show it. None: a side that
  // no pixel looks at.
  [[nodiscard]] std::optional<unsigned> sides() const {
    const Vec3 a = n_.unitOrthogonal(), b = n_.cross(a);
    std::array<int, kSides> all{}, on{};
    for (const Pixel& pixel : pixels_) {
      const auto foot = foot_of(pixel);
      if (!foot || foot->norm() < kRingFrom_m || foot->norm() > kRingTo_m) continue;
      const double turn = std::atan2(foot->dot(b), foot->dot(a)) / (2 * std::numbers::pi);
      const auto side = static_cast<std::size_t>(std::floor(kSides * (turn + 1))) % kSides;
      ++all[side];
      on[side] += std::abs(over(pixel.r).first) < kOffPlane_m ? 1 : 0;
    }
    unsigned covered = 0;
    for (std::size_t i = 0; i < kSides; ++i) {
      if (all[i] == 0) return std::nullopt;
      if (2 * on[i] > all[i]) covered |= 1U << i;
    }
    return covered;
  }

  // The sides without surface are next to each other, and behind each the picture shows something
  // farther.
  bool at_edge(TouchPlace& out) const {
    const auto known = sides();
    if (!known) return false;
    const unsigned covered = *known;
    int bare = 0, begins = 0;
    for (unsigned i = 0; i < kSides; ++i) {
      const bool is = (covered >> i & 1U) == 0,
                 was = (covered >> ((i + kSides - 1) % kSides) & 1U) == 0;
      bare += is ? 1 : 0;
      begins += is && !was ? 1 : 0;
    }
    if (begins != 1 || bare < 2 || bare > 5) return false;
    if (share_on_plane(kInset_m, 2) < kCovered) return false;  // on the very rim
    const Vec3 a = n_.unitOrthogonal(), b = n_.cross(a);
    for (unsigned i = 0; i < kSides; ++i) {
      if ((covered >> i & 1U) != 0) continue;
      const double turn = 2 * std::numbers::pi * (i + 0.5) / kSides;
      const Vec3 beyond = out.p_W + (kPlane_m + 0.02) * (std::cos(turn) * a + std::sin(turn) * b);
      const Vec3 q = X_VW_ * beyond;
      if (!(shown_depth(view_, q) > q.z() + kBehind_m)) return false;
    }
    out.kind = bare <= 3 ? Kind::kEdge : Kind::kCorner;
    return true;
  }

  [[nodiscard]] bool way_free(const TouchPlace& place) const {
    for (const double off : {0.025, 0.055}) {
      const Vec3 q = X_VW_ * (place.p_W + off * place.n_W);
      const double depth = shown_depth(view_, q);
      if (!(depth > q.z() - 0.01)) return false;
    }
    return true;
  }

  const tasks::SceneView& view_;
  perception::Pose X_VW_;
  Vec3 centre_ = Vec3::Zero(), n_ = Vec3::UnitZ();
  double offset_ = 0, rough_ = 0;
  std::vector<Vec3> points_;
  std::vector<Pixel> pixels_;
};

}  // namespace

const char* name_of(Kind kind) noexcept {
  constexpr std::array<const char*, TouchPlace::kKinds> names{"top", "wall", "slope", "edge",
                                                              "corner"};
  return names[static_cast<std::size_t>(kind)];
}

double shown_depth(const tasks::SceneView& view, const Vec3& p_V) noexcept {
  if (!(p_V.z() > 0.05)) return 0;
  const auto uv = view.intrinsics.project(p_V);
  if (!(uv.x() > -0.5 && uv.y() > -0.5 && uv.x() < view.intrinsics.width - 0.5 &&
        uv.y() < view.intrinsics.height - 0.5))
    return 0;
  const int u = static_cast<int>(uv.x() + 0.5), v = static_cast<int>(uv.y() + 0.5);
  return static_cast<double>(
      view.points[static_cast<std::size_t>(v) * static_cast<std::size_t>(view.intrinsics.width) +
                  static_cast<std::size_t>(u)]
          .depth);
}

std::vector<TouchPlace> places_in_view(const tasks::SceneView& view, const Vec3& up_W,
                                       const std::function<bool(const Vec3&)>& wanted) {
  std::vector<TouchPlace> found;
  const auto& k = view.intrinsics;
  for (int v = 1; v < k.height; v += 2) {
    for (int u = 1; u < k.width; u += 2) {
      const auto i = static_cast<std::size_t>(v) * static_cast<std::size_t>(k.width) +
                     static_cast<std::size_t>(u);
      const auto& q = view.points[i];
      const auto depth = static_cast<double>(q.depth);
      if (!(depth > kNear_m && depth < kFar_m)) continue;
      if (view.masked && view.what[i] != static_cast<std::uint8_t>(perception::PixelOf::kPlace))
        continue;
      const Vec3 p(static_cast<double>(q.x), static_cast<double>(q.y), static_cast<double>(q.z));
      if (wanted && !wanted(p)) continue;
      if (auto place = Patch(view, u, v, p, depth).place(up_W)) found.push_back(*place);
    }
  }
  // The best first, and none beside a better one of its sort.
  std::stable_sort(found.begin(), found.end(), [](const TouchPlace& a, const TouchPlace& b) {
    return a.wide != b.wide ? a.wide : a.rough_m < b.rough_m;
  });
  std::vector<TouchPlace> kept;
  for (const TouchPlace& f : found) {
    const bool beside = std::any_of(kept.begin(), kept.end(), [&](const TouchPlace& o) {
      return o.flat() == f.flat() && (o.p_W - f.p_W).norm() < (f.flat() ? kFlatApart_m : kApart_m);
    });
    if (!beside) kept.push_back(f);
  }
  return kept;
}

}  // namespace teletact
