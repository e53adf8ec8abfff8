// The oracle of the hard cases against closed forms, and by random search.
#include "tools/measure/support/field_optimum.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "rt/random.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using perception::Vec3;
using support::FieldOptimum;
using support::ReferenceField;

constexpr double kVoxel = 0.01;
constexpr double kResolution = 5e-5;

ReferenceField sampled(const std::function<double(const Vec3&)>& phi) {
  return {[&](int x, int y, int z) { return phi(kVoxel * Vec3(x, y, z)); }, kVoxel,
          Eigen::Array3i::Constant(-6), Eigen::Array3i::Constant(13)};
}

// Follows the hand from `from` to `to` in pieces of 0.1 mm and hands each place to `check`.
void along(const FieldOptimum& optimum, Vec3 p, const Vec3& from, const Vec3& to,
           const std::function<void(const Vec3& p, const Vec3& h)>& check) {
  const int n = static_cast<int>(std::ceil((to - from).norm() / 1e-4));
  Vec3 last = from;
  p = optimum.descend(p, from);
  for (int i = 0; i <= n; ++i) {
    const Vec3 h = from + (static_cast<double>(i) / n) * (to - from);
    p = optimum.follow(p, last, h);
    last = h;
    check(p, h);
  }
}

TEST(FieldOptimum, SkewPlane) {
  const Vec3 n = Vec3(1, -2, 4).normalized();
  const ReferenceField field = sampled([&](const Vec3& x) { return n.dot(x) - 0.002; });
  const FieldOptimum optimum(field, 0.0);
  const Vec3 from(-0.015, 0.004, -0.004), to(0.015, -0.002, -0.006);
  along(optimum, from + 0.02 * n, from, to, [&](const Vec3& p, const Vec3& h) {
    EXPECT_LT((p - (h - (n.dot(h) - 0.002) * n)).norm(), kResolution);
  });
}

// A steep field that was seen on one side only: the tip's radius is multiplied by the slope of what
// was seen.
TEST(FieldOptimum, SteepFieldBesideWhatWasNotSeen) {
  constexpr double kSteep = 3, kRadius = 0.002;
  const ReferenceField field =
      sampled([](const Vec3& x) { return x.x() > -1e-6 ? kSteep * x.z() : -0.05; });
  const auto rest = [&](const FieldOptimum& optimum) {
    return optimum.follow({0.002, 0, 0.012}, {0.002, 0, 0.012}, {0.002, 0, -0.002}).z();
  };
  EXPECT_NEAR(rest(FieldOptimum(field, kRadius, 0.01, [](const Vec3& x) { return x.x() > -1e-6; })),
              kRadius, 1e-4);
  EXPECT_GT(rest(FieldOptimum(field, kRadius)),
            1.2 * kRadius);  // what was not seen taken for solid
}

// A roof that lies on grid nodes, so that the samples hold it exactly: the foot on the side it came
// from until that foot reaches the ridge, and no sooner.
TEST(FieldOptimum, RoofIsLeftAtItsRidge) {
  constexpr double kSlope = 0.06;
  const ReferenceField field =
      sampled([](const Vec3& x) { return x.z() + kSlope * std::abs(x.x()); });
  const FieldOptimum optimum(field, 0.0);
  const auto foot = [](const Vec3& h, double side) {
    const Vec3 g(side * kSlope, 0, 1);
    return Vec3(h - (g.dot(h) / g.squaredNorm()) * g);
  };
  int left = 0, right = 0;
  along(optimum, {-0.012, 0, 0.01}, {-0.012, 0.001, -0.012}, {0.012, 0.003, -0.012},
        [&](const Vec3& p, const Vec3& h) {
          const double switched = kSlope * 0.012;
          if (h.x() < switched - 2e-4) {
            EXPECT_LT((p - foot(h, -1)).norm(), kResolution) << h.x();
            ++left;
          } else if (h.x() > switched + 1e-4) {
            EXPECT_LT((p - foot(h, 1)).norm(), kResolution) << h.x();
            ++right;
          }
        });
  EXPECT_GT(std::min(left, right), 100);
}

TEST(FieldOptimum, ValleyHoldsBetweenItsFaces) {
  for (const double slope : {0.1, 1.0}) {
    const ReferenceField field =
        sampled([=](const Vec3& x) { return x.z() - slope * std::abs(x.x()); });
    const FieldOptimum optimum(field, 0.0);
    along(optimum, {-0.008, 0, 0.02}, {-0.008, 0, -0.006}, {0.008, 0.004, -0.006},
          [&](const Vec3& p, const Vec3& h) {
            const double side = h.x() < 0 ? -1 : 1;
            const Vec3 g(-side * slope, 0, 1);
            Vec3 right = h - (g.dot(h) / g.squaredNorm()) * g;
            if (side * right.x() < 0) right = {0, h.y(), 0};
            EXPECT_LT((p - right).norm(), kResolution) << slope << " " << h.x();
          });
  }
}

TEST(FieldOptimum, RoomCornerOnNodes) {
  const ReferenceField field = sampled([](const Vec3& x) {
    const Vec3 a(-x.x(), -x.y(), x.z());
    return a.minCoeff() >= 0 ? a.minCoeff() : -a.cwiseMin(0.0).norm();
  });
  const FieldOptimum optimum(field, 0.0);
  along(optimum, {-0.02, -0.01, 0.01}, {-0.02, -0.01, -0.006}, {0.006, 0.004, -0.006},
        [](const Vec3& p, const Vec3& h) {
          EXPECT_LT((p - Vec3(std::min(h.x(), 0.0), std::min(h.y(), 0.0), 0)).norm(), kResolution);
        });
}

// z = b x y is held exactly by the samples everywhere and has no ridge.
TEST(FieldOptimum, CurvedSheet) {
  constexpr double kB = 10;
  const ReferenceField field = sampled([](const Vec3& x) { return x.z() - kB * x.x() * x.y(); });
  const FieldOptimum optimum(field, 0.0);
  along(optimum, {-0.01, 0.004, 0.02}, {-0.01, 0.004, -0.008}, {0.012, 0.01, -0.008},
        [](const Vec3& p, const Vec3& h) {
          double x = h.x(), y = h.y();
          for (int i = 0; i < 50; ++i) {  // stationary |p - h|^2 over the sheet
            const double r = kB * x * y - h.z();
            const double gx = x - h.x() + r * kB * y, gy = y - h.y() + r * kB * x;
            const double xx = 1 + kB * kB * y * y, yy = 1 + kB * kB * x * x,
                         xy = kB * r + kB * kB * x * y, det = xx * yy - xy * xy;
            x -= (yy * gx - xy * gy) / det;
            y -= (xx * gy - xy * gx) / det;
          }
          EXPECT_LT((p - Vec3(x, y, kB * x * y)).norm(), kResolution);
        });
}

// On a rough field: nothing free within 0.05 mm is nearer, and no step went away from the hand.
TEST(FieldOptimum, NothingNearbyIsNearer) {
  constexpr std::uint64_t kSeed = 5;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  for (int round = 0; round < 6; ++round) {
    const double sigma = 3e-4 * (round + 1);
    const ReferenceField field =
        sampled([&](const Vec3& x) { return x.z() + sigma * random.normal(); });
    const FieldOptimum optimum(field, 0.0);
    int asked = 0;
    along(optimum, {-0.02, -0.01, 0.01}, {-0.02, -0.01, -0.008}, {0.015, 0.01, -0.006},
          [&](const Vec3& p, const Vec3& h) {
            ASSERT_GT(field(p), 0);
            EXPECT_LE((optimum.descend(p, h) - h).norm(), (p - h).norm());
            if (++asked % 20 != 0) return;
            for (int i = 0; i < 2000; ++i) {
              const Vec3 way = kResolution * Vec3(random.uniform(-1, 1), random.uniform(-1, 1),
                                                  random.uniform(-1, 1));
              if ((p + way - h).norm() > (p - h).norm() - 2e-6) continue;
              EXPECT_LE(std::min(field(p + way), field(p + 0.5 * way)), 2e-7) << sigma;
            }
          });
  }
}

// What rays of synthetic depth step by: never farther than the sheet is, and of its sign.
TEST(Solids, TheSaddlesBoundIsNoFartherThanTheSheet) {
  constexpr std::uint64_t kSeed = 6;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  constexpr double kBend = 6;
  double closest = 0;
  for (int i = 0; i < 400; ++i) {
    const Vec3 p = 0.3 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const double bound = solids::saddle_bound(p, kBend);
    const double above = p.z() - kBend * (p.x() * p.x() - p.y() * p.y());
    EXPECT_GE(bound * above, 0);
    double nearest = 1;
    for (double u = -0.6; u <= 0.6; u += 0.01) {
      for (double v = -0.6; v <= 0.6; v += 0.01) {
        nearest = std::min(nearest, (Vec3(u, v, kBend * (u * u - v * v)) - p).norm());
      }
    }
    EXPECT_LE(std::abs(bound), nearest) << p.transpose();
    closest = std::max(closest, std::abs(bound) / nearest);
  }
  EXPECT_GT(closest, 0.5);
}

}  // namespace
