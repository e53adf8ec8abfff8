#include <gtest/gtest.h>

#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

Intrinsics half_camera() { return {182.5, 182.5, 127.5, 105.5, 256, 212}; }

struct Errors {
  std::vector<double> depth_mm, normal_deg;
  int rays = 0, hits = 0, truth = 0, missed = 0, invented = 0;
};

Errors against(const Scene& scene, const RaycastMaps& m) {
  Errors e;
  for (int v = 0; v < m.height(); ++v)
    for (int u = 0; u < m.width(); ++u) {
      const auto truth =
          scene.cast(m.X_WC.translation(), m.X_WC.linear() * m.intrinsics.unproject(u, v, 1));
      const bool there = std::isfinite(truth.t);
      ++e.rays;
      e.truth += there;
      e.missed += there && !m.hit(u, v);
      e.invented += !there && m.hit(u, v);
      if (!m.hit(u, v)) continue;
      ++e.hits;
      for (int a = 0; a < 4; ++a) EXPECT_TRUE(std::isfinite(m.at(u, v)[a]));
      EXPECT_NEAR(m.normal_C(u, v).norm(), 1, 1e-5);
      EXPECT_LT(m.normal_C(u, v).dot(m.vertex_C(u, v)), 0);
      if (!there) continue;
      e.depth_mm.push_back(std::fabs(static_cast<double>(m.at(u, v)[3]) - truth.t) * 1e3);
      const Vec3 n = m.X_WC.linear() * m.normal_C(u, v).cast<double>();
      e.normal_deg.push_back(std::acos(std::clamp(n.dot(truth.normal), -1.0, 1.0)) * 57.2958);
    }
  return e;
}

TEST(Raycast, DepthMatchesTheClosedForm) {
  rt::Startup startup;
  struct Case {
    const char* name;
    Scene scene;
    double voxel, median_mm, p95_mm;
  };
  Scene plane, sphere;
  plane.planes = {{{1.5, 0, 0}, Vec3(-0.8, 0.6, 0).normalized()}};
  sphere.spheres = {{{1.3, 0, 0}, 0.4}};
  const Intrinsics k = half_camera();
  RaycastMaps maps(startup.token(), k.width, k.height);
  for (const Case& c :
       {Case{"plane", plane, 0.01, 0.6, 2.5}, Case{"plane", plane, 0.02, 0.6, 2.5},
        Case{"sphere", sphere, 0.01, 0.5, 2.0}, Case{"sphere", sphere, 0.02, 0.7, 4.0},
        Case{"room", room(), 0.02, 1.0, 8.0}}) {
    TsdfConfig config = small_map(c.voxel);
    config.max_blocks = 20000;
    TsdfMap map(startup.token(), config);
    const bool far = c.scene.planes.size() > 1;
    Pose X;
    for (int n = 0; n < 5; ++n) {
      X = far ? look_at(Vec3(-0.8 + 0.03 * n, -0.1 * n, 1.2), Vec3(1.4, 0.1, 0.7))
              : look_at(Vec3(0.02 * n, 0.03 * n - 0.05, 0.04 * n), Vec3(1.3, 0, 0));
      map.integrate(render(c.scene, k, X).view(), X, 1);
    }
    RaycastOptions o;
    o.smooth_normals = false;
    raycast(map, k, X, o, maps);
    const Errors cell = against(c.scene, maps);
    const auto stats = raycast(map, k, X, {}, maps);
    const Errors e = against(c.scene, maps);
    EXPECT_EQ(stats.hits, e.hits);
    EXPECT_EQ(stats.rays, e.rays);
    std::printf(
        "%s, %.0f mm: %d of %d missed, %d invented, |depth error| median %.2f p95 %.2f mm, normal "
        "median %.2f p95 %.2f deg "
        "(of the cell: %.2f, %.2f), %.1f steps a ray\n",
        c.name, c.voxel * 1e3, e.missed, e.truth, e.invented, quantile(e.depth_mm, 0.5),
        quantile(e.depth_mm, 0.95), quantile(e.normal_deg, 0.5), quantile(e.normal_deg, 0.95),
        quantile(cell.normal_deg, 0.5), quantile(cell.normal_deg, 0.95),
        static_cast<double>(stats.steps) / stats.rays);
    EXPECT_LT(quantile(e.depth_mm, 0.5), c.median_mm);
    EXPECT_LT(quantile(e.depth_mm, 0.95), c.p95_mm);
    EXPECT_LT(quantile(e.normal_deg, 0.5), 2.5);
    EXPECT_LT(quantile(e.normal_deg, 0.5), quantile(cell.normal_deg, 0.5));
    EXPECT_LT(e.missed, e.truth / 12);  // silhouettes: the band there is not a voxel wide
    EXPECT_LT(e.invented, e.truth / 50);
  }
}

// Steps of a twentieth of a voxel on the trilinear field: the first + to - between known points.
double march_slowly(MapReader& reader, const Pose& X, const Vec3& ray_C, double from, double to,
                    double step) {
  const Vec3 d = X.linear() * ray_C;
  bool outside = false;
  double before = 0, before_t = 0;
  for (double t = from; t < to; t += step) {
    const auto s = reader.sample(X.translation() + t * d);
    if (s.valid && s.distance_m <= 0 && outside)
      return before_t + (t - before_t) * before / (before - static_cast<double>(s.distance_m));
    outside = s.valid && s.distance_m > 0;
    if (outside) before = static_cast<double>(s.distance_m), before_t = t;
  }
  return 0;
}

TEST(Raycast, FindsWhatASlowMarcherFinds) {
  rt::Startup startup;
  for (const double voxel : {0.01, 0.02, 0.05}) {
    TsdfConfig config = small_map(voxel);
    config.max_blocks = 20000;
    TsdfMap map(startup.token(), config);
    const Intrinsics k{120, 120, 79.5, 59.5, 160, 120};
    for (int n = 0; n < 6; ++n) {
      const Pose X = look_at(Vec3(-0.8 + 0.02 * n, -0.05 * n, 1.2), Vec3(1.4, 0.1 * n - 0.2, 0.7));
      map.integrate(
          render(room(), k, X, 0.002, 0.03, rt::Random(4, static_cast<std::uint64_t>(n))).view(), X,
          1);
    }
    // From a place the map was never seen from: silhouettes, back sides, unknown space.
    const Pose X = look_at(Vec3(-0.4, 0.9, 1.6), Vec3(1.0, -0.3, 0.5));
    RaycastMaps maps(startup.token(), k.width, k.height);
    raycast(map, k, X, {}, maps);
    MapReader reader(map);
    int both = 0, neither = 0, only_fast = 0, only_slow = 0, differ = 0;
    std::vector<double> gap_mm;
    for (int v = 0; v < k.height; v += 2)
      for (int u = 0; u < k.width; u += 2) {
        const Vec3 ray = k.unproject(u, v, 1);
        const double slow = march_slowly(reader, X, ray, 0.1, 6, voxel / 20 / ray.norm());
        const double fast = static_cast<double>(maps.at(u, v)[3]);
        if (slow > 0 && fast > 0) {
          ++both;
          if (std::fabs(slow - fast) > voxel)
            ++differ;
          else
            gap_mm.push_back(std::fabs(slow - fast) * 1e3);
        } else if (fast > 0) {
          ++only_fast;
        } else if (slow > 0) {
          ++only_slow;
        } else {
          ++neither;
        }
      }
    const int all = both + neither + only_fast + only_slow;
    std::printf(
        "voxel %.0f mm: both %d (other surface %d), neither %d, only fast %d, only slow %d; |gap| "
        "median %.3f "
        "p99 %.3f mm\n",
        voxel * 1e3, both, differ, neither, only_fast, only_slow, quantile(gap_mm, 0.5),
        quantile(gap_mm, 0.99));
    EXPECT_GT(both, all / 3);
    EXPECT_LT(only_fast, all / 200);  // a surface no slow marcher sees would be a false one
    EXPECT_LT(only_slow, all / 25);   // slivers thinner than a voxel
    EXPECT_LT(differ, all / 25);
    EXPECT_LT(quantile(gap_mm, 0.5), voxel * 1e3 * 0.01);
    EXPECT_LT(quantile(gap_mm, 0.99), voxel * 1e3 * 0.15);
  }
}

TEST(Raycast, NoSurfaceFromBehindOrInTheUnknown) {
  rt::Startup startup;
  Scene scene;
  scene.planes = {{{1.5, 0, 0}, -Vec3::UnitX()}};
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = half_camera();
  RaycastMaps maps(startup.token(), k.width, k.height);
  const Pose X = look_at(Vec3::Zero(), Vec3::UnitX());
  EXPECT_EQ(raycast(map, k, X, {}, maps).hits, 0);  // an empty map
  map.integrate(render(scene, k, X).view(), X, 1);
  EXPECT_GT(raycast(map, k, X, {}, maps).hits, k.width * k.height * 9 / 10);
  EXPECT_EQ(raycast(map, k, look_at(Vec3(3, 0, 0), Vec3::Zero()), {}, maps).hits, 0);
  EXPECT_EQ(raycast(map, k, look_at(Vec3(1.52, 0, 0), Vec3(3, 0.1, 0)), {}, maps).hits,
            0);  // from within
  RaycastOptions heavy;
  heavy.min_weight = 2;
  EXPECT_EQ(raycast(map, k, X, heavy, maps).hits, 0);  // one observation only
  RaycastOptions beyond;
  beyond.min_depth_m = 1.6;
  EXPECT_EQ(raycast(map, k, X, beyond, maps).hits, 0);
  RaycastOptions before;
  before.max_depth_m = 1.4;
  EXPECT_EQ(raycast(map, k, X, before, maps).hits, 0);
}

TEST(Raycast, HintSkipsOnlyWhatLiesWellBeforeIt) {
  rt::Startup startup;
  Scene scene;
  scene.planes = {{{2, 0, 0}, -Vec3::UnitX()}};
  Scene with = scene;
  with.boxes = {{{1.2, -0.1, -0.1}, {1.3, 0.1, 0.1}}};
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = half_camera();
  const Pose X = look_at(Vec3::Zero(), Vec3::UnitX());
  map.integrate(render(scene, k, X).view(), X, 1);
  map.integrate(render(with, k, X).view(), X, 1);
  RaycastMaps plain(startup.token(), k.width, k.height), hinted(startup.token(), k.width, k.height);
  const auto hint_of = [&](const Scene& s) {
    const Frame f = render(s, k, X);
    Image<float> h(k.width, k.height);
    for (int i = 0; i < k.width * k.height; ++i)
      h.data()[i] = static_cast<float>(f.depth.data()[i]) * 1e-3F;
    return h;
  };
  const Image<float> same = hint_of(with), removed = hint_of(scene);
  RaycastOptions o;
  const auto full = raycast(map, k, X, o, plain);
  o.hint_depth_m = same.view();
  const auto fast = raycast(map, k, X, o, hinted);
  EXPECT_LT(fast.steps, full.steps);
  int differ = 0;
  for (int v = 3; v < k.height - 3; ++v)  // at the rim of the view cells come and go
    for (int u = 3; u < k.width - 3; ++u)
      differ += std::fabs(plain.at(u, v)[3] - hinted.at(u, v)[3]) > 0.002F;
  EXPECT_LT(differ, k.width * k.height / 100);
  const int u = k.width / 2, v = k.height / 2;
  EXPECT_NEAR(plain.at(u, v)[3], 1.2, 0.01);
  o.hint_depth_m =
      removed.view();  // the box is gone from the live image: its old surface is passed
  raycast(map, k, X, o, hinted);
  EXPECT_TRUE(hinted.at(u, v)[3] == 0 || hinted.at(u, v)[3] > 1.8F) << hinted.at(u, v)[3];
}

TEST(Raycast, EveryStepIsASubsetOfTheFullImage) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k{180, 180, 100, 70, 203, 141};
  const Pose X = look_at(Vec3(-0.8, 0, 1.2), Vec3(1.4, 0.1, 0.7));
  map.integrate(render(room(), k, X).view(true), X, 1);
  RaycastMaps full(startup.token(), k.width, k.height), thin(startup.token(), k.width, k.height);
  RaycastOptions o;
  o.colour = true;
  raycast(map, k, X, o, full);
  for (const int step : {2, 3, 4}) {
    o.pixel_step = step;
    const auto s = raycast(map, k, X, o, thin);
    EXPECT_EQ(s.rays, ((k.width + step - 1) / step) * ((k.height + step - 1) / step));
    int compared = 0, differ = 0;
    for (int v = 0; v < thin.height(); ++v)
      for (int u = 0; u < thin.width(); ++u) {
        const float a = thin.at(u, v)[3], b = full.at(u * step, v * step)[3];
        ++compared;
        differ += std::fabs(a - b) > 1e-3F;  // tiles differ, so rays may start elsewhere
        if (thin.hit(u, v) && full.hit(u * step, v * step) && std::fabs(a - b) < 1e-6F) {
          EXPECT_EQ(thin.colour().at(u, v), full.colour().at(u * step, v * step));
        }
      }
    EXPECT_LT(differ, compared / 100) << step;
  }
}

TEST(Raycast, RefusesWithoutTouchingMemory) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = half_camera();
  RaycastMaps maps(startup.token(), k.width / 2, k.height);
  EXPECT_EQ(raycast(map, k, Pose::Identity(), {}, maps).rays, 0);
  EXPECT_EQ(maps.width(), 0);
  RaycastOptions o;
  o.pixel_step = 2;
  EXPECT_GT(raycast(map, k, Pose::Identity(), o, maps).rays, 0);
  Pose bad = Pose::Identity();
  bad.translation().y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(raycast(map, k, bad, o, maps).rays, 0);
  o.pixel_step = 0;
  EXPECT_EQ(raycast(map, k, Pose::Identity(), o, maps).rays, 0);
  // Tall and thin, within the number of pixels: more tiles than a square has.
  RaycastMaps square(startup.token(), 64, 64);
  const Intrinsics thin{60, 60, 0, 2000, 1, 4096};
  const auto s = raycast(map, thin, Pose::Identity(), {}, square);
  EXPECT_TRUE(s.rays == 4096 || s.rays == 0);
}

TEST(Raycast, SameInputSameBytesAndNoAllocation) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Intrinsics k = half_camera();
  const Pose X = look_at(Vec3(-0.8, 0, 1.2), Vec3(1.4, 0.1, 0.7));
  map.integrate(render(room(), k, X, 0.002).view(true), X, 1);
  RaycastMaps a(startup.token(), k.width, k.height), b(startup.token(), k.width, k.height);
  RaycastOptions o;
  o.colour = true;
  rt_guard::reset();
  {
    rt::Section section;
    raycast(map, k, X, o, a);
  }
  if (rt_guard::linked()) {
    EXPECT_EQ(rt_guard::counts().total(), 0U);
  }
  raycast(map, k, X, o, b);
  const std::size_t n = static_cast<std::size_t>(k.width * k.height) * RaycastMaps::kStride;
  EXPECT_TRUE(std::equal(a.data(), a.data() + n, b.data()));
}

}  // namespace
}  // namespace tests
