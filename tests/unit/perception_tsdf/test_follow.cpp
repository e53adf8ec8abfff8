// A map that follows what moves slowly, keeps the noise of what stands, and does not run after the
// camera's errors.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <vector>

#include "tests/support/whole.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

// A plate of 0.3 m before a wall and over a floor, its face across x = `face`.
Scene plate(double face, double thick = 0.1) {
  Scene s;
  s.planes = {{{1.5, 0, 0}, -Vec3::UnitX()}, {{0, 0, -0.45}, Vec3::UnitZ()}};
  s.boxes = {{{face, -0.15, -0.15}, {face + thick, 0.15, 0.15}}};
  return s;
}

// Looked at from 1 m, `slant_deg` off the face's normal; a little elsewhere in every frame.
Pose eye(int n, double slant_deg) {
  const double a = slant_deg * 3.14159265 / 180;
  const Vec3 jitter(0.004 * std::sin(1.3 * n), 0.004 * std::cos(2.1 * n),
                    0.004 * std::sin(0.7 * n));
  return look_at(Vec3(1 - std::cos(a), std::sin(a), 0.1) + jitter, Vec3(1, 0, 0) + 0.5 * jitter);
}

std::uint64_t env_or(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::strtoull(text, nullptr, 10) : otherwise;
}

double kinect_v2_sigma_m(double z) { return 1e-3 * std::max(1.2, 1.5 - 0.5 * z + 0.3 * z * z); }

// A Kinect v2's noise: along the axis, and the place in the image off by 0.3 px.
Frame seen(const Scene& scene, const Pose& X_WC, std::uint64_t seed, int n) {
  const Intrinsics k = kinect2();
  rt::Random random(seed, static_cast<std::uint64_t>(n));
  Frame f{k, Image<std::uint16_t>(k.width, k.height), Image<Rgb>(k.width, k.height)};
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const double du = 0.3 * random.normal(), dv = 0.3 * random.normal(), axial = random.normal();
      const auto hit =
          scene.cast(X_WC.translation(), X_WC.linear() * k.unproject(u + du, v + dv, 1));
      if (!std::isfinite(hit.t)) continue;
      const double z = hit.t + axial * kinect_v2_sigma_m(hit.t);
      f.depth.at(u, v) = static_cast<std::uint16_t>(std::lround(1000 * z));
    }
  return f;
}

struct Watched {
  std::uint64_t seed;
  rt::Startup startup;
  double slant_deg, voxel;
  TsdfMap map;
  int frame = 0, moved = 0;

  Watched(double voxel_m, bool follow, std::uint64_t seed_, double slant = 20)
      : seed(seed_), slant_deg(slant), voxel(voxel_m), map(startup.token(), [&] {
          TsdfConfig c = small_map(voxel_m);
          c.follow = follow;
          return c;
        }()) {}
  void see(const Scene& scene) { take(seen(scene, eye(frame, slant_deg), seed, frame)); }
  // `said_off`: what the map is told of where the camera is, from where it is.
  void take(const Frame& f, const Vec3& said_off = Vec3::Zero()) {
    Pose said = eye(frame++, slant_deg);
    said.translation() += said_off;
    const IntegrateStats out = map.integrate(f.view(), said, 1);
    ASSERT_FALSE(out.refused);
    moved += out.blocks_moved;
  }
  void see(const Scene& scene, int frames) {
    for (int n = 0; n < frames; ++n) see(scene);
  }
  // x of the zero crossings over the plate, `within` of its middle, at most 60 mm off `near`.
  [[nodiscard]] std::vector<double> face(double near, double within = 0.1) const {
    std::vector<double> out;
    const int half = static_cast<int>(within / voxel);
    for (int j = -half; j <= half; ++j)
      for (int l = -half; l <= half; ++l)
        for (int i = ifloor_(near - 0.06); i < ifloor_(near + 0.06); ++i) {
          const std::uint32_t a = map.word_at(i, j, l), b = map.word_at(i + 1, j, l);
          const double da = TsdfMap::word_distance(a), db = TsdfMap::word_distance(b);
          if (TsdfMap::word_weight(a) < 256 || TsdfMap::word_weight(b) < 256 || da <= 0 || db > 0)
            continue;
          out.push_back(voxel * (i + da / (da - db)));
          break;
        }
    return out;
  }
  [[nodiscard]] int ifloor_(double x) const { return static_cast<int>(std::floor(x / voxel)); }
  // Mean of them; NaN where a fifth is missing.
  [[nodiscard]] double mean(double near) const {
    const std::vector<double> x = face(near);
    const int half = static_cast<int>(0.1 / voxel);
    if (static_cast<double>(x.size()) < 0.8 * (2 * half + 1) * (2 * half + 1)) return std::nan("");
    double sum = 0;
    for (const double v : x) sum += v;
    return sum / static_cast<double>(x.size());
  }
  [[nodiscard]] double rms(double truth) const {
    double sum = 0;
    const std::vector<double> x = face(truth);
    for (const double v : x) sum += (v - truth) * (v - truth);
    return std::sqrt(sum / static_cast<double>(x.size()));
  }
};

// The same image for both.
void see_both(Watched& a, Watched& b, const Scene& scene, const Vec3& said_off = Vec3::Zero()) {
  ASSERT_TRUE(a.frame == b.frame && a.seed == b.seed && a.slant_deg == b.slant_deg);
  const Frame f = seen(scene, eye(a.frame, a.slant_deg), a.seed, a.frame);
  a.take(f, said_off), b.take(f, said_off);
}

struct Lag {
  double most_mm = 0, end_mm = 0;
};
// Stands for 30 frames, moves by 90 mm or for 40 frames, stands for 20 frames.
Lag lag_of(Watched& w, double speed_m_s) {
  Lag out;
  double x = 1.05;
  w.see(plate(x), 30);
  const double step = speed_m_s / 30;
  const int frames = std::min(40, static_cast<int>(0.09 / std::abs(step)));
  for (int n = 0; n < frames; ++n) {
    x += step;
    w.see(plate(x));
    const double lag = 1e3 * std::abs(w.mean(x) - x);
    if (!(lag <= out.most_mm)) out.most_mm = lag;
  }
  w.see(plate(x), 20);
  out.end_mm = 1e3 * std::abs(w.mean(x) - x);
  return out;
}

TEST(Follow, ASlowSurfaceLagsBy3FramesAnd1500umAtMost) {
  const std::uint64_t first = env_or("TELETACT_FOLLOW_SEED", 1000);
  std::uint64_t seed = first;
  for (const double voxel : {0.01, 0.02})
    for (const double slant : {20.0, 60.0})
      for (const double mm_s : {3.0, 10.0, 30.0, 50.0, 100.0}) {
        const double sign = (++seed & 1U) != 0 ? 1 : -1;  // both ways, by the seed
        if (!whole() && (seed - first) % 3 != 1)
          continue;  // a third: each value of each of the three
        Watched w(voxel, true, seed, slant);
        const Lag lag = lag_of(w, 1e-3 * sign * mm_s);
        std::printf("%.0f mm, %.0f deg, %+.0f mm/s: lag %.2f mm, at rest %.2f mm\n", 1e3 * voxel,
                    slant, sign * mm_s, lag.most_mm, lag.end_mm);
        EXPECT_LE(lag.most_mm, 3 * mm_s / 30 + 1.5) << "seed " << seed;
        EXPECT_LE(lag.end_mm, 1.5) << "seed " << seed;
      }
  Watched plain(0.01, false, first);
  EXPECT_GT(lag_of(plain, 0.05).most_mm, 20) << "what a mean of a hundred does";
}

TEST(Follow, WhatStandsKeepsItsNoise) {
  for (const double voxel : {0.01, 0.02})
    for (const double slant : {20.0, 70.0}) {
      Watched w(voxel, true, 7, slant), plain(voxel, false, 7, slant);
      for (int n = 0; n < 50; ++n) see_both(w, plain, plate(1.05));
      std::printf("%.0f mm, %.0f deg: rms %.4f mm, %.4f without, %d blocks moved\n", 1e3 * voxel,
                  slant, 1e3 * w.rms(1.05), 1e3 * plain.rms(1.05), w.moved);
      EXPECT_LE(w.rms(1.05), 1.05 * plain.rms(1.05));
      EXPECT_LE(w.moved, 2);
    }
}

// What the camera's pose is off by is off in the whole image: nothing of it is taken for a motion
// of things.
TEST(Follow, ACameraThatDriftsIsNotRunAfter) {
  for (const double voxel : {0.01, 0.02})
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(-0.6, 0, 0.8)}) {
      Watched w(voxel, true, 9), plain(voxel, false, 9);
      for (int n = 0; n < 20; ++n) see_both(w, plain, plate(1.05));
      double apart_mm = 0;
      for (int n = 1; n <= 20; ++n) {
        see_both(w, plain, plate(1.05), 1e-3 * n * way);
        apart_mm = std::max(apart_mm, 1e3 * std::abs(w.mean(1.05) - plain.mean(1.05)));
      }
      std::printf("%.0f mm, drift (%.1f %.1f %.1f) mm a frame: %.2f mm apart, %d blocks moved\n",
                  1e3 * voxel, way.x(), way.y(), way.z(), apart_mm, w.moved);
      EXPECT_LE(apart_mm, 0.5);
    }
}

// A plate that fills most of the image moves: what is seen round it does not.
TEST(Follow, WhatStandsIsNotMovedByTheMajority) {
  const auto big = [](double x) {
    Scene s = plate(x);
    s.boxes[0].lo = Vec3(x, -0.62, -0.4);
    s.boxes[0].hi = Vec3(x + 0.1, 0.62, 0.4);
    return s;
  };
  Watched w(0.02, true, 4), plain(0.02, false, 4);
  double x = 1.05;
  for (int n = 0; n < 20; ++n) see_both(w, plain, big(x));
  for (int n = 0; n < 12; ++n) {
    x -= 0.002;
    see_both(w, plain, big(x));
  }
  // Beside the plate, the wall.
  double sum[2] = {}, count[2] = {};
  for (int j = -60; j <= 60; ++j)
    for (int l = -12; l <= 40; ++l)
      for (int i = 70; i < 80; ++i)
        for (const int k : {0, 1}) {
          const TsdfMap& m = k == 0 ? w.map : plain.map;
          const double da = TsdfMap::word_distance(m.word_at(i, j, l)),
                       db = TsdfMap::word_distance(m.word_at(i + 1, j, l));
          if (TsdfMap::word_weight(m.word_at(i, j, l)) < 256 || da <= 0 || db > 0 ||
              TsdfMap::word_weight(m.word_at(i + 1, j, l)) < 256)
            continue;
          sum[k] += 0.02 * (i + da / (da - db)), ++count[k];
        }
  ASSERT_GT(count[0], 50);
  EXPECT_NEAR(sum[0] / count[0], sum[1] / count[1], 1e-3);
}

// What a camera goes round: where it stands in frame n.
struct Round {
  const char* name;
  Scene scene;
  double start_deg, deg_a_frame, up;  // of its way about z; above the middle, m
  std::uint64_t seed;
  [[nodiscard]] Pose eye(int n) const {
    const double a = (start_deg + deg_a_frame * n) * 3.14159265 / 180;
    return look_at(Vec3(1 - std::cos(a), std::sin(a), up), Vec3(1, 0, 0));
  }
};

Scene one_box(const Vec3& lo, const Vec3& hi) {
  Scene s;
  s.planes = {{{1.8, 0, 0}, -Vec3::UnitX()}, {{0, 0, -0.45}, Vec3::UnitZ()}};
  s.boxes = {{lo, hi}};
  return s;
}

// Changes of sign in the box's place and 60 mm round it, those within 6 mm of a true surface and
// the others.
struct Crossings {
  int true_ones = 0, others = 0;
};
Crossings crossings(const Watched& of, const Scene& scene) {
  Crossings out;
  int lo[3], hi[3];
  for (int a = 0; a < 3; ++a)
    lo[a] = of.ifloor_(scene.boxes[0].lo(a) - 0.06),
    hi[a] = of.ifloor_(scene.boxes[0].hi(a) + 0.06);
  for (int i = lo[0]; i <= hi[0]; ++i)
    for (int j = lo[1]; j <= hi[1]; ++j)
      for (int l = lo[2]; l <= hi[2]; ++l)
        for (int axis = 0; axis < 3; ++axis) {
          const std::uint32_t a = of.map.word_at(i, j, l),
                              b = of.map.word_at(i + (axis == 0), j + (axis == 1), l + (axis == 2));
          if (TsdfMap::word_weight(a) < 256 || TsdfMap::word_weight(b) < 256) continue;
          const double da = TsdfMap::word_distance(a), db = TsdfMap::word_distance(b);
          if ((da > 0) == (db > 0)) continue;
          const Vec3 at = of.voxel * (Vec3(i, j, l) + da / (da - db) * Vec3::Unit(axis));
          ++(std::abs(scene.distance(at)) < 6e-3 ? out.true_ones : out.others);
        }
  return out;
}

// Gone round, thin plates, edges and corners have their faces and rims where a plain mean has them.
TEST(Follow, ThinWallsAndEdgesStay) {
  const Scene table = one_box({0.9, -0.4, -0.14}, {1.5, 0.4, -0.1});
  const Scene cube = one_box({0.95, -0.1, -0.1}, {1.15, 0.1, 0.1});
  const std::vector<Round> rounds{{"plate 30 mm, half round", plate(1.0, 0.03), 0, 1.9, 0.1, 6},
                                  {"plate 20 mm, half round", plate(1.0, 0.02), 0, 1.9, 0.1, 16},
                                  {"plate 50 mm, half round", plate(1.0, 0.05), 0, 1.9, 0.1, 26},
                                  {"plate 30 mm, slowly", plate(1.0, 0.03), 50, 0.6, 0.1, 36},
                                  {"plate 20 mm, slowly", plate(1.0, 0.02), 70, 0.3, 0.1, 46},
                                  {"table's edge", table, -60, 1.3, 0.5, 56},
                                  {"table's edge, slowly", table, -20, 0.4, 0.3, 66},
                                  {"cube's corner", cube, -80, 1.7, 0.4, 76},
                                  {"cube's corner, slowly", cube, 20, 0.5, 0.4, 86}};
  for (const Round& r : whole_or(rounds, {0, 4, 6, 7})) {
    Watched w(0.01, true, r.seed), plain(0.01, false, r.seed);
    for (int n = 0; n < 95; ++n) {
      const Frame f = seen(r.scene, r.eye(n), r.seed, n);
      w.moved += w.map.integrate(f.view(), r.eye(n), 1).blocks_moved;
      plain.map.integrate(f.view(), r.eye(n), 1);
    }
    const Crossings with = crossings(w, r.scene), without = crossings(plain, r.scene);
    std::printf("%s: %d true crossings, %d without; %d others, %d without; %d blocks moved\n",
                r.name, with.true_ones, without.true_ones, with.others, without.others, w.moved);
    const int all = with.true_ones + with.others, were = without.true_ones + without.others;
    EXPECT_NEAR(all, were, 0.02 * were) << r.name;
    EXPECT_GE(with.true_ones, 0.98 * without.true_ones) << r.name;
  }
}

}  // namespace
}  // namespace tests
