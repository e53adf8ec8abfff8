#include "tools/measure/stability/fused_field.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "drivers/camera/depth_noise.hpp"
#include "perception/tsdf/patch/patch_copy.hpp"
#include "rt/random.hpp"

namespace stability {

using perception::Intrinsics;
using perception::Pose;
using perception::TsdfMap;
using perception::Vec3;

namespace {

constexpr double kDistance_m = 1.0, kSeen_m = 0.15, kAround_m = 0.35;
constexpr double kUnderHand_m = 0.25;  // as tasks/fusion has it; the hand is at the origin of S
constexpr double kAxial = 1, kLateral_px = 0.3, kDropout = 0.5, kFlying = 0.02;

perception::TsdfConfig map_config() {
  perception::TsdfConfig c;
  c.voxel_size_m = 0.01;
  c.truncation_m = 0.05;
  c.max_blocks = 4096;
  c.max_chunks = 256;
  c.far_store_kib = 0;
  return c;
}

// Optical frame, looking from `eye` at `target`.
Pose looking(const Vec3& eye, const Vec3& target) {
  Pose X = Pose::Identity();
  const Vec3 z = (target - eye).normalized(), x = z.unitOrthogonal();
  X.linear().col(0) = x;
  X.linear().col(1) = z.cross(x);
  X.linear().col(2) = z;
  X.translation() = eye;
  return X;
}

}  // namespace

FusedField::FusedField(const Pose& X_WS, const FusedView& view)
    : X_WS_(X_WS), view_(view), map_(startup_.token(), map_config()) {
  if (view.smooth <= 0) return;
  perception::SmoothOptions options;
  options.radius = view.smooth;
  smoother_ = std::make_unique<perception::PatchSmoother>(startup_.token(), options);
}

// Depth along the axis of the ray through (u, v), m; 0: none.
double FusedField::depth(const Solid& solid, const Pose& X_SC, const Vec3& ray_C) const {
  const Vec3 way = X_SC.linear() * ray_C;
  const double nearest = -X_SC.translation().dot(way);  // along the ray, to the origin of S
  const double off = (X_SC.translation() + nearest * way).norm();
  if (off > kAround_m) return 0;
  const double wall = (nearest + std::sqrt(1 - off * off)) * ray_C.z();
  if (off > kSeen_m) return wall;
  double t = nearest - 2 * kSeen_m;
  for (int i = 0; i < 200 && t < nearest + 3 * kSeen_m; ++i) {
    const double d = solid(X_SC.translation() + t * way);
    if (i == 0 && d <= 0) return 0;  // the way begins in the solid: nothing is seen on it
    if (d < 1e-6) return t * ray_C.z();
    t += d;
  }
  return wall;
}

// Edges as drivers/camera/render.cpp has them: 1/z is linear in the image on any plane.
void FusedField::disturb(std::vector<double>& z, int width, int height, rt::Random& random) {
  const std::vector<double> clean = z;
  const auto inverse = [&](int u, int v) {
    const double d = clean[static_cast<std::size_t>(v * width + u)];
    return d > 0 ? 1 / d : 0.0;
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      double& here = z[static_cast<std::size_t>(v * width + u)];
      const double axial = random.normal(), between = random.uniform(), flies = random.uniform(),
                   drops = random.uniform();
      if (here <= 0) continue;
      const double middle = inverse(u, v);
      double step = 0, lo = middle, hi = middle;
      const auto look = [&](double a, double b) {
        step = std::max(step, std::abs(a - 2 * middle + b));
        for (const double i : {a, b}) {
          if (i > 0) lo = std::min(lo, i), hi = std::max(hi, i);
        }
      };
      if (u > 0 && u + 1 < width) look(inverse(u - 1, v), inverse(u + 1, v));
      if (v > 0 && v + 1 < height) look(inverse(u, v - 1), inverse(u, v + 1));
      const bool edge = step > drivers::DepthNoise::kEdgeStep * middle;
      if (edge && flies < kFlying) here = 1 / hi + (1 / lo - 1 / hi) * between;
      here += kAxial * axial * drivers::kinect_v2_sigma_m(here);
      if (edge && drops < kDropout) here = 0;
    }
  }
}

void FusedField::see(const Solid& solid) {
  const Intrinsics k{365, 365, 255.5, 211.5, 512, 424};
  rt::Random random(11, static_cast<std::uint64_t>(frame_++));
  const double angle = view_.incidence_deg * std::numbers::pi / 180;
  const Vec3 towards = std::cos(angle) * Vec3::UnitZ() + std::sin(angle) * view_.lean_S;
  const auto jitter = [&](double size) {
    return Vec3(random.uniform(-size, size), random.uniform(-size, size),
                random.uniform(-size, size));
  };
  const Pose X_SC = looking(kDistance_m * towards + jitter(0.005), jitter(0.005));
  const bool all = view_.noise && !view_.axial_alone;
  std::vector<double> z(static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height));
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double du = all ? kLateral_px * random.normal() : 0,
                   dv = all ? kLateral_px * random.normal() : 0;
      z[static_cast<std::size_t>(v * k.width + u)] =
          depth(solid, X_SC, k.unproject(u + du, v + dv, 1).normalized());
    }
  }
  if (all) disturb(z, k.width, k.height, random);
  for (double& d : z) {
    if (view_.noise && !all) d += d > 0 ? random.normal() * drivers::kinect_v2_sigma_m(d) : 0;
  }
  std::vector<std::uint16_t> mm(z.size());
  for (std::size_t n = 0; n < z.size(); ++n)
    mm[n] = static_cast<std::uint16_t>(std::lround(1000 * z[n]));
  perception::FrameView frame{k, {mm.data(), k.width, k.height, k.width}, {}};
  frame.follow_W = {X_WS_.translation() - Vec3::Constant(kUnderHand_m),
                    X_WS_.translation() + Vec3::Constant(kUnderHand_m)};
  const auto stats = map_.integrate(frame, X_WS_ * X_SC, 1);
  if (stats.refused || stats.blocks_refused > 0) {
    throw std::runtime_error("stability: a synthetic depth image was not fused");
  }
}

void FusedField::window(const Vec3& centre_W, int nodes, perception::SurfacePatch& out) const {
  if (!perception::copy_patch(map_, centre_W, nodes, out)) {
    throw std::runtime_error("stability: no window of the fused map");
  }
  if (smoother_) smoother_->smooth(centre_W, out);
}

double FusedField::height() const {
  const double voxel = map_.voxel_size();
  const auto value = [&](const Vec3& p) {
    const Vec3 q = p / voxel;
    const Eigen::Array3i i = q.array().floor().cast<int>();
    double sum = 0;
    for (int c = 0; c < 8; ++c) {
      const Eigen::Array3i n = i + Eigen::Array3i(c >> 2, (c >> 1) & 1, c & 1);
      sum += node(n.x(), n.y(), n.z()) *
             (Vec3::Ones() - (q - n.cast<double>().matrix()).cwiseAbs()).prod();
    }
    return sum;
  };
  double lo = -0.05, hi = 0.05;
  for (int k = 0; k < 40; ++k) {
    const double m = 0.5 * (lo + hi);
    (value(X_WS_ * Vec3(0, 0, m)) > 0 ? hi : lo) = m;
  }
  return 0.5 * (lo + hi);
}

bool FusedField::known(int x, int y, int z) const {
  return TsdfMap::word_weight(map_.word_at(x, y, z)) >= TsdfMap::kObservedWeight ||
         map_.free_at(x, y, z);
}

double FusedField::smoothed(int x, int y, int z) const {
  if (whole_of_ != frame_) {
    if (!whole_) whole_ = std::make_unique<perception::SurfacePatch>();
    perception::copy_patch(map_, X_WS_.translation(), perception::SurfacePatch::kMaxNodes, *whole_);
    whole_of_ = frame_;
  }
  const auto& o = whole_->origin_node;
  const int i = x - o[0], j = y - o[1], k = z - o[2];
  if (std::min({i, j, k}) < 0 || std::max({i, j, k}) >= whole_->nodes)
    return static_cast<double>(map_.metres_per_unit()) *
           TsdfMap::word_distance(map_.word_at(x, y, z));
  return static_cast<double>(whole_->metres_per_unit) *
         static_cast<double>(smoother_->node(*whole_, i, j, k));
}

double FusedField::node(int x, int y, int z) const {
  const auto unit = static_cast<double>(map_.metres_per_unit());
  const auto observed = [&](int i, int j, int k) {
    return TsdfMap::word_weight(map_.word_at(i, j, k)) >= TsdfMap::kObservedWeight;
  };
  const auto distance = [&](int i, int j, int k) {
    return unit * TsdfMap::word_distance(map_.word_at(i, j, k));
  };
  if (observed(x, y, z)) return smoother_ ? smoothed(x, y, z) : distance(x, y, z);
  if (!map_.free_at(x, y, z)) return -map_.truncation();
  double least = map_.truncation();
  for (int side = 0; side < 6; ++side) {
    const int step = (side & 1) != 0 ? 1 : -1;
    const int i = x + (side / 2 == 0 ? step : 0), j = y + (side / 2 == 1 ? step : 0),
              k = z + (side / 2 == 2 ? step : 0);
    if (observed(i, j, k)) least = std::min(least, distance(i, j, k) + map_.voxel_size());
  }
  return std::max(least, 0.5 * map_.voxel_size());
}

}  // namespace stability
