// The renderer against World::ray_cast, its noise against the stated model, and its determinism.
#include "drivers/camera/render.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <memory>

#include "perception/geometry/no_colour.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_camera/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using camera_test::base_pose;
using camera_test::load_world;
using camera_test::startup;
using drivers::DepthNoise;
using drivers::DepthNoiseConfig;
using drivers::DepthRange;
using drivers::RenderScratch;
using drivers::SyntheticCameraConfig;
using drivers::World;
using drivers::WorldConfig;
using perception::Intrinsics;
using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

DepthNoise make_noise(const DepthNoiseConfig& c) { return DepthNoise(startup.token(), c); }

std::uint64_t hash_of(const RgbdFrame& f) {
  rt::Hash64 h;
  const std::size_t n = static_cast<std::size_t>(f.intrinsics.width * f.intrinsics.height);
  h.bytes(f.depth_mm.data(), n * sizeof f.depth_mm[0]);
  h.bytes(f.colour.data(), n * sizeof f.colour[0]);
  return h.digest();
}

struct Rig {
  explicit Rig(World w) : world(std::move(w)), scratch(startup.token(), world.shapes().size()) {}
  const RgbdFrame& shoot(const Intrinsics& k, const Pose& X_WC, const DepthNoise& noise = {},
                         std::uint64_t seq = 0, const DepthRange& range = {}) {
    render(world, k, X_WC, range, noise, 42, seq, scratch, *frame);
    return *frame;
  }
  World world;
  RenderScratch scratch;
  std::unique_ptr<RgbdFrame> frame = std::make_unique<RgbdFrame>();
};

std::string name(char kind, int i) {
  std::string s(1, kind);
  s += static_cast<char>('0' + i);
  return s;
}

// Every pixel of every view equals the ray cast of the world: depth to the rounding, colour
// exactly.
void expect_truth(Rig& rig, const Intrinsics& k, const Pose& X_WC, const DepthRange& range) {
  const RgbdFrame& f = rig.shoot(k, X_WC, {}, 0, range);
  int other_colour = 0, other_depth = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const Vec3 d = X_WC.linear() * Vec3((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
      const auto hit = rig.world.ray_cast(X_WC.translation(), d);
      const double z = hit ? hit.t : 0;
      const int got = f.depth().at(u, v);
      // Not decided: within float rounding of a range limit or of half a millimetre.
      if (std::abs(z - range.min_m) < 1e-6 || std::abs(z - range.max_m) < 1e-6) continue;
      const int want = z >= range.min_m && z <= range.max_m ? static_cast<int>(z * 1000 + 0.5) : 0;
      if (got != want && std::abs(z * 1000 + 0.5 - std::round(z * 1000 + 0.5)) > 1e-3)
        ++other_depth;
      ASSERT_LE(std::abs(got - want), other_depth > 2 ? 1 : 60000) << u << " " << v << " z " << z;
      if (hit && f.rgb().at(u, v) != hit.colour) ++other_colour;
    }
  }
  EXPECT_LE(other_depth, 2);    // a ray that just touches a silhouette may go either way
  EXPECT_LE(other_colour, 20);  // a hit within rounding of a cell's border
}

TEST(Render, EqualsRayCastInTheShippedScenes) {
  const SyntheticCameraConfig camera;
  for (const char* scene : {"default_room.toml", "corridor.toml", "empty_room.toml"}) {
    SCOPED_TRACE(scene);
    Rig rig(load_world(scene));
    expect_truth(rig, camera.intrinsics(), camera.X_BC(), {});
    expect_truth(rig, camera.intrinsics(), base_pose(0.5, -0.2, 0.4) * camera.X_BC(), {});
  }
}

TEST(Render, EqualsRayCastInRandomWorlds) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE(::testing::Message() << "seed " << seed);
    rt::Random rng(seed, 5);
    WorldConfig c;
    if (seed % 3 != 0) c.room.x_m = {-3, 3}, c.room.y_m = {-3, 3};
    const auto place = [&rng](std::array<double, 3>& p) {
      p = {rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(0, 1.5)};
    };
    const char* textures[] = {"plain", "checker", "noise"};
    for (int i = 0; i < 4; ++i) {
      auto& b = c.boxes.emplace_back();
      b.name = name('b', i);
      place(b.position_m);
      b.size_m = {rng.uniform(0.02, 0.8), rng.uniform(0.02, 0.8), rng.uniform(0.02, 0.8)};
      b.yaw_deg = rng.uniform(-180, 180), b.pitch_deg = rng.uniform(-90, 90);
      b.paint.texture = textures[i % 3];
      auto& y = c.cylinders.emplace_back();
      y.name = name('c', i);
      place(y.position_m);
      y.radius_m = rng.uniform(0.02, 0.4), y.height_m = rng.uniform(0.05, 1);
      auto& s = c.spheres.emplace_back();
      s.name = name('s', i);
      place(s.position_m);
      s.radius_m = rng.uniform(0.02, 0.4);
      auto& r = c.capsules.emplace_back();
      r.name = name('r', i);
      place(r.from_m), place(r.to_m);
      if (i == 3) r.to_m = r.from_m;
      r.radius_m = rng.uniform(0.02, 0.2);
      r.paint.texture = textures[i % 3];
    }
    Rig rig(World(startup.token(), c));
    Pose X = Pose::Identity();
    do {
      X.translation() = Vec3(rng.uniform(-2.5, 2.5), rng.uniform(-2.5, 2.5), rng.uniform(0.2, 2));
    } while (rig.world.signed_distance(X.translation()) < 0.05);
    X.linear() = Eigen::Quaterniond(rng.normal(), rng.normal(), rng.normal(), rng.normal())
                     .normalized()
                     .toRotationMatrix();
    // An odd size: tiles at the right and lower border are cut.
    expect_truth(rig, {150, 160, 70.3, 58.1, 147, 117}, X, {0.1, 8.0});
  }
}

// Shapes that are there for one image are seen as if they stood in the world, and leave nothing
// behind.
TEST(Render, CarriedShapesAreSeenAsIfTheyStoodThere) {
  WorldConfig c;
  auto& b = c.boxes.emplace_back();
  b.name = "box", b.position_m = {0, 0, 2}, b.size_m = {1, 1, 0.1};
  WorldConfig with = c;
  auto& r = with.capsules.emplace_back();
  r.name = "rod", r.from_m = {-0.3, 0.1, 1.2}, r.to_m = {0.2, -0.2, 0.9}, r.radius_m = 0.07;
  Rig bare(World(startup.token(), c)), whole(World(startup.token(), with));
  const Intrinsics k{150, 150, 80, 60, 160, 120};
  const auto want = hash_of(whole.shoot(k, Pose::Identity()));
  const auto empty = hash_of(bare.shoot(k, Pose::Identity()));
  EXPECT_NE(want, empty);
  bare.scratch = RenderScratch(startup.token(), 2);
  const auto rod = whole.world.shapes().subspan(1);
  render(bare.world, k, Pose::Identity(), {}, {}, 42, 0, bare.scratch, *bare.frame,
         World::kBeginning, rod);
  EXPECT_EQ(hash_of(*bare.frame), want);
  EXPECT_EQ(hash_of(bare.shoot(k, Pose::Identity())), empty);
}

TEST(Render, CoversTheLargestImage) {
  Rig rig(load_world("default_room.toml"));
  const SyntheticCameraConfig camera;
  expect_truth(rig, {450, 450, 319.5, 239.5, 640, 480}, camera.X_BC(), {});
}

TEST(Render, EmptyWorldIsBlackAndWithoutReading) {
  Rig rig(World(startup.token(), {}));
  const RgbdFrame& f = rig.shoot({100, 100, 50, 50, 100, 100}, Pose::Identity());
  for (int i = 0; i < 10000; ++i) ASSERT_EQ(f.depth_mm[static_cast<std::size_t>(i)], 0);
}

TEST(Render, ABlackThingHasAColourAndNothingHasNone) {
  WorldConfig c;
  auto& ball = c.spheres.emplace_back();
  ball.name = "ball";
  ball.position_m = {0, 0, 2};
  ball.radius_m = 0.5;
  ball.paint = {{0, 0, 0}, "plain", 0.05, 0};
  Rig rig(World(startup.token(), c));
  const RgbdFrame& f = rig.shoot({100, 100, 50, 50, 101, 101}, Pose::Identity());
  int seen = 0;
  for (std::size_t i = 0; i < 101 * 101; ++i) {
    seen += f.depth_mm[i] != 0 ? 1 : 0;
    ASSERT_EQ(f.colour[i], f.depth_mm[i] != 0 ? perception::kBlack : perception::kNoColour);
  }
  EXPECT_GT(seen, 1000);
}

TEST(Render, SameArgumentsSameBytes) {
  Rig a(load_world("default_room.toml")), b(load_world("default_room.toml"));
  const SyntheticCameraConfig camera;
  const DepthNoise noise = make_noise({1.0, 0.3, 0.4, 0.2});
  const auto k = camera.intrinsics();
  const auto first = hash_of(a.shoot(k, camera.X_BC(), noise, 7));
  (void)a.shoot(k, base_pose(0.3, 0, 0.2) * camera.X_BC(), noise, 8);  // leaves nothing behind
  EXPECT_EQ(first, hash_of(a.shoot(k, camera.X_BC(), noise, 7)));
  EXPECT_EQ(first, hash_of(b.shoot(k, camera.X_BC(), noise, 7)));
  EXPECT_NE(first, hash_of(b.shoot(k, camera.X_BC(), noise, 8)));
}

TEST(Render, AllocatesAndLocksNothing) {
  Rig rig(load_world("default_room.toml"));
  const SyntheticCameraConfig camera;
  const DepthNoise noise = make_noise({1.0, 0.3, 0.4, 0.2});
  rt_guard::reset();
  {
    rt::Section section;
    (void)rig.shoot(camera.intrinsics(), camera.X_BC(), noise, 1);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

// ---- noise -----------------------------------------------------------------------------------

TEST(Noise, WhatIsNotNamedIsNotConstructed) {
  config::Section root;
  SyntheticCameraConfig c;
  c.describe(root.section("camera"));
  ASSERT_TRUE(config::load_text("[camera.noise]\naxial = 1.0\n", "t", root).has_value());
  const DepthNoise one = make_noise(c.noise);
  EXPECT_EQ(one.constructed(), std::vector<std::string>{"axial"});
  EXPECT_EQ(one.lateral(), nullptr);
  EXPECT_EQ(one.dropout(), nullptr);
  EXPECT_EQ(one.flying(), nullptr);
  config::Section bare;
  SyntheticCameraConfig d;
  d.describe(bare.section("camera"));
  ASSERT_TRUE(config::load_text("[camera]\nseed = 3\n", "t", bare).has_value());
  EXPECT_TRUE(make_noise(d.noise).constructed().empty());
  // ... and changes nothing: a frame without any equals one with a default-made noise.
  Rig rig(load_world("default_room.toml"));
  const auto plain = hash_of(rig.shoot(d.intrinsics(), d.X_BC()));
  EXPECT_EQ(plain, hash_of(rig.shoot(d.intrinsics(), d.X_BC(), make_noise(d.noise), 0)));
}

TEST(Noise, NormalTableHasTheMomentsOfANormal) {
  const drivers::NormalTable normal;
  rt::Random rng(3);
  constexpr int kN = 4000000;
  double m1 = 0, m2 = 0, m4 = 0;
  int beyond2 = 0, beyond3 = 0;
  for (int i = 0; i < kN; ++i) {
    const double x = static_cast<double>(normal(static_cast<std::uint32_t>(rng() >> 32U)));
    m1 += x, m2 += x * x, m4 += x * x * x * x;
    beyond2 += std::abs(x) > 2, beyond3 += std::abs(x) > 3;
  }
  EXPECT_NEAR(m1 / kN, 0, 0.002);
  EXPECT_NEAR(m2 / kN, 1, 0.004);
  EXPECT_NEAR(m4 / kN, 3, 0.05);
  EXPECT_NEAR(beyond2 / (kN * 0.0455003), 1, 0.02);
  EXPECT_NEAR(beyond3 / (kN * 0.0026998), 1, 0.06);
  // Knots are quantiles: the median and the quartile.
  EXPECT_EQ(normal(0x80000000U), 0.0F);
  EXPECT_NEAR(normal(0xc0000000U), 0.67448975, 1e-6);
}

// A wall at distance z that fills the view, many frames: std of the reading against the model.
TEST(Noise, AxialSigmaIsTheModelsWithin5Percent) {
  const DepthNoise noise = make_noise({1.0, 0, 0, 0});
  for (const double z : {0.5, 1.0, 2.0, 3.0, 4.0}) {
    WorldConfig c;
    auto& p = c.planes.emplace_back();
    p.name = "wall", p.point_m = {0, 0, z}, p.normal = {0, 0, -1};
    Rig rig(World(startup.token(), c));
    double sum = 0, square = 0;
    int n = 0;
    for (std::uint64_t seq = 0; seq < 10; ++seq) {
      const RgbdFrame& f =
          rig.shoot({100, 100, 49.5, 49.5, 100, 100}, Pose::Identity(), noise, seq);
      for (int i = 0; i < 10000; ++i) {
        const double e = f.depth_mm[static_cast<std::size_t>(i)] - z * 1000;
        sum += e, square += e * e, ++n;
      }
    }
    const double variance = square / n - (sum / n) * (sum / n) - 1.0 / 12;  // less the rounding
    const double sigma = 1000 * drivers::kinect_v2_sigma_m(z);
    EXPECT_NEAR(std::sqrt(variance) / sigma, 1, 0.05) << "z " << z;
    EXPECT_NEAR(sum / n, 0, 0.05 * sigma);
  }
}

TEST(Noise, AxialIsIndependentBetweenPixelsRowsAndFrames) {
  WorldConfig c;
  auto& p = c.planes.emplace_back();
  p.name = "wall", p.point_m = {0, 0, 3}, p.normal = {0, 0, -1};
  Rig rig(World(startup.token(), c));
  const DepthNoise noise = make_noise({2.0, 0, 0, 0});
  const Intrinsics k{100, 100, 99.5, 99.5, 200, 200};
  const RgbdFrame first = rig.shoot(k, Pose::Identity(), noise, 1);
  const RgbdFrame& next = rig.shoot(k, Pose::Identity(), noise, 2);
  double right = 0, down = 0, time = 0, own = 0;
  const auto e = [](const RgbdFrame& f, int u, int v) { return f.depth().at(u, v) - 3000.0; };
  for (int v = 0; v < 199; ++v) {
    for (int u = 0; u < 199; ++u) {
      own += e(first, u, v) * e(first, u, v);
      right += e(first, u, v) * e(first, u + 1, v);
      down += e(first, u, v) * e(first, u, v + 1);
      time += e(first, u, v) * e(next, u, v);
    }
  }
  for (const double r : {right / own, down / own, time / own}) EXPECT_NEAR(r, 0, 0.02);
}

// On a wall seen at an angle a sideways shift of s pixels changes the depth by s dz/du: the std of
// the reading gives the shift's.
TEST(Noise, LateralJitterHasItsSigma) {
  const double sigma_px = 0.5;
  const DepthNoise noise = make_noise({0, sigma_px, 0, 0});
  WorldConfig c;
  auto& p = c.planes.emplace_back();
  p.name = "wall", p.point_m = {0, 0, 2}, p.normal = {-std::sin(1.0), 0, -std::cos(1.0)};
  Rig rig(World(startup.token(), c));
  const Intrinsics k{200, 200, 49.5, 49.5, 100, 100};
  double square = 0;
  int n = 0;
  for (std::uint64_t seq = 0; seq < 10; ++seq) {
    const RgbdFrame& f = rig.shoot(k, Pose::Identity(), noise, seq);
    for (int v = 0; v < 100; ++v) {
      for (int u = 30; u < 70; ++u) {
        // Plane n.p = d: 1/z = (n.x (u - cx)/f + n.z) / d.
        const double x = (u - k.cx) / k.fx, nx = std::sin(1.0), nz = std::cos(1.0), d = 2 * nz;
        const double z = d / (nx * x + nz), dz_du = -z * z * nx / (k.fx * d);
        const double shift = (f.depth().at(u, v) / 1000.0 - z) / dz_du;
        square += shift * shift, ++n;
      }
    }
  }
  EXPECT_NEAR(std::sqrt(square / n) / sigma_px, 1, 0.05);
}

struct EdgeCount {
  int near = 0, far = 0, between = 0, none = 0, edge_pixels = 0;
};
// A square in front of a wall: what the pixels beside its silhouette read.
EdgeCount count_edges(const DepthNoise& noise, int frames) {
  WorldConfig c;
  auto& p = c.planes.emplace_back();
  p.name = "wall", p.point_m = {0, 0, 3}, p.normal = {0, 0, -1};
  auto& b = c.boxes.emplace_back();
  b.name = "box", b.size_m = {0.5, 0.5, 0.02}, b.position_m = {0, 0, 1.01};
  Rig rig(World(startup.token(), c));
  const Intrinsics k{200, 200, 99.5, 99.5, 200, 200};
  const RgbdFrame truth = rig.shoot(k, Pose::Identity());
  EdgeCount count;
  for (int i = 0; i < frames; ++i) {
    const RgbdFrame& f = rig.shoot(k, Pose::Identity(), noise, static_cast<std::uint64_t>(i));
    for (int v = 1; v < 199; ++v) {
      for (int u = 1; u < 199; ++u) {
        const int here = truth.depth().at(u, v), z = f.depth().at(u, v);
        const bool edge = truth.depth().at(u - 1, v) != here ||
                          truth.depth().at(u + 1, v) != here ||
                          truth.depth().at(u, v - 1) != here || truth.depth().at(u, v + 1) != here;
        if (!edge) {
          EXPECT_EQ(z, here);  // away from edges nothing happens
          continue;
        }
        ++count.edge_pixels;
        (z == 0 ? count.none : z <= 1000 ? count.near : z >= 3000 ? count.far : count.between)++;
      }
    }
  }
  return count;
}

TEST(Noise, EdgeDropoutTakesItsShareOfEdgePixelsOnly) {
  const EdgeCount c = count_edges(make_noise({0, 0, 0.3, 0}), 40);
  ASSERT_GT(c.edge_pixels, 20000);
  EXPECT_NEAR(static_cast<double>(c.none) / c.edge_pixels, 0.3, 0.015);
  EXPECT_EQ(c.between, 0);
}

TEST(Noise, FlyingPixelsLieBetweenTheTwoSides) {
  const EdgeCount c = count_edges(make_noise({0, 0, 0, 0.2}), 40);
  EXPECT_NEAR(static_cast<double>(c.between) / c.edge_pixels, 0.2, 0.01);
  EXPECT_EQ(c.none, 0);
  const EdgeCount both = count_edges(make_noise({0, 0, 0.3, 0.2}), 40);
  EXPECT_NEAR(static_cast<double>(both.none) / both.edge_pixels, 0.3, 0.015);
  EXPECT_NEAR(static_cast<double>(both.between) / both.edge_pixels, 0.2 * 0.7, 0.01);
}

TEST(Noise, AGrazingFloorIsNoEdge) {
  Rig rig(load_world("empty_room.toml"));
  const SyntheticCameraConfig camera;
  const RgbdFrame truth = rig.shoot(camera.intrinsics(), camera.X_BC(), {}, 0, {0.4, 12});
  const RgbdFrame& f =
      rig.shoot(camera.intrinsics(), camera.X_BC(), make_noise({0, 0, 1.0, 0}), 0, {0.4, 12});
  int lost = 0;
  for (int i = 0; i < 512 * 424; ++i) {
    lost += truth.depth_mm[static_cast<std::size_t>(i)] != 0 &&
            f.depth_mm[static_cast<std::size_t>(i)] == 0;
  }
  EXPECT_LT(lost, 20);
}

// ---- cost ------------------------------------------------------------------------------------

TEST(Render, CostIsPrinted) {
  Rig rig(load_world("default_room.toml"));
  const SyntheticCameraConfig camera;
  const auto measure = [&](const char* what, const Intrinsics& k, const DepthNoise& noise) {
    std::vector<double> ms;
    for (std::uint64_t i = 0; i < 15; ++i) {
      timespec a{}, b{};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
      (void)rig.shoot(k, camera.X_BC(), noise, i);
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
      ms.push_back(static_cast<double>(b.tv_sec - a.tv_sec) * 1e3 +
                   static_cast<double>(b.tv_nsec - a.tv_nsec) * 1e-6);
    }
    std::sort(ms.begin(), ms.end());
    std::printf("  render %-34s %6.2f ms CPU (median of 15)\n", what, ms[7]);
    return ms[7];
  };
  SyntheticCameraConfig half;
  half.resolution = "half";
  const auto full_k = camera.intrinsics(), half_k = half.intrinsics();
  (void)measure("512x424, no noise", full_k, {});
  (void)measure("512x424, axial", full_k, make_noise({1, 0, 0, 0}));
  (void)measure("512x424, lateral", full_k, make_noise({0, 0.3, 0, 0}));
  (void)measure("512x424, dropout + flying", full_k, make_noise({0, 0, 0.3, 0.1}));
  const double all = measure("512x424, all four", full_k, make_noise({1, 0.3, 0.3, 0.1}));
  (void)measure("256x212, all four", half_k, make_noise({1, 0.3, 0.3, 0.1}));
  EXPECT_GT(all, 0);
}

}  // namespace
