// Against truths that are known: exact ones to rounding, slipping ones within what is stated.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/unit/tool_robot/drives.hpp"

namespace tests {
namespace {

using teletact::fit_robot;
using teletact::RobotFit;
using teletact::RobotParameter;
using testing::HasSubstr;

rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

const teletact::DriveScript& script() {
  static const teletact::DriveScript s;
  return s;
}
Twist2 by_script(double t) { return script().at(t); }

std::string name(std::size_t i) { return teletact::name_of(static_cast<RobotParameter>(i)); }

// How far the twelve are off the truth, as changes of the stated model are counted.
std::array<double, teletact::kRobotParameters> errors_of(const RobotFit& fit,
                                                         const RobotModel& truth) {
  std::array<double, teletact::kRobotParameters> e{};
  Eigen::Vector4d share;
  for (int i = 0; i < 4; ++i)
    share[i] = fit.found.base.wheel_scale[i] / truth.base.wheel_scale[i] - 1;
  e[0] = (share[0] + share[1] + share[2] + share[3]) / 4;
  e[1] = (share[0] - share[1] + share[2] - share[3]) / 4;
  e[2] = (share[0] + share[1] - share[2] - share[3]) / 4;
  e[3] = (share[0] - share[1] - share[2] + share[3]) / 4;
  e[4] = fit.found.base.lever_scale / truth.base.lever_scale - 1;
  e[5] = fit.found.base.slide_scale / truth.base.slide_scale - 1;
  const Vec3 p = fit.found.X_BC.translation() - truth.X_BC.translation();
  const Eigen::AngleAxisd a(
      perception::Mat3(fit.found.X_BC.linear() * truth.X_BC.linear().transpose()));
  const Vec3 w = a.angle() * a.axis();
  for (std::size_t i = 0; i < 3; ++i) {
    e[6 + i] = p[static_cast<Eigen::Index>(i)];
    e[9 + i] = w[static_cast<Eigen::Index>(i)];
  }
  return e;
}

TEST(RobotFitExact, AnyTruthIsFound) {
  for (std::uint64_t seed = 1; seed <= 25; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    rt::Random random(seed);
    const RobotModel truth = any_model(random, 0.08, 0.15, 12);
    Pose X_WP = turned_by(any_vector(random, 1.5));
    X_WP.translation() = any_vector(random, 5);
    RobotDrive drive = exact_drive(truth, by_script, script().seconds(), X_WP);
    drive.floor.assign(5, floor_of(truth));
    const auto fit = fit_robot(drive, stated_model());
    ASSERT_TRUE(fit) << fit.error();
    const auto e = errors_of(fit.value(), truth);
    for (std::size_t i = 0; i < e.size(); ++i) {
      EXPECT_NEAR(e[i], 0, 1e-6) << name(i);
      EXPECT_TRUE(fit.value().parameters[i].constrained) << name(i);
    }
    EXPECT_EQ(fit.value().left_out, 0);
    EXPECT_EQ(fit.value().rank, 12);
    EXPECT_EQ(teletact::unconstrained(fit.value(), true), "");
    EXPECT_LT(fit.value().after_m_per_m, 1e-6);
    EXPECT_GT(fit.value().before_m_per_m, 1e-3);
  }
}

// What was calibrated before is where the next one starts from.
TEST(RobotFitExact, FromACalibratedRobotToItself) {
  rt::Random random(3);
  const RobotModel truth = any_model(random, 0.05, 0.1, 8);
  const RobotDrive drive = exact_drive(truth, by_script, script().seconds(), Pose::Identity());
  const auto fit = fit_robot(drive, truth);
  ASSERT_TRUE(fit) << fit.error();
  for (const double e : errors_of(fit.value(), truth)) EXPECT_NEAR(e, 0, 1e-7);
  EXPECT_LT(fit.value().before_m_per_m, 1e-7);
}

struct Tally {
  int drives = 0, beyond = 0, counted = 0;
  std::array<double, teletact::kRobotParameters> squares{};
  double radius_sum = 0, radius_most = 0, mm_sum = 0, mm_most = 0, deg_sum = 0, deg_most = 0;

  void add(const RobotFit& fit, const RobotModel& truth) {
    const auto e = errors_of(fit, truth);
    ++drives;
    for (std::size_t i = 0; i < e.size(); ++i) {
      if (!fit.parameters[i].constrained) continue;
      const double z = e[i] / fit.parameters[i].sigma;
      squares[i] += z * z;
      ++counted;
      beyond += std::abs(z) > 3 ? 1 : 0;
    }
    for (int i = 0; i < 4; ++i) {
      const double r = std::abs(fit.found.base.wheel_scale[i] / truth.base.wheel_scale[i] - 1);
      radius_sum += r / 4;
      radius_most = std::max(radius_most, r);
    }
    const double mm = 1e3 * Vec3(e[6], e[7], e[8]).norm(),
                 deg = Vec3(e[9], e[10], e[11]).norm() / kDeg;
    mm_sum += mm, deg_sum += deg;
    mm_most = std::max(mm_most, mm), deg_most = std::max(deg_most, deg);
  }
  void print(const char* what) const {
    std::printf(
        "  %s: %d drives; radii %.3f %% mean, %.3f %% at most; mount %.2f mm and %.3f deg mean, "
        "%.2f mm and %.3f deg at most; %d of %d beyond 3 sigma\n   ",
        what, drives, 100 * radius_sum / drives, 100 * radius_most, mm_sum / drives,
        deg_sum / drives, mm_most, deg_most, beyond, counted);
    for (std::size_t i = 0; i < squares.size(); ++i)
      std::printf(" %s %.2f", name(i).c_str(), std::sqrt(squares[i] / drives));
    std::printf(" (RMS of error over sigma)\n");
  }
};

drivers::RobotPlantConfig worn_plant(std::uint64_t seed, double slip) {
  rt::Random random(seed, 5);
  drivers::RobotPlantConfig plant;
  plant.wheel_slip_max = slip;
  plant.wheel_slip_seed = seed;
  plant.encoder_ticks_per_motor_turn = 4000;
  for (double& e : plant.wheel_radius_error) e = random.uniform(-0.02, 0.02);
  return plant;
}

// Of a drive whose wheels slip, mount and radii drawn by the seed.
void fit_slipping(std::uint64_t seed, double slip, const CameraNoise& noise, Tally& tally) {
  SCOPED_TRACE("seed " + std::to_string(seed));
  rt::Random random(seed, 9);
  const auto plant = worn_plant(seed, slip);
  RobotModel truth = any_model(random, 0, 0.05, 3);
  truth.base = effective_base(plant);
  RobotDrive drive = plant_drive(startup().token(), plant, stated_model(), truth.X_BC, by_script,
                                 script().seconds(), noise, seed);
  for (int i = 0; i < 60; ++i) {
    auto f = floor_of(truth);
    f.height_m += 0.002 * random.normal();
    f.up_C = turned_by(any_vector(random, 0.2 * kDeg)).linear() * f.up_C;
    drive.floor.push_back(f);
  }
  const auto fit = fit_robot(drive, stated_model());
  ASSERT_TRUE(fit) << fit.error();
  EXPECT_EQ(teletact::unconstrained(fit.value(), true), "");
  tally.add(fit.value(), truth);
}

// A slip of 2.9 % (one standard deviation) drawn anew 120 times a wheel leaves 0.26 % of a radius
// in doubt, whatever the estimate: no figure below can be much less.
TEST(RobotFitNoisy, SlippingWheelsAndANoisyCamera) {
  Tally tally;
  for (std::uint64_t seed = 1; seed <= 60; ++seed)
    fit_slipping(seed, 0.1, {0.003, 0.3, 0.15, 0}, tally);
  tally.print("slip 0 to 10 %, camera 3 mm and 0.3 deg, 15 % unclaimed");
  EXPECT_EQ(tally.drives, 60);
  // 0.3 % are to be expected beyond three sigma, and errors as large as stated.
  EXPECT_LE(tally.beyond, tally.counted / 50);
  for (std::size_t i = 0; i < tally.squares.size(); ++i) {
    const double rms = std::sqrt(tally.squares[i] / tally.drives);
    EXPECT_LT(rms, 1.4) << name(i);
    // The floor's plane is stated by rule, not by these data.
    if (i < 8) {
      EXPECT_GT(rms, 0.5) << name(i);
    }
  }
  EXPECT_LT(tally.radius_sum / tally.drives, 0.006);
  EXPECT_LT(tally.radius_most, 0.02);
  EXPECT_LT(tally.mm_sum / tally.drives, 8);
  EXPECT_LT(tally.deg_sum / tally.drives, 0.5);
}

// Wheels that hardly slip are found ten times as well: the estimate is as good as the drive.
TEST(RobotFitNoisy, WheelsThatHardlySlip) {
  Tally tally;
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    fit_slipping(seed, 0.005, {0.001, 0.05, 0, 0}, tally);
  tally.print("slip 0 to 0.5 %, camera 1 mm and 0.05 deg");
  EXPECT_LT(tally.radius_sum / tally.drives, 0.0006);
  EXPECT_LT(tally.mm_most, 5);
}

// Poses that are claimed and wrong are left out, and told of.
TEST(RobotFitNoisy, FalseClaimsAreLeftOut) {
  Tally tally, without;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    fit_slipping(seed, 0.1, {0.003, 0.3, 0, 0.05}, tally);
    fit_slipping(seed, 0.1, {0.003, 0.3, 0, 0}, without);
  }
  tally.print("5 % of the poses false");
  without.print("none false");
  EXPECT_LT(tally.mm_sum, 2 * without.mm_sum);
  EXPECT_LT(tally.radius_sum, 2 * without.radius_sum);
}

// ---- Drives that do not tell all

struct Degenerate {
  const char* what;
  Twists at;
  std::string missing;
};

TEST(RobotFitDegenerate, WhatADriveDoesNotTellIsNamedAndKept) {
  const auto sway = [](double t) { return std::sin(2 * std::numbers::pi * t / 10); };
  const std::vector<Degenerate> cases{
      // A camera that looks aside and wheels that crab are one: yaw and the diagonals need two
      // directions, or a turn.
      {"straight",
       [&](double t) {
         return Twist2{0.25 * sway(t), 0, 0};
       },
       "radii front against back, radii diagonally, lever of the turn, sideways slide, camera x, "
       "camera y, camera height, camera roll and camera yaw"},
      {"sideways",
       [&](double t) {
         return Twist2{0, 0.25 * sway(t), 0};
       },
       "mean wheel radius, radii left against right, radii diagonally, lever of the turn, sideways "
       "slide, camera x, camera y, camera height, camera pitch and camera yaw"},
      // The point about which it turns is the wheels' word, and where the camera is counts from
      // there.
      {"turning",
       [&](double t) {
         return Twist2{0, 0, 0.5 * sway(t)};
       },
       "mean wheel radius, radii left against right, radii front against back, radii diagonally, "
       "lever of the turn, sideways slide, camera x, camera y, camera height and camera yaw"},
      {"no turn",
       [&](double t) {
         return Twist2{0.25 * sway(t), 0.25 * sway(1.7 * t), 0};
       },
       "lever of the turn, camera x, camera y and camera height"},
  };
  for (const Degenerate& c : cases) {
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(std::string(c.what) + ", seed " + std::to_string(seed));
      rt::Random random(seed, 21);
      const RobotModel truth = any_model(random, 0.01, 0.02, 1);
      RobotDrive drive = exact_drive(truth, c.at, 60, Pose::Identity());
      for (auto& seen : drive.cameras) {
        seen.X_WC.translation() += 0.001 * Vec3(random.normal(), random.normal(), random.normal());
        seen.X_WC.linear() =
            seen.X_WC.linear() * turned_by(any_vector(random, 0.05 * kDeg)).linear();
      }
      const auto fit = fit_robot(drive, stated_model());
      ASSERT_TRUE(fit) << fit.error();
      EXPECT_EQ(teletact::unconstrained(fit.value(), true), c.missing);
      EXPECT_LT(fit.value().rank, 12);
      RobotFit nothing;
      nothing.found = stated_model();
      const auto e = errors_of(fit.value(), truth), before = errors_of(nothing, truth);
      for (std::size_t i = 0; i < e.size(); ++i) {
        const auto& p = fit.value().parameters[i];
        if (p.constrained) {
          EXPECT_LT(std::abs(e[i]), 5 * p.sigma + 3e-4) << name(i);
        } else {
          EXPECT_EQ(p.change, 0) << name(i);
          if (i >= 6) {
            EXPECT_NEAR(e[i], before[i], 0.02) << name(i);
          }
        }
      }
    }
  }
}

// With the floor in view height, roll and pitch are known of any drive.
TEST(RobotFitDegenerate, TheFloorTellsHeightAndTilt) {
  rt::Random random(4, 21);
  const RobotModel truth = any_model(random, 0.01, 0.02, 1);
  RobotDrive drive = exact_drive(
      truth,
      [](double t) {
        return Twist2{0.2 * std::sin(0.6 * t), 0, 0};
      },
      60, Pose::Identity());
  drive.floor.assign(10, floor_of(truth));
  const auto fit = fit_robot(drive, stated_model());
  ASSERT_TRUE(fit) << fit.error();
  for (const auto p : {RobotParameter::kZ, RobotParameter::kRoll, RobotParameter::kPitch})
    EXPECT_TRUE(fit.value().of(p).constrained) << teletact::name_of(p);
  EXPECT_NEAR(fit.value().found.X_BC.translation().z(), truth.X_BC.translation().z(), 1e-6);
}

TEST(RobotFitDegenerate, WhatIsNoDriveIsRefused) {
  const RobotModel truth = stated_model();
  const auto refusal = [&](const RobotDrive& d) {
    const auto fit = fit_robot(d, truth);
    EXPECT_FALSE(fit);
    return fit ? std::string() : fit.error();
  };
  const RobotDrive good = exact_drive(truth, by_script, script().seconds(), Pose::Identity());
  const auto standing = [](double) { return Twist2{}; };
  EXPECT_THAT(refusal(exact_drive(truth, standing, 60, Pose::Identity())),
              HasSubstr("hardly moved: 0.00 m and 0 degrees"));
  EXPECT_THAT(refusal(exact_drive(truth, by_script, 8, Pose::Identity())),
              HasSubstr("only 8.0 s with wheel angles and claimed camera poses, at least 20"));
  RobotDrive d = good;
  d.cameras.clear();
  EXPECT_THAT(refusal(d), HasSubstr("never claimed"));
  d = good;
  d.wheels.clear();
  EXPECT_THAT(refusal(d), HasSubstr("no wheel angles"));
  d = good;
  for (auto& w : d.wheels) w.t_s += 1000;  // another clock
  EXPECT_THAT(refusal(d), HasSubstr("no camera pose lies within the wheels' log"));
  d = good;
  d.cameras.erase(d.cameras.begin() + 100, d.cameras.end() - 10);
  EXPECT_THAT(refusal(d), HasSubstr("intervals of 1.0 s with claimed"));
  d = good;
  for (auto& w : d.wheels) std::swap(w.rad[0], w.rad[1]);
  EXPECT_THAT(refusal(d), HasSubstr("do not tell of the same drive"));
  d = good;
  for (auto& w : d.wheels) w.rad[2] = -w.rad[2];
  EXPECT_THAT(refusal(d), HasSubstr("order, signs and units"));
}

// ---- The drive itself

TEST(DriveScript, TakesAMinuteEndsWhereItBeganAndKeepsToItsRoom) {
  EXPECT_GT(script().seconds(), 50);
  EXPECT_LT(script().seconds(), 70);
  Pose2 X;
  double left = 0, right = 0, ahead = 0, aside = 0;
  const auto r = script().room();
  for (double t = 0; t < script().seconds(); t += 1e-3) {
    const Twist2 v = script().at(t);
    EXPECT_LE(std::hypot(v.vx, v.vy), teletact::DriveScript::kSpeed_m_per_s + 1e-9);
    EXPECT_LE(std::abs(v.wz), teletact::DriveScript::kTurn_rad_per_s + 1e-9);
    X = perception::integrate(X, v, 1e-3);
    (v.wz > 0 ? left : right) += std::abs(v.wz) * 1e-3;
    ahead += std::abs(v.vx) * 1e-3, aside += std::abs(v.vy) * 1e-3;
    EXPECT_GE(X.x, r.x_least_m - 0.01);
    EXPECT_LE(X.x, r.x_most_m + 0.01);
    EXPECT_GE(X.y, r.y_least_m - 0.01);
    EXPECT_LE(X.y, r.y_most_m + 0.01);
  }
  EXPECT_NEAR(std::hypot(X.x, X.y), 0, 0.01);
  EXPECT_NEAR(left, right, 0.01);
  EXPECT_GT(left, 2 * std::numbers::pi);
  EXPECT_GT(ahead, 3);
  EXPECT_GT(aside, 2);
  EXPECT_EQ(script().at(-1), Twist2{});
  EXPECT_EQ(script().at(1000), Twist2{});
}

TEST(MountAngles, AreThoseOfTheKeys) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    rt::Random random(seed);
    drivers::SyntheticCameraConfig c;
    c.mount_yaw_deg = random.uniform(-179, 179);
    c.mount_pitch_deg = random.uniform(-89, 89);
    c.mount_roll_deg = random.uniform(-179, 179);
    const auto a = teletact::mount_angles_deg(c.X_BC().linear());
    EXPECT_NEAR(a[0], c.mount_yaw_deg, 1e-9) << "seed " << seed;
    EXPECT_NEAR(a[1], c.mount_pitch_deg, 1e-9) << "seed " << seed;
    EXPECT_NEAR(a[2], c.mount_roll_deg, 1e-9) << "seed " << seed;
  }
  drivers::SyntheticCameraConfig down;
  down.mount_pitch_deg = 90;
  down.mount_yaw_deg = 20;
  const auto a = teletact::mount_angles_deg(down.X_BC().linear());
  EXPECT_NEAR(a[0], 20, 1e-6);
  EXPECT_NEAR(a[1], 90, 1e-6);
}

}  // namespace
}  // namespace tests
