// The body's pixels against a march along each ray, closed forms, and bodies that are not quite
// where they were said.
#include "perception/body/body_mask.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <numbers>

#include "perception/body/held_object.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/support/paths.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using perception::ArticulatedBody;
using perception::BodyMask;
using perception::BodyPadding;
using perception::Capsule;
using perception::Image;
using perception::Intrinsics;
using perception::PixelOf;
using perception::Pose;
using perception::Vec3;

rt::Startup startup;
constexpr auto kBody = static_cast<std::uint8_t>(PixelOf::kBody);
const Intrinsics kKinect{365, 365, 255.5, 211.5, 512, 424};

struct Picture {
  explicit Picture(const Intrinsics& camera, std::uint16_t depth = 3000)
      : k(camera),
        depth_mm(k.width, k.height, depth),
        mask(k.width, k.height),
        body(startup.token(), k.width, k.height) {}
  int mark(const std::vector<Capsule>& c) { return body.mark(c, k, depth_mm.view(), mask.view()); }
  int count() const {
    int n = 0;
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) n += mask.at(u, v) == kBody;
    return n;
  }
  Vec3 ray(int u, int v) const { return {(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1}; }
  Intrinsics k;
  Image<std::uint16_t> depth_mm;
  Image<std::uint8_t> mask;
  BodyMask body;
};

double distance(const Capsule& c, const Vec3& p) {
  const Vec3 way = c.b - c.a;
  const double l2 = way.squaredNorm();
  const double s = l2 > 0 ? std::clamp((p - c.a).dot(way) / l2, 0.0, 1.0) : 0.0;
  return (p - (c.a + s * way)).norm() - c.radius;
}

// Depth at which the ray enters the capsule: steps as long as the distance allows. `closest`: how
// near it came.
double march(const Capsule& c, const Vec3& ray, double& closest) {
  const double length = ray.norm();
  closest = 1e9;
  for (double t = 0; t < 20;) {
    const double d = distance(c, t * ray);
    closest = std::min(closest, d);
    if (d < 1e-7) return t;
    t += d / length;
  }
  return -1;
}

TEST(BodyMask, EqualsAMarchAlongEveryRay) {
  std::uint64_t checked = 0, body = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    rt::Random rng(seed);
    Picture p({90, 95, 40.2, 30.7, 83, 61});
    for (int v = 0; v < 61; ++v)
      for (int u = 0; u < 83; ++u)
        p.depth_mm.at(u, v) = rng.uniform() < 0.1
                                  ? std::uint16_t{0}
                                  : static_cast<std::uint16_t>(rng.integer(300, 3000));
    const Image<std::uint16_t> before = p.depth_mm;
    std::vector<Capsule> capsules;
    for (int i = 0; i < 4; ++i) {
      const auto point = [&rng] {
        const double z = rng.uniform(-0.2, 2.5);
        return Vec3(rng.uniform(-0.7, 0.7) * std::abs(z), rng.uniform(-0.5, 0.5) * std::abs(z), z);
      };
      Capsule c{point(), point(), rng.uniform(0.01, 0.15)};
      if (i == 3) c.b = c.a;                          // a ball
      if (i == 2) c.b = c.a * rng.uniform(1.1, 1.5);  // along the rays
      if (distance(c, Vec3::Zero()) > 0.05) capsules.push_back(c);
    }
    p.mark(capsules);
    for (int v = 0; v < 61; ++v) {
      for (int u = 0; u < 83; ++u) {
        double front = -1, closest = 1e9;
        for (const Capsule& c : capsules) {
          double near = 0;
          const double t = march(c, p.ray(u, v), near);
          if (t < 0) closest = std::min(closest, near);
          if (t >= 0 && (front < 0 || t < front)) front = t;
        }
        const int mm = before.at(u, v);
        const bool want = front >= 0 && (mm == 0 || mm * 1e-3 >= front);
        const bool got = p.mask.at(u, v) == kBody;
        ASSERT_EQ(p.depth_mm.at(u, v), got ? 0 : mm);
        ++checked;
        body += got;
        // Not decided: the ray all but touches an outline, or the reading all but lies on the
        // front.
        if (closest < 1e-5 || (front >= 0 && std::abs(mm * 1e-3 - front) < 1e-5)) continue;
        bool grazes = false;
        for (const Capsule& c : capsules) {
          Capsule less = c;
          less.radius -= 2e-5;
          double near = 0;
          grazes |= march(c, p.ray(u, v), near) >= 0 && march(less, p.ray(u, v), near) < 0;
        }
        if (grazes) continue;
        ASSERT_EQ(got, want) << "seed " << seed << " pixel " << u << ' ' << v << " front " << front
                             << " reading " << mm;
      }
    }
  }
  EXPECT_GT(body, checked / 20);
}

TEST(BodyMask, ABallsAreaIsItsOutlines) {
  for (const double z : {0.5, 1.0, 2.0}) {
    for (const double r : {0.03, 0.1, 0.2}) {
      Picture p(kKinect);
      const int n = p.mark({{Vec3(0, 0, z), Vec3(0, 0, z), r}});
      const double radius_px = kKinect.fx * r / std::sqrt(z * z - r * r);
      EXPECT_NEAR(n, std::numbers::pi * radius_px * radius_px, 2.5 * radius_px + 4);
      EXPECT_EQ(n, p.count());
    }
  }
  // Across the view at depth z: a strip with two half discs, each as wide as the lens sees it.
  Picture p(kKinect);
  const double z = 1.0, r = 0.05;
  const int n = p.mark({{Vec3(-0.3, 0, z), Vec3(0.3, 0, z), r}});
  const double half = kKinect.fy * r / std::sqrt(z * z - r * r);
  EXPECT_NEAR(n, 2 * half * kKinect.fx * 0.6 + std::numbers::pi * half * half, 0.01 * n + 60);
}

TEST(BodyMask, WhatIsBeforeItStaysAndWhatTrailsBehindGoes) {
  Picture p(kKinect);
  const std::vector<Capsule> arm{{Vec3(-0.2, 0, 1), Vec3(0.2, 0, 1), 0.05}};
  p.depth_mm.at(256, 212) = 900;   // a finger before it
  p.depth_mm.at(250, 212) = 951;   // its front
  p.depth_mm.at(251, 212) = 1500;  // between it and the wall: a flying pixel
  p.depth_mm.at(252, 212) = 0;
  p.mark(arm);
  EXPECT_EQ(p.depth_mm.at(256, 212), 900);
  EXPECT_EQ(p.mask.at(256, 212), 0);
  for (const int u : {250, 251, 252}) {
    EXPECT_EQ(p.depth_mm.at(u, 212), 0);
    EXPECT_EQ(p.mask.at(u, 212), kBody);
  }
  EXPECT_EQ(p.mask.at(256, 300), 0);
  EXPECT_EQ(p.depth_mm.at(256, 300), 3000);
}

TEST(BodyMask, NothingStaysOfTheLastImage) {
  Picture p(kKinect);
  EXPECT_GT(p.mark({{Vec3(-0.2, 0, 1), Vec3(0.2, 0, 1), 0.05}}), 0);
  p.mask.at(3, 3) = static_cast<std::uint8_t>(PixelOf::kMoving);  // somebody else's
  const int n = p.mark({{Vec3(0, -0.3, 1), Vec3(0, -0.2, 1), 0.03}});
  EXPECT_EQ(p.count(), n);
  EXPECT_EQ(p.mask.at(3, 3), static_cast<std::uint8_t>(PixelOf::kMoving));
  EXPECT_EQ(p.mark({}), 0);
  EXPECT_EQ(p.count(), 0);
  EXPECT_EQ(p.body.work(), 0U);
}

TEST(BodyMask, BehindTheLensNothingAroundItEverything) {
  Picture p(kKinect);
  EXPECT_EQ(p.mark({{Vec3(-0.2, 0, -1), Vec3(0.2, 0, -0.1), 0.05}}), 0);
  EXPECT_EQ(p.mark({{Vec3(3, 0, 1), Vec3(4, 0, 1), 0.05}}), 0);  // beside the image
  EXPECT_EQ(p.mark({{Vec3(0, 0, -0.2), Vec3(0, 0, 0.2), 0.05}}), 512 * 424);
  // Through the image plane beside the lens: exact as everywhere.
  Picture q(kKinect);
  const Capsule c{Vec3(0.3, 0, -0.5), Vec3(0.3, 0, 1.5), 0.05};
  q.mark({c});
  for (int v = 0; v < 424; v += 7) {
    for (int u = 0; u < 512; u += 7) {
      double near = 0;
      const double t = march(c, q.ray(u, v), near);
      if (t < 0 ? near < 1e-5 : distance(c, (t + 1e-4) * q.ray(u, v)) > -1e-6) continue;
      ASSERT_EQ(q.mask.at(u, v) == kBody, t >= 0) << u << ' ' << v;
    }
  }
}

// A body that is off by up to what its pad allows, whatever the way, has no reading left.
TEST(BodyMask, TheMarginHoldsADisplacedBody) {
  rt::Random rng(8);
  for (int n = 0; n < 40; ++n) {
    const Capsule said{Vec3(rng.uniform(-0.3, 0), rng.uniform(-0.3, 0.3), rng.uniform(0.5, 1.2)),
                       Vec3(rng.uniform(0, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(0.5, 1.2)),
                       rng.uniform(0.015, 0.06)};
    const double error = rng.uniform(0, 0.05);
    Capsule padded = said;
    padded.radius += perception::pad_of(said, error, {}, kKinect);
    Vec3 off(rng.normal(), rng.normal(), rng.normal());
    off *= error / off.norm();
    const Capsule real{said.a + off, said.b + off, said.radius};
    Picture p({182.5, 182.5, 127.5, 105.5, 256, 212});
    std::vector<std::uint8_t> shows(256 * 212);
    for (int v = 0; v < 212; ++v) {
      for (int u = 0; u < 256; ++u) {
        double near = 0;
        const double t = march(real, p.ray(u, v), near);
        if (t < 0) continue;
        shows[static_cast<std::size_t>(v * 256 + u)] = 1;
        p.depth_mm.at(u, v) = static_cast<std::uint16_t>(t * 1000 + 0.5);
      }
    }
    p.mark({padded});
    for (int v = 0; v < 212; ++v)
      for (int u = 0; u < 256; ++u)
        ASSERT_TRUE(shows[static_cast<std::size_t>(v * 256 + u)] == 0 || p.mask.at(u, v) == kBody)
            << n << ": " << u << ' ' << v;
  }
}

// ---- the youBot's arm

struct Arm {
  ArticulatedBody body{perception::load_robot(tests::in_tree("config/robots/youbot.toml")).value()};
  Pose X_CB;
  Arm() {
    Pose X_BC = Pose::Identity();
    perception::Mat3 forward;
    forward << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    X_BC.linear() =
        Eigen::AngleAxisd(30 * std::numbers::pi / 180, Vec3::UnitY()).toRotationMatrix() * forward;
    X_BC.translation() = Vec3(-0.2, 0, 0.95);
    X_CB = X_BC.inverse();
  }
  std::vector<Capsule> capsules(std::array<double, 5> deg, bool padded) const {
    std::array<double, 5> q, still{};
    for (std::size_t j = 0; j < 5; ++j) q[j] = deg[j] * std::numbers::pi / 180;
    ArticulatedBody::Links X;
    body.forward(q, X);
    std::vector<Capsule> out;
    for (int i = 0; i < body.capsules(); ++i) {
      const Capsule b = body.capsule_B(i, X);
      Capsule c{X_CB * b.a, X_CB * b.b, b.radius};
      if (padded)
        c.radius += perception::pad_of(c, body.reach_of_error(b, body.link_of(i), X, still, 0, 0),
                                       {}, kKinect);
      out.push_back(c);
    }
    return out;
  }
};

TEST(BodyMask, WithExactJointsTheAreaIsAtMostHalfMoreThanTheArms) {
  const Arm arm;
  double worst = 0;
  for (const std::array<double, 5>& pose : {std::array<double, 5>{169, 65, -146, 102.5, 167.5},
                                            {169, 110, -146, 102.5, 167.5},
                                            {169, 150, -150, 100, 167.5},
                                            {140, 130, -180, 160, 100},
                                            {200, 90, -100, 60, 30}}) {
    Picture bare(kKinect), padded(kKinect);
    const int area = bare.mark(arm.capsules(pose, false));
    const int masked = padded.mark(arm.capsules(pose, true));
    ASSERT_GT(area, 3000);
    for (int v = 0; v < 424; ++v)
      for (int u = 0; u < 512; ++u) ASSERT_LE(bare.mask.at(u, v), padded.mask.at(u, v));
    worst = std::max(worst, static_cast<double>(masked) / area);
  }
  std::printf("  masked / silhouette of the arm: %.3f at worst\n", worst);
  EXPECT_LE(worst, 1.5);
}

TEST(BodyMask, AllocatesNothingAndCostsLittle) {
  const Arm arm;
  Picture p(kKinect);
  const auto capsules = arm.capsules({169, 150, -150, 100, 167.5}, true);
  rt_guard::reset();
  {
    rt::Section section;
    (void)p.body.mark(capsules, p.k, p.depth_mm.view(), p.mask.view());
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
  std::vector<double> ms;
  for (int i = 0; i < 41; ++i) {
    timespec a{}, b{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
    (void)p.body.mark(capsules, p.k, p.depth_mm.view(), p.mask.view());
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
    ms.push_back(static_cast<double>(b.tv_sec - a.tv_sec) * 1e3 +
                 static_cast<double>(b.tv_nsec - a.tv_nsec) * 1e-6);
  }
  std::sort(ms.begin(), ms.end());
  std::printf("  body mask of the reaching arm: %.3f ms CPU (median of 41), %d pixels, %llu rays\n",
              ms[20], p.count(), static_cast<unsigned long long>(p.body.work()));
  EXPECT_GT(ms[20], 0);
}

// ---- a held object

TEST(HeldObject, ItsCapsulesHoldAllOfIt) {
  rt::Random rng(3);
  for (int n = 0; n < 200; ++n) {
    perception::HeldObject o;
    o.half = Vec3(rng.uniform(0.005, 0.1), rng.uniform(0.005, 0.1), rng.uniform(0.005, 0.1));
    o.X_GO.translation() = Vec3(rng.normal(), rng.normal(), rng.normal());
    o.X_GO.linear() = Eigen::Quaterniond(rng.normal(), rng.normal(), rng.normal(), rng.normal())
                          .normalized()
                          .toRotationMatrix();
    std::array<Capsule, perception::kCapsulesOfHeld> c;
    const int pieces = capsules_of(o, c);
    for (int i = 0; i < 200; ++i) {
      const Vec3 p(rng.uniform(-1, 1) * o.half.x(), rng.uniform(-1, 1) * o.half.y(),
                   (i % 2 == 0 ? 1 : -1) * o.half.z());
      double near = 1;
      for (int j = 0; j < pieces; ++j)
        near = std::min(near, distance(c[static_cast<std::size_t>(j)], o.X_GO * p));
      ASSERT_LE(near, 1e-9) << n;
    }
  }
  perception::HeldObject bad;
  EXPECT_FALSE(bad.plausible());  // no size
  bad.half = Vec3(0.1, std::nan(""), 0.1);
  EXPECT_FALSE(bad.plausible());
}

}  // namespace
