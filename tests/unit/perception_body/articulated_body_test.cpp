// The description of the robot and where its links are, against matrices multiplied out by hand.
#include "perception/geometry/articulated_body.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/support/paths.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using perception::ArticulatedBody;
using perception::RobotDescription;
using perception::Vec3;
using ::testing::HasSubstr;

constexpr double kDeg = std::numbers::pi / 180;

RobotDescription youbot() {
  auto r = perception::load_robot(tests::in_tree("config/robots/youbot.toml"));
  if (!r) throw std::runtime_error(r.error());
  return std::move(r).value();
}

// ---- oracle: 4 x 4 matrices as arrays, the numbers of the URDF (youbot_description), in degrees

using Matrix = std::array<std::array<double, 4>, 4>;

Matrix product(const Matrix& a, const Matrix& b) {
  Matrix c{};
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t k = 0; k < 4; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}
Matrix shift(double x, double y, double z) {
  return {{{1, 0, 0, x}, {0, 1, 0, y}, {0, 0, 1, z}, {0, 0, 0, 1}}};
}
Matrix about_y(double a) {
  const double c = std::cos(a), s = std::sin(a);
  return {{{c, 0, s, 0}, {0, 1, 0, 0}, {-s, 0, c, 0}, {0, 0, 0, 1}}};
}
Matrix about_z(double a) {
  const double c = std::cos(a), s = std::sin(a);
  return {{{c, -s, 0, 0}, {s, c, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};
}
// X_B5, with the joints as the URDF counts them.
Matrix flange(const std::array<double, 5>& q) {
  Matrix X = shift(0, 0, 0.084);
  for (const Matrix& step :
       {shift(0.143, 0, 0.046), shift(0.024, 0, 0.096), about_z(170 * kDeg), about_z(-q[0]),
        shift(0.033, 0, 0.019), about_y(-65 * kDeg), about_y(q[1]), shift(0, 0, 0.155),
        about_y(146 * kDeg), about_y(q[2]), shift(0, 0, 0.135), about_y(-102.5 * kDeg),
        about_y(q[3]), shift(-0.002, 0, 0.130), about_z(167.5 * kDeg), about_z(-q[4])})
    X = product(X, step);
  return X;
}

TEST(ArticulatedBody, YoubotEqualsTheMatricesOfItsUrdf) {
  const ArticulatedBody body(youbot());
  ASSERT_EQ(body.joints().size(), 5U);
  const int tip = body.find("arm_5");
  ASSERT_GE(tip, 0);
  rt::Random rng(11);
  ArticulatedBody::Links X_BL;
  for (int n = 0; n < 500; ++n) {
    std::array<double, 5> q;
    for (std::size_t j = 0; j < 5; ++j)
      q[j] = rng.uniform(body.joints()[j].lower, body.joints()[j].upper);
    body.forward(q, X_BL);
    const Matrix want = flange(q);
    const auto& X = X_BL[static_cast<std::size_t>(tip)];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c)
        ASSERT_NEAR(X.matrix()(r, c),
                    want[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)],
                    2e-6)  // angles of the file have seven digits
            << "pose " << n;
  }
}

TEST(ArticulatedBody, CandleAndFullReachAreWhereTheLinksAddUp) {
  const ArticulatedBody body(youbot());
  const auto gripper = static_cast<std::size_t>(body.gripper());
  ArticulatedBody::Links X_BL;
  std::array<double, 5> q{170 * kDeg, 65 * kDeg, -146 * kDeg, 102.5 * kDeg, 167.5 * kDeg};
  body.forward(q, X_BL);
  // All lengths on top of each other.
  EXPECT_LT((X_BL[gripper].translation() - Vec3(0.198, 0, 0.665)).norm(), 1e-5);
  EXPECT_LT((X_BL[gripper].linear() - perception::Mat3::Identity()).norm(), 1e-5);
  std::array<double, 5> rest{};
  body.rest(rest);
  for (std::size_t j = 0; j < 5; ++j) EXPECT_NEAR(rest[j], q[j], 1e-6);
  q[1] += std::numbers::pi / 2;  // forward: what was up is ahead, what was ahead is down
  body.forward(q, X_BL);
  EXPECT_LT((X_BL[gripper].translation() - Vec3(0.2 + 0.42, 0, 0.245 + 0.002)).norm(), 1e-5);
  // The first joint turns clockwise, seen from above.
  q[0] += std::numbers::pi / 2;
  body.forward(q, X_BL);
  EXPECT_LT((X_BL[gripper].translation() - Vec3(0.167, -(0.033 + 0.42), 0.247)).norm(), 1e-5);
}

TEST(ArticulatedBody, CapsulesRideOnTheirLinks) {
  const ArticulatedBody body(youbot());
  ArticulatedBody::Links X_BL;
  std::array<double, 5> q;
  body.rest(q);
  body.forward(q, X_BL);
  double top = 0;
  int of_arm_2 = -1;
  for (int i = 0; i < body.capsules(); ++i) {
    const auto c = body.capsule_B(i, X_BL);
    top = std::max({top, c.a.z() + c.radius, c.b.z() + c.radius});
    if (body.link_of(i) == body.find("arm_2")) of_arm_2 = i;
  }
  EXPECT_NEAR(top - 0.13, 0.655, 0.01);  // KOI: the arm is 655 mm tall, on its plate
  ASSERT_GE(of_arm_2, 0);
  const auto c = body.capsule_B(of_arm_2, X_BL);
  EXPECT_LT((c.a - Vec3(0.2, 0, 0.245)).norm(), 1e-5);
  EXPECT_LT((c.b - Vec3(0.2, 0, 0.400)).norm(), 1e-5);
  EXPECT_EQ(c.radius, 0.05);
}

TEST(ArticulatedBody, LimitsAndSpeedsAreTheUrdfs) {
  const ArticulatedBody body(youbot());
  const double want[5][2] = {{0, 5.8992}, {0, 2.7053}, {-5.1836, 0}, {0, 3.5779}, {0, 5.8470}};
  for (std::size_t j = 0; j < 5; ++j) {
    EXPECT_EQ(body.joints()[j].lower, want[j][0]);
    EXPECT_EQ(body.joints()[j].upper, want[j][1]);
    EXPECT_NEAR(body.joints()[j].max_speed, 90 * kDeg, 1e-4);
  }
}

// What reach_of_error says holds for every point of every capsule, whatever the errors' signs.
TEST(ArticulatedBody, ErrorsOfJointsReachNoFartherThanSaid) {
  const ArticulatedBody body(youbot());
  rt::Random rng(5);
  double tightest = 1;
  for (int n = 0; n < 300; ++n) {
    std::array<double, 5> q, wrong, speed;
    const double error = 2 * kDeg;
    for (std::size_t j = 0; j < 5; ++j) {
      q[j] = rng.uniform(body.joints()[j].lower, body.joints()[j].upper);
      wrong[j] = q[j] + (rng.uniform() < 0.5 ? error : -error);
      speed[j] = 0;
    }
    ArticulatedBody::Links X, Y;
    body.forward(q, X);
    body.forward(wrong, Y);
    for (int i = 0; i < body.capsules(); ++i) {
      const auto c = body.capsule_B(i, X), d = body.capsule_B(i, Y);
      const double said = body.reach_of_error(c, body.link_of(i), X, speed, error, 0);
      const double off = std::max((c.a - d.a).norm(), (c.b - d.b).norm());
      ASSERT_LE(off, said * 1.02) << "pose " << n << " capsule "
                                  << i;  // to first order in the error
      if (said > 0.03) tightest = std::min(tightest, 1 - off / said);
    }
    // The same for a short motion at the stated speed.
    for (std::size_t j = 0; j < 5; ++j) {
      speed[j] = rng.uniform(-1.5, 1.5);
      wrong[j] = q[j] + 0.01 * speed[j];
    }
    body.forward(wrong, Y);
    for (int i = 0; i < body.capsules(); ++i) {
      const auto c = body.capsule_B(i, X), d = body.capsule_B(i, Y);
      const double said = body.reach_of_error(c, body.link_of(i), X, speed, 0, 0.01);
      ASSERT_LE(std::max((c.a - d.a).norm(), (c.b - d.b).norm()), said * 1.02 + 1e-6);
    }
  }
  EXPECT_LT(tightest, 0.3);  // and it is not far from what happens
}

TEST(ArticulatedBody, APrismaticJointShifts) {
  RobotDescription d;
  auto& a = d.links.emplace_back();
  a.name = "lift", a.joint = "prismatic", a.axis = {0, 0, 2}, a.upper = 1, a.zero = 0.25;
  a.origin_m = {1, 0, 0}, a.rpy_deg = {90, 0, 0};
  a.capsules.emplace_back();
  const ArticulatedBody body(d);
  ArticulatedBody::Links X;
  const double q[1] = {0.75};
  body.forward(q, X);
  EXPECT_LT((X[0].translation() - Vec3(1, -0.5, 0)).norm(), 1e-12);
  body.forward({}, X);  // nothing known: at its zero
  EXPECT_LT((X[0].translation() - Vec3(1, 0, 0)).norm(), 1e-12);
  const double v[1] = {0.2};
  EXPECT_NEAR(body.reach_of_error(body.capsule_B(0, X), 0, X, v, 0.01, 0.1), 0.03, 1e-12);
}

TEST(ArticulatedBody, ForwardAllocatesNothing) {
  const ArticulatedBody body(youbot());
  ArticulatedBody::Links X;
  std::array<double, 5> q{};
  rt_guard::reset();
  {
    rt::Section section;
    body.forward(q, X);
    (void)body.reach_of_error(body.capsule_B(0, X), body.link_of(0), X, q, 0.01, 0.1);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

// ---- bad files: one line with file, key, value, allowed

std::string refusal(const std::string& text) {
  const std::string path = ::testing::TempDir() + "robot_under_test.toml";
  std::ofstream(path) << text;
  const auto r = perception::load_robot(path);
  if (r) return "accepted";
  EXPECT_EQ(r.error().find('\n'), std::string::npos);
  EXPECT_THAT(r.error(), HasSubstr("robot_under_test.toml"));
  EXPECT_THAT(r.error(), HasSubstr("allowed"));
  return r.error();
}

TEST(RobotFile, EveryMistakeIsOneLine) {
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\njoint = \"hinge\"\n"),
              HasSubstr("'link[0].joint' = \"hinge\""));
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\n[[link.capsule]]\nradius_m = -1\n"),
              HasSubstr("'link[0].capsule[0].radius_m' = -1"));
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\nparent = \"b\"\n[[link]]\nname = \"b\"\n"),
              HasSubstr("'link[0].parent' = \"b\""));
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\n[[link]]\nname = \"a\"\n"),
              HasSubstr("'link[1].name' = \"a\""));
  EXPECT_THAT(refusal("[[link]]\njoint = \"fixed\"\n"), HasSubstr("'link[0].name' = \"\""));
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\njoint = \"revolute\"\naxis = [0, 0, 0]\n"),
              HasSubstr("'link[0].axis'"));
  EXPECT_THAT(refusal("[[link]]\nname = \"a\"\njoint = \"revolute\"\nlower = 1\nupper = 0.5\n"),
              HasSubstr("'link[0].lower' = 1: allowed up to upper = 0.5"));
  EXPECT_THAT(refusal("gripper = \"hand\"\n[[link]]\nname = \"a\"\n"),
              HasSubstr("'gripper' = \"hand\""));
  std::string many;
  for (int i = 0; i < 25; ++i) many += "[[link]]\nname = \"l" + std::to_string(i) + "\"\n";
  EXPECT_THAT(refusal(many), HasSubstr("25 links: allowed 0..24"));
  many.clear();
  for (int i = 0; i < 17; ++i)
    many += "[[link]]\nname = \"l" + std::to_string(i) + "\"\njoint = \"prismatic\"\n";
  EXPECT_THAT(refusal(many), HasSubstr("17 joints"));
  EXPECT_EQ(refusal("name = \"empty\"\n"), "accepted");  // a robot without an arm
}

}  // namespace
