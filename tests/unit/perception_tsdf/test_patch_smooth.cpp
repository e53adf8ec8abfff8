// The field round the hand, smoothed: exact where it says what it is for, better than it was under
// noise, left alone where there is shape. Fields are made node by node, as a projective distance of
// a camera has them.
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <functional>
#include <iostream>

#include "perception/tsdf/patch/patch_smooth.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using namespace perception;

constexpr double kVoxel = 0.01, kTruncation = 0.05;
constexpr int kNodes = 40;

using Shape = std::function<double(const Vec3& p_W)>;

std::unique_ptr<SurfacePatch> patch_of(const Shape& distance, double sigma_m, rt::Random& random) {
  auto p = std::make_unique<SurfacePatch>();
  p->voxel_size = kVoxel;
  p->metres_per_unit = static_cast<float>(kTruncation / 32767);
  p->origin_node = {-kNodes / 2, -kNodes / 2, -kNodes / 2};
  p->nodes = kNodes;
  for (int x = 0; x < kNodes; ++x)
    for (int y = 0; y < kNodes; ++y)
      for (int z = 0; z < kNodes; ++z) {
        const std::size_t at = p->index(x, y, z);
        const double d = distance(p->node_W(x, y, z)) + sigma_m * random.normal();
        p->distance[at] =
            static_cast<std::int16_t>(std::lround(32767 * std::clamp(d / kTruncation, -1.0, 1.0)));
        p->material[at] = 1;
        p->set_free(at, d > 0);
      }
  return p;
}

Vec3 direction(rt::Random& random) {
  Vec3 v;
  do v = Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
  while (v.norm() > 1 || v.norm() < 0.1);
  return v.normalized();
}

double metres(const SurfacePatch& p, std::size_t at) {
  return static_cast<double>(p.metres_per_unit) * p.distance[at];
}

// Nodes of cells that the surface goes through, within `reach` voxels of the origin.
template <class Use>
void each_near(const SurfacePatch& p, const Shape& distance, double reach, const Use& use) {
  for (int x = 1; x + 1 < p.nodes; ++x)
    for (int y = 1; y + 1 < p.nodes; ++y)
      for (int z = 1; z + 1 < p.nodes; ++z) {
        const Vec3 at_W = p.node_W(x, y, z);
        if (at_W.norm() > reach * kVoxel || std::abs(distance(at_W)) > kVoxel) continue;
        use(p.index(x, y, z), at_W);
      }
}

struct Errors {
  double before = 0, after = 0, worst_before = 0, worst_after = 0;
  int nodes = 0;
};
// RMS and largest error against the shape without noise, near the hand, before and after.
Errors errors(const Shape& shape, double sigma_m, std::uint64_t seed, double reach = 2.9) {
  rt::Startup startup;
  rt::Random random(seed);
  PatchSmoother smoother(startup.token(), {});
  const auto raw = patch_of(shape, sigma_m, random);
  auto smooth = std::make_unique<SurfacePatch>(*raw);
  smoother.smooth(Vec3::Zero(), *smooth);
  Errors e;
  each_near(*raw, shape, reach, [&](std::size_t at, const Vec3& p_W) {
    const double was = metres(*raw, at) - shape(p_W), now = metres(*smooth, at) - shape(p_W);
    e.before += was * was, e.after += now * now, ++e.nodes;
    e.worst_before = std::max(e.worst_before, std::abs(was));
    e.worst_after = std::max(e.worst_after, std::abs(now));
  });
  e.before = std::sqrt(e.before / e.nodes), e.after = std::sqrt(e.after / e.nodes);
  return e;
}

// A camera sees a plane from c metres: d = - z h / (c + h), z the depth of the node.
Shape seen_plane(const Vec3& n, const Vec3& eye, const Vec3& forward) {
  const double c = n.dot(eye);
  return [=](const Vec3& p) {
    const double z = forward.dot(p - eye), h = n.dot(p);
    return z * h / (c - h);
  };
}

TEST(PatchSmooth, WhatACameraSeesOfAPlaneStaysThatPlane) {
  rt::Random random(51);
  double worst = 0;
  for (int round = 0; round < 40; ++round) {
    const Vec3 n = direction(random);
    Vec3 to = direction(random);
    while (to.dot(n) < 0.5) to = direction(random);  // at most 60 degrees
    const double away = random.uniform(0.6, 3);
    const Errors e = errors(seen_plane(n, away * to, -to), 0, 51);
    worst = std::max(worst, e.worst_after);
    EXPECT_LE(e.worst_after, 6e-5)
        << "round " << round << " of seed 51, cosine " << to.dot(n) << ", distance " << away;
  }
  std::cout << "planes without noise: at most " << 1e3 * worst << " mm off\n";
}

TEST(PatchSmooth, NoiseIsAFifth) {
  rt::Random random(52);
  double sum = 0;
  for (int round = 0; round < 30; ++round) {
    const Vec3 n = direction(random);
    Vec3 to = direction(random);
    while (to.dot(n) < 0.6) to = direction(random);
    const double sigma = random.uniform(1e-4, 4e-4);
    const Errors e =
        errors(seen_plane(n, to, -to), sigma, 520U + static_cast<std::uint64_t>(round));
    sum += e.after / e.before / 30;
    EXPECT_LE(e.after, 0.4 * e.before) << "round " << round << " of seed 52";
  }
  std::cout << "white noise of .1 to .4 mm on planes: " << sum << " of it is left\n";
  EXPECT_LE(sum, 0.2);
}

TEST(PatchSmooth, ACurvedFaceIsNeverWorse) {
  for (const double radius : {0.03, 0.05, 0.08, 0.12, 0.2, 0.4, 1.0}) {
    for (const double sigma : {0.0, 3e-4}) {
      rt::Random random(53);
      Errors sum;
      for (int round = 0; round < 6; ++round) {
        const Vec3 n = direction(random);
        const Shape ball = [=](const Vec3& p) { return (p + radius * n).norm() - radius; };
        const Errors e = errors(ball, sigma, 530U + static_cast<std::uint64_t>(round));
        sum.before += e.before / 6, sum.after += e.after / 6;
        // What no camera has: without noise the fourth order is left over.
        EXPECT_LE(e.after, sigma > 0 ? 1.02 * e.before : 1.5e-4)
            << "radius " << radius << ", seed 53";
        EXPECT_LE(e.worst_after, e.worst_before + 3e-4) << "radius " << radius << ", seed 53";
      }
      std::cout << "ball of " << 1e3 * radius << " mm, noise " << 1e3 * sigma << " mm: RMS "
                << 1e3 * sum.before << " -> " << 1e3 * sum.after << " mm\n";
    }
  }
}

// A crease within three voxels of a node leaves it as it was, to the bit.
TEST(PatchSmooth, ACreaseStays) {
  rt::Startup startup;
  PatchSmoother smoother(startup.token(), {});
  for (const double sign : {1.0, -1.0}) {
    for (std::uint64_t seed = 60; seed < 66; ++seed) {
      rt::Random random(seed);
      const Vec3 a = direction(random), b = a.unitOrthogonal();
      const Shape edge = [=](const Vec3& p) { return sign * std::max(a.dot(p), b.dot(p)); };
      const auto raw = patch_of(edge, 2e-4, random);
      auto smooth = std::make_unique<SurfacePatch>(*raw);
      smoother.smooth(Vec3::Zero(), *smooth);
      const Vec3 along = a.cross(b);
      int nodes = 0;
      each_near(*raw, edge, 2.5, [&](std::size_t at, const Vec3& p_W) {
        const double off = (p_W - p_W.dot(along) * along).norm();
        if (off > 2.5 * kVoxel) return;
        ++nodes;
        EXPECT_EQ(smooth->distance[at], raw->distance[at]) << "seed " << seed << ", off " << off;
      });
      EXPECT_GT(nodes, 30);
    }
  }
}

// A plate: its back and its front are two surfaces.
TEST(PatchSmooth, AThinWallIsNeverWorse) {
  for (const double thick : {0.01, 0.015, 0.02, 0.03, 0.05}) {
    for (std::uint64_t seed = 70; seed < 74; ++seed) {
      rt::Random random(seed);
      const Vec3 n = direction(random);
      const Shape plate = [=](const Vec3& p) { return std::abs(n.dot(p) + thick / 2) - thick / 2; };
      const Errors e = errors(plate, 2e-4, seed);
      EXPECT_LE(e.after, 1.05 * e.before + 2e-5) << thick << " m, seed " << seed;
    }
  }
}

TEST(PatchSmooth, BeyondReachAndUnseenNothingChanges) {
  rt::Startup startup;
  PatchSmoother smoother(startup.token(), {});
  rt::Random random(80);
  const Vec3 n = Vec3(0.2, -0.1, 1).normalized();
  const Shape plane = [&](const Vec3& p) { return n.dot(p); };
  const auto raw = patch_of(plane, 3e-4, random);
  for (std::size_t k = 0; k < raw->cells(); ++k)
    if (random.uniform() < 0.2) raw->material[k] = 0, raw->distance[k] = 0, raw->set_free(k, false);
  auto smooth = std::make_unique<SurfacePatch>(*raw);
  const Vec3 hand(0.02, 0.013, 0.01);
  const auto stats = smoother.smooth(hand, *smooth);
  EXPECT_GT(stats.changed, 80);
  EXPECT_LE(stats.changed, stats.nodes);
  int changed = 0;
  for (int x = 0; x < kNodes; ++x)
    for (int y = 0; y < kNodes; ++y)
      for (int z = 0; z < kNodes; ++z) {
        const std::size_t at = raw->index(x, y, z);
        EXPECT_EQ(smooth->material[at], raw->material[at]);
        if (smooth->distance[at] == raw->distance[at]) {
          EXPECT_EQ(smooth->free_at(at), raw->free_at(at));
          continue;
        }
        ++changed;
        EXPECT_NE(raw->material[at], 0);
        EXPECT_LT((raw->node_W(x, y, z) - hand).norm(), 4.5 * kVoxel);
        EXPECT_EQ(smooth->free_at(at), smooth->distance[at] > 0);
      }
  EXPECT_EQ(changed, stats.changed);
}

// The window follows the hand: what a node becomes may not jump.
TEST(PatchSmooth, AMillimetreOfTheHandChangesNoNodeByMuch) {
  rt::Startup startup;
  PatchSmoother smoother(startup.token(), {});
  rt::Random random(81);
  const Shape plane = [](const Vec3& p) { return p.z() + 0.3 * p.x(); };
  const auto raw = patch_of(plane, 4e-4, random);
  auto here = std::make_unique<SurfacePatch>(*raw), there = std::make_unique<SurfacePatch>(*raw);
  smoother.smooth(Vec3::Zero(), *here);
  smoother.smooth(Vec3(0.001, 0, 0), *there);
  double most = 0, whole = 0;
  for (std::size_t k = 0; k < raw->cells(); ++k) {
    most = std::max(most, std::abs(metres(*here, k) - metres(*there, k)));
    whole = std::max(whole, std::abs(metres(*here, k) - metres(*raw, k)));
  }
  std::cout << "the hand 1 mm on: " << 1e3 * most << " of " << 1e3 * whole << " mm\n";
  EXPECT_GT(whole, 5e-4);
  EXPECT_LE(most, 0.1 * whole);  // smoothstep over 1.6 voxels: 1.5 / 16 a millimetre
}

// By QR, in double, from the definition.
double reference(const SurfacePatch& p, const Eigen::Vector3i& i, double radius) {
  const auto d = [&](const Eigen::Vector3i& n) {
    return metres(p, p.index(n.x(), n.y(), n.z())) / kVoxel;
  };
  Vec3 g;
  for (int a = 0; a < 3; ++a)
    g[a] = 0.5 * (d(i + Eigen::Vector3i::Unit(a)) - d(i - Eigen::Vector3i::Unit(a)));
  const Vec3 n = g.normalized(), t1 = n.unitOrthogonal(), t2 = n.cross(t1);
  const double height = d(i) / g.norm();
  if (std::abs(height) > n.lpNorm<1>() + 0.4 || std::abs(d(i)) * kVoxel >= 0.9 * kTruncation)
    return d(i);
  std::vector<Eigen::Matrix<double, 8, 1>> rows;
  std::vector<double> values, weights;
  const int r = static_cast<int>(radius);
  for (int x = -r; x <= r; ++x)
    for (int y = -r; y <= r; ++y)
      for (int z = -r; z <= r; ++z) {
        const Vec3 o(x, y, z);
        const double q = o.squaredNorm() / (radius * radius), h = n.dot(o);
        if (q >= 1 || std::abs(height + h) > std::max(1.25, std::abs(height) + 0.01)) continue;
        const double value = d(i + Eigen::Vector3i(x, y, z));
        if (std::abs(value) * kVoxel >= 0.9 * kTruncation) continue;
        Eigen::Matrix<double, 8, 1> v;
        v << 1, t1.dot(o), t2.dot(o), h, h * h, t1.dot(o) * t1.dot(o), t1.dot(o) * t2.dot(o),
            t2.dot(o) * t2.dot(o);
        rows.push_back(v), values.push_back(value), weights.push_back((1 - q) * (1 - q));
      }
  const auto count = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd A(count, 8);
  Eigen::VectorXd b(count);
  double sum = 0, square = 0;
  for (Eigen::Index k = 0; k < count; ++k) {
    const double w = weights[static_cast<std::size_t>(k)], s = std::sqrt(w);
    A.row(k) = s * rows[static_cast<std::size_t>(k)].transpose();
    b[k] = s * values[static_cast<std::size_t>(k)];
    sum += w, square += w * w;
  }
  const Eigen::VectorXd flat = A.leftCols(5).colPivHouseholderQr().solve(b),
                        bent = A.colPivHouseholderQr().solve(b);
  const double left_flat = (A.leftCols(5) * flat - b).squaredNorm(),
               left = (A * bent - b).squaredNorm(), noise = 9 * left / sum * square / sum;
  const double t = std::clamp((std::sqrt(left / sum) / g.norm() - 0.05) / 0.05, 0.0, 1.0),
               taken = 1 - t * t * (3 - 2 * t), curved = left_flat - left;
  const double counts = curved > 2 * noise ? 1 - 2 * noise / curved : 0;
  const double bend = counts *
                      (2 * std::max(std::abs(bent[5]), std::abs(bent[7])) + std::abs(bent[6])) /
                      g.norm(),
               bias = 0.027 * std::pow(bend, 3) * std::pow(radius, 4),
               noise2 = left / sum / g.squaredNorm();
  return d(i) + taken * noise2 / (noise2 + bias * bias + 1e-12) *
                    (flat[0] + counts * (bent[0] - flat[0]) - d(i));
}

TEST(PatchSmooth, AgreesWithASlowReference) {
  rt::Startup startup;
  PatchSmoother smoother(startup.token(), {});
  rt::Random random(90);
  int compared = 0, moved = 0;
  for (int round = 0; round < 12; ++round) {
    const Vec3 n = direction(random);
    const double radius = random.uniform(0.05, 0.5), sigma = random.uniform(1e-4, 1.5e-3);
    const Shape ball = [=](const Vec3& p) { return 1.5 * ((p + radius * n).norm() - radius); };
    const auto raw = patch_of(ball, sigma, random);
    each_near(*raw, ball, 2, [&](std::size_t at, const Vec3& p_W) {
      const Eigen::Vector3i i = (p_W / kVoxel).array().round().cast<int>() + kNodes / 2;
      const double slow = reference(*raw, i, 5) * kVoxel,
                   ours = static_cast<double>(raw->metres_per_unit) *
                          static_cast<double>(smoother.node(*raw, i.x(), i.y(), i.z()));
      EXPECT_NEAR(ours, slow, 1e-5) << "round " << round << " of seed 90";
      ++compared, moved += std::abs(slow - metres(*raw, at)) > 1e-5;
    });
  }
  EXPECT_GT(compared, 150);
  EXPECT_GT(moved, 100);
}

TEST(PatchSmooth, WhatIsNoPatchStaysAndNothingIsAllocated) {
  rt::Startup startup;
  PatchSmoother smoother(startup.token(), {});
  rt::Random random(91);
  const Shape plane = [](const Vec3& p) { return p.z(); };
  const auto raw = patch_of(plane, 3e-4, random);
  auto p = std::make_unique<SurfacePatch>(*raw);
  const double nan = std::nan("");
  for (const Vec3& hand :
       {Vec3(nan, 0, 0), Vec3(0, 1e300, 0), Vec3(5, 5, 5), Vec3(-0.2, -0.2, -0.2)})
    EXPECT_EQ(smoother.smooth(hand, *p).changed, 0);
  p->voxel_size = 0;
  EXPECT_EQ(smoother.smooth(Vec3::Zero(), *p).changed, 0);
  p->voxel_size = nan;
  EXPECT_EQ(smoother.smooth(Vec3::Zero(), *p).changed, 0);
  p->voxel_size = kVoxel;
  EXPECT_EQ(p->distance, raw->distance);
  for (auto& m : p->material) m = 0;
  EXPECT_EQ(smoother.smooth(Vec3::Zero(), *p).changed, 0);
  p->material = raw->material;
  const auto before = rt_guard::counts();
  {
    rt::Section section;
    EXPECT_GT(smoother.smooth(Vec3::Zero(), *p).changed, 100);
  }
  EXPECT_EQ(rt_guard::counts().allocations, before.allocations);
}

}  // namespace
}  // namespace tests
