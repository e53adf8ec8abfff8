// Tracking against rendered depth with known motion, and its sums against brute force.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <iostream>
#include <limits>
#include <numbers>

#include "perception/icp/normal_equations.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/simd/isa.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

using tests::AnalyticScene;

constexpr double kDegree = std::numbers::pi / 180;

struct Rig {
  rt::Startup startup;
  Intrinsics k = tests::small_camera();
  TrackerConfig config;
  Tracker tracker{startup.token(), config, k.width, k.height};
  std::vector<float> records;
  ModelView model;
  std::vector<std::uint16_t> mm;

  Rig() = default;
  explicit Rig(const TrackerConfig& c) : config(c) {}
  void cast(const AnalyticScene& scene, const Pose& X_WF) {
    records = tests::cast_model(scene, k, X_WF);
    model = {records.data(), k, X_WF};
  }
  void see(const AnalyticScene& scene, const Pose& X_WC, double sigma_m, rt::Random& random,
           int pixel_step = 1) {
    mm = tests::to_mm(tests::cast_depth(scene, k, X_WC), sigma_m, random);
    tracker.prepare({mm.data(), k.width, k.height, k.width}, k, pixel_step);
  }
  TrackingResult track(const MotionPrior& prior) {
    TrackingResult out;
    rt_guard::reset();
    {
      rt::Section section;
      tracker.track(model, prior, config.iterations, out);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    return out;
  }
};

double translation_mm(const Pose& a, const Pose& b) {
  return 1000 * (a.translation() - b.translation()).norm();
}
double rotation_deg(const Pose& a, const Pose& b) {
  return rotation_angle(a.linear().transpose() * b.linear()) / kDegree;
}

TEST(Tracker, RecoversKnownMotionInARoom) {
  const AnalyticScene room = tests::test_room();
  for (const double sigma : {0.0, 0.0015}) {
    double worst_mm = 0, worst_deg = 0;
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      rt::Random random(seed);
      Rig rig;
      const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
      const Pose X_WC = X_WF * tests::random_motion(random, 0.03, 1.2 * kDegree);
      rig.cast(room, X_WF);
      rig.see(room, X_WC, sigma, random);
      const TrackingResult r = rig.track({X_WF});
      EXPECT_EQ(r.state, TrackingState::kTracking) << "seed " << seed;
      EXPECT_TRUE(r.claimed) << "seed " << seed;
      EXPECT_EQ(r.degenerate_count, 0);
      EXPECT_LT(r.condition, 1000);
      worst_mm = std::max(worst_mm, translation_mm(r.X_WC, X_WC));
      worst_deg = std::max(worst_deg, rotation_deg(r.X_WC, X_WC));
    }
    std::cout << "noise " << sigma * 1000 << " mm: worst error " << worst_mm << " mm, " << worst_deg
              << " deg\n";
    EXPECT_LT(worst_mm, sigma > 0 ? 0.5 : 0.2);
    EXPECT_LT(worst_deg, sigma > 0 ? 0.02 : 0.01);
  }
}

// Beyond the basin of attraction a frame may fail, but it must say so.
TEST(Tracker, LargeMotionIsNeverSilentlyWrong) {
  const AnalyticScene room = tests::test_room();
  int claimed = 0, wrong = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    rt::Random random(seed, 17);
    Rig rig;
    const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
    const Pose X_WC = X_WF * tests::random_motion(random, 0.20, 10 * kDegree);
    rig.cast(room, X_WF);
    rig.see(room, X_WC, 0.0015, random);
    const TrackingResult r = rig.track({X_WF});
    if (!r.claimed) continue;
    ++claimed;
    if (translation_mm(r.X_WC, X_WC) > 50) {
      ++wrong;
      std::cout << "seed " << seed << ": " << translation_mm(r.X_WC, X_WC) << " mm off, share "
                << r.inlier_share << " overlap " << r.overlap << " condition " << r.condition
                << " residual " << r.residual_m << '\n';
    }
  }
  std::cout << claimed << " of 40 large motions claimed, " << wrong << " of them wrong\n";
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(claimed, 5);
}

TEST(Tracker, SmallerVariantsStayAccurate) {
  const AnalyticScene room = tests::test_room();
  for (const int step : {2, 4}) {
    double worst_mm = 0;
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      rt::Random random(seed, 7);
      Rig rig;
      const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
      const Pose X_WC = X_WF * tests::random_motion(random, 0.03, 1.2 * kDegree);
      rig.cast(room, X_WF);
      rig.see(room, X_WC, 0.0015, random, step);
      const TrackingResult r = rig.track({X_WF});
      if (r.state == TrackingState::kLost)
        continue;  // too few pixels at a quarter of this small image
      worst_mm = std::max(worst_mm, translation_mm(r.X_WC, X_WC));
    }
    std::cout << "pixel step " << step << ": worst " << worst_mm << " mm\n";
    EXPECT_LT(worst_mm, 4.0);
  }
}

TEST(Tracker, SameInputSameBytes) {
  const AnalyticScene room = tests::test_room();
  rt::Random random(3);
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  const Pose X_WC = X_WF * tests::random_motion(random, 0.03, 0.02);
  Rig a, b;
  a.cast(room, X_WF);
  b.cast(room, X_WF);
  rt::Random na(4), nb(4);
  a.see(room, X_WC, 0.002, na);
  b.see(room, X_WC, 0.002, nb);
  const TrackingResult ra = a.track({X_WF}), rb = b.track({X_WF});
  const TrackingResult again = a.track({X_WF});
  for (const TrackingResult* r : {&rb, &again}) {
    EXPECT_EQ(std::memcmp(ra.X_WC.data(), r->X_WC.data(), 16 * sizeof(double)), 0);
    EXPECT_EQ(ra.residual_m, r->residual_m);
    EXPECT_EQ(ra.work, r->work);
  }
}

// ---------------------------------------------------------------- degenerate scenes

AnalyticScene wall() {
  AnalyticScene s;
  s.planes = {{Vec3(1.2, 0, 0), -Vec3::UnitX()}};
  return s;
}

// A model of the wall as a fused map would have it: depths and normals with noise of their own.
void roughen(std::vector<float>& records, double sigma_m, double sigma_n, rt::Random& random) {
  for (std::size_t i = 0; i < records.size(); i += kModelStride) {
    if (records[i + 3] <= 0) continue;
    Vec3 n(records[i], records[i + 1], records[i + 2]);
    n = (n + sigma_n * Vec3(random.normal(), random.normal(), random.normal())).normalized();
    records[i + 3] += static_cast<float>(sigma_m * random.normal());
    for (std::size_t j = 0; j < 3; ++j) records[i + j] = static_cast<float>(n(static_cast<int>(j)));
  }
}

TEST(Tracker, FlatWallReportsThreeDirectionsAndDoesNotDrift) {
  const AnalyticScene scene = wall();
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    rt::Random random(seed);
    Rig rig;
    const Pose X_WF = tests::look_at(Vec3(0, 0, 0.5), Vec3(1.2, 0.1, 0.45));
    rig.cast(scene, X_WF);
    roughen(rig.records, 0.0005, 0.01, random);
    // The camera slides 5 mm along the wall and 4 mm towards it; the prior says it stood still.
    Pose X_WC = X_WF;
    X_WC.translation() += Vec3(0.004, 0.005, 0);
    rig.see(scene, X_WC, 0.0015, random);
    const TrackingResult r = rig.track({X_WF});
    EXPECT_EQ(r.degenerate_count, 3) << "seed " << seed;
    EXPECT_FALSE(r.claimed);
    EXPECT_FALSE(r.fully_constrained);
    EXPECT_EQ(r.state, TrackingState::kWeak);
    EXPECT_GT(r.condition, 1000);
    const Vec3 moved = r.X_WC.translation() - X_WF.translation();
    EXPECT_NEAR(moved.x(), 0.004, 0.0005) << "the wall does say this";
    EXPECT_LT(std::hypot(moved.y(), moved.z()), 0.0005) << "no drift along the wall";
    // Spin about the wall's normal is not taken from noise either.
    const Mat3 R = r.X_WC.linear() * X_WF.linear().transpose();
    EXPECT_LT(std::abs(Eigen::AngleAxisd(R).angle() * Eigen::AngleAxisd(R).axis().x()), 2e-4);
    // The reported space is spanned by the two slides and the spin.
    for (int i = 0; i < 3; ++i) {
      const Vec6 d = r.degenerate_W.col(i);
      EXPECT_LT(std::abs(d(0)), 0.15) << "towards the wall is seen";
      EXPECT_LT(std::hypot(d(4), d(5)), 0.15) << "tilt is seen";
    }
  }
}

TEST(Tracker, OdometryClaimsWhatTheWallDoesNotSay) {
  const AnalyticScene scene = wall();
  rt::Random random(9);
  Rig rig;
  const Pose X_WF = tests::look_at(Vec3(0, 0, 0.5), Vec3(1.2, 0, 0.5));
  rig.cast(scene, X_WF);
  Pose X_WC = X_WF;
  X_WC.translation() += Vec3(0.003, 0.006, 0);
  rig.see(scene, X_WC, 0.0015, random);
  MotionPrior prior{X_WF, MotionPrior::Source::kOdometry, 0.004, 0.2};
  prior.X_WC.translation() += Vec3(0, 0.006, 0);  // odometry knows the slide
  const TrackingResult r = rig.track(prior);
  EXPECT_TRUE(r.claimed);
  EXPECT_FALSE(r.fully_constrained);
  EXPECT_LT(translation_mm(r.X_WC, X_WC), 1.0);
  prior.sigma_translation_m = 0.011;
  EXPECT_FALSE(rig.track(prior).claimed);
  prior.sigma_translation_m = 0.004;
  prior.sigma_rotation_deg = 0.6;
  EXPECT_FALSE(rig.track(prior).claimed);
  prior.sigma_rotation_deg = 0.2;
  prior.source = MotionPrior::Source::kConstantVelocity;
  EXPECT_FALSE(rig.track(prior).claimed);
}

TEST(Tracker, TwoWallsLeaveOneSlide) {
  AnalyticScene scene;
  scene.planes = {{Vec3(1.2, 0, 0), Vec3(-1, 0.8, 0).normalized()},
                  {Vec3(1.2, 0, 0), Vec3(-1, -0.8, 0).normalized()}};
  rt::Random random(2);
  Rig rig;
  const Pose X_WF = tests::look_at(Vec3(0, 0, 0.5), Vec3(1.2, 0, 0.5));
  rig.cast(scene, X_WF);
  rig.see(scene, X_WF, 0.0015, random);
  const TrackingResult r = rig.track({X_WF});
  ASSERT_EQ(r.degenerate_count, 1);
  EXPECT_GT(std::abs(r.degenerate_W(2, 0)), 0.95) << "up and down along the edge";
}

// Each pose is made from the last one, ten thousand times: it stays a rotation and a translation.
TEST(Tracker, PoseStaysRigidOverTenThousandUpdates) {
  const AnalyticScene room = tests::test_room();
  const Intrinsics k{40, 40, 27.5, 22.5, 56, 46};
  TrackerConfig config;
  config.lost_inliers = 50;
  rt::Startup startup;
  Tracker tracker(startup.token(), config, k.width, k.height);
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  const auto records = tests::cast_model(room, k, X_WF);
  rt::Random random(21);
  const auto mm = tests::to_mm(tests::cast_depth(room, k, X_WF), 0.0015, random);
  tracker.prepare({mm.data(), k.width, k.height, k.width}, k, 1);
  const Pose step = tests::random_motion(random, 0.002, 0.003);
  Pose X_WM = X_WF, X_WC = X_WF;  // the model travels with the estimate: nothing pulls it back
  double worst = 0;
  int tracked = 0;
  for (int i = 0; i < 10000; ++i) {
    TrackingResult r;
    tracker.track({records.data(), k, X_WM}, {X_WC * step}, {1, 1, 2}, r);
    tracked += r.state != TrackingState::kLost ? 1 : 0;
    X_WM = X_WC = r.X_WC;
    const Mat3 R = X_WC.linear();
    worst = std::max({worst, (R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff(),
                      std::abs(R.determinant() - 1)});
  }
  std::cout << "worst departure from a rotation " << worst << " over " << tracked << " updates\n";
  EXPECT_GT(tracked, 9900);
  EXPECT_LE(worst, 1e-9);
}

// ---------------------------------------------------------------- sums

// Plain double-precision loop with residuals differentiated numerically.
NormalEquations reference_sums(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                               const Vec3& centre, const Gates& gates, Mat6* cross) {
  NormalEquations eq;
  for (int v = 0; v < live.depth.height(); ++v) {
    for (int u = 0; u < live.depth.width(); ++u) {
      const auto z = static_cast<double>(live.depth.row(v)[u]);
      if (z <= 0) continue;
      ++eq.live;
      const Vec3 q = X_FC * live.intrinsics.unproject(u, v, z);
      if (q.z() <= 0.05) continue;
      const Eigen::Vector2d px = model.intrinsics.project(q) + Eigen::Vector2d(0.5, 0.5);
      const int iu = static_cast<int>(std::floor(px.x())),
                iv = static_cast<int>(std::floor(px.y()));
      if (iu < 0 || iv < 0 || iu >= model.intrinsics.width || iv >= model.intrinsics.height)
        continue;
      const float* r = model.at(iu, iv);
      const Vec3 n(r[0], r[1], r[2]), m = model.intrinsics.unproject(iu, iv, r[3]);
      if (!(n.squaredNorm() > 0.5)) continue;
      ++eq.met;
      const Vec3 l = X_FC.linear() * Vec3(live.nx.row(v)[u], live.ny.row(v)[u], live.nz.row(v)[u]);
      if ((q - m).norm() >= static_cast<double>(gates.distance_m)) continue;
      if (l.dot(n) <= static_cast<double>(gates.normal_cos)) continue;
      ++eq.inliers;
      const double beyond = std::max(0.0, z - static_cast<double>(gates.noise.from_m));
      const double least = static_cast<double>(gates.noise.least_m);
      const double sigma = least + static_cast<double>(gates.noise.per_m2) * beyond * beyond;
      const double w = std::pow(least / sigma, 2);
      const auto residual = [&](const Vec6& xi, const Vec3& normal) {
        return normal.dot(centre + exp_se3(xi) * (q - centre) - m);
      };
      Vec6 J, L;
      for (int i = 0; i < 6; ++i) {
        Vec6 d = Vec6::Zero();
        d(i) = 1e-6;
        J(i) = (residual(d, n) - residual(-d, n)) / 2e-6;
        L(i) = (residual(d, l) - residual(-d, l)) / 2e-6;
      }
      const double r0 = residual(Vec6::Zero(), n);
      eq.H += w * J * J.transpose();
      eq.g += w * J * r0;
      eq.r2 += w * r0 * r0;
      eq.weight += w;
      if (cross != nullptr) *cross += 0.5 * w * (L * J.transpose() + J * L.transpose());
    }
  }
  return eq;
}

TEST(NormalEquations, EqualNumericJacobiansSummedInDouble) {
  const AnalyticScene room = tests::test_room();
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    rt::Random random(seed, 3);
    Rig rig;
    const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
    rig.cast(room, X_WF);
    rig.see(room, X_WF * tests::random_motion(random, 0.03, 0.03), 0.002, random);
    const Pose X_FC = tests::random_motion(random, 0.02, 0.02);
    const Vec3 centre(0.05, -0.02, 1.7);
    const Gates gates{0.1F, 0.85F, {0.002F, 0.005F, 1.5F}};
    for (int level = 0; level < 3; ++level) {
      NormalEquations eq;
      CrossMoment cross;
      Mat6 cross_reference = Mat6::Zero();
      accumulate_cross(rig.tracker.pyramid().level(level), rig.model, X_FC, centre, gates, eq,
                       cross);
      const NormalEquations ref = reference_sums(rig.tracker.pyramid().level(level), rig.model,
                                                 X_FC, centre, gates, &cross_reference);
      // A few points lie on a rounding border of a pixel or a gate and fall either way.
      EXPECT_EQ(eq.live, ref.live);
      EXPECT_NEAR(static_cast<double>(eq.inliers), static_cast<double>(ref.inliers),
                  4 + 1e-3 * static_cast<double>(ref.inliers));
      EXPECT_LT((eq.H - ref.H).norm(), 3e-3 * ref.H.norm())
          << "seed " << seed << " level " << level;
      EXPECT_LT((eq.g - ref.g).norm(), 5e-3 * ref.g.norm() + 1e-3);
      EXPECT_NEAR(eq.r2, ref.r2, 1e-2 * ref.r2);
      EXPECT_LT((cross.H - cross_reference).norm(), 3e-3 * cross_reference.norm());
      NormalEquations plain;
      accumulate(rig.tracker.pyramid().level(level), rig.model, X_FC, centre, gates, plain);
      EXPECT_EQ(plain.H, eq.H);
      EXPECT_EQ(plain.g, eq.g);
    }
  }
}

TEST(NormalEquations, EveryInstructionSetGivesTheSameBytes) {
  const AnalyticScene room = tests::test_room();
  rt::Random random(8);
  Rig rig;
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  rig.cast(room, X_WF);
  rig.see(room, X_WF, 0.002, random);
  Pose X_FC = Pose::Identity();
  X_FC.linear() = Eigen::AngleAxisd(0.02, Vec3(0.3, 0.8, -0.1).normalized()).toRotationMatrix();
  X_FC.translation() = Vec3(0.01, -0.004, 0.006);
  const Gates gates{0.1F, 0.85F, {0.002F, 0.005F, 1.5F}};
  for (int l = 0; l < TrackingPyramid::kLevels; ++l) {
    std::vector<NormalEquations> sums;
    std::vector<CrossMoment> crosses;
    for (const simd::Isa isa : simd::available()) {
      ASSERT_TRUE(simd::choose(isa));
      NormalEquations plain;
      accumulate(rig.tracker.pyramid().level(l), rig.model, X_FC, Vec3(0, 0, 1.7), gates, plain);
      accumulate_cross(rig.tracker.pyramid().level(l), rig.model, X_FC, Vec3(0, 0, 1.7), gates,
                       sums.emplace_back(), crosses.emplace_back());
      EXPECT_GT(sums.back().inliers, 100);
      EXPECT_LT(sums.back().inliers, sums.back().met) << "the gates cut some";
      EXPECT_EQ(plain.H, sums.back().H) << simd::name_of(isa);
      EXPECT_EQ(sums.back().H, sums.front().H) << simd::name_of(isa);
      EXPECT_EQ(sums.back().g, sums.front().g) << simd::name_of(isa);
      EXPECT_EQ(sums.back().r2, sums.front().r2) << simd::name_of(isa);
      EXPECT_EQ(sums.back().weight, sums.front().weight) << simd::name_of(isa);
      EXPECT_EQ(sums.back().inliers, sums.front().inliers) << simd::name_of(isa);
      EXPECT_EQ(sums.back().met, sums.front().met) << simd::name_of(isa);
      EXPECT_EQ(sums.back().on_surface, sums.front().on_surface) << simd::name_of(isa);
      EXPECT_EQ(sums.back().live, sums.front().live) << simd::name_of(isa);
      EXPECT_EQ(crosses.back().H, crosses.front().H) << simd::name_of(isa);
    }
  }
  ASSERT_TRUE(simd::choose("auto"));
}

// ---------------------------------------------------------------- bad input

TEST(Tracker, AnotherSceneIsLost) {
  const AnalyticScene room = tests::test_room();
  rt::Random random(1);
  Rig rig;
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  rig.cast(room, X_WF);
  AnalyticScene other;
  other.planes = {{Vec3(1.0, 0, 0), Vec3(-1, 0.9, 0.7).normalized()}};
  rig.see(other, X_WF, 0, random);
  const TrackingResult r = rig.track({X_WF});
  EXPECT_EQ(r.state, TrackingState::kLost);
  EXPECT_FALSE(r.claimed);
  EXPECT_EQ(std::memcmp(r.X_WC.data(), X_WF.data(), 16 * sizeof(double)), 0) << "lost: the prior";
}

TEST(Tracker, EmptyImageAndEmptyModelAreLost) {
  const AnalyticScene room = tests::test_room();
  rt::Random random(1);
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  Rig rig;
  rig.cast(room, X_WF);
  rig.see(room, X_WF, 0, random);
  EXPECT_EQ(rig.track({X_WF}).state, TrackingState::kTracking);
  std::fill(rig.mm.begin(), rig.mm.end(), std::uint16_t{0});
  rig.tracker.prepare({rig.mm.data(), rig.k.width, rig.k.height, rig.k.width}, rig.k, 1);
  EXPECT_EQ(rig.track({X_WF}).state, TrackingState::kLost);
  rig.see(room, X_WF, 0, random);
  std::fill(rig.records.begin(), rig.records.end(), 0.0F);
  EXPECT_EQ(rig.track({X_WF}).state, TrackingState::kLost);
  rig.model = ModelView{};
  EXPECT_EQ(rig.track({X_WF}).state, TrackingState::kLost);
  MotionPrior nan{X_WF};
  nan.X_WC.translation().x() = std::numeric_limits<double>::quiet_NaN();
  rig.cast(room, X_WF);
  EXPECT_EQ(rig.track(nan).state, TrackingState::kLost);
}

TEST(Tracker, NanInTheModelIsSkippedNotSummed) {
  const AnalyticScene room = tests::test_room();
  rt::Random random(6);
  const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));
  const Pose X_WC = X_WF * tests::random_motion(random, 0.02, 0.02);
  Rig rig;
  rig.cast(room, X_WF);
  for (std::size_t i = 0; i < rig.records.size(); i += 7 * kModelStride) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    std::fill_n(rig.records.begin() + static_cast<std::ptrdiff_t>(i), kModelStride, nan);
  }
  rig.see(room, X_WC, 0, random);
  const TrackingResult r = rig.track({X_WF});
  EXPECT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT(translation_mm(r.X_WC, X_WC), 1.0);
}

}  // namespace
}  // namespace perception
