// No-go discs drawn into the default room while the robot drives: it never touches anything, and it
// arrives or says that there is no way and stands.
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "rt/random.hpp"
#include "tests/unit/demo_driving/drive.hpp"

namespace tests {
namespace {

struct Case {
  std::uint64_t seed = 0;
  double x_m = 0, y_m = 0, radius_m = 0, at_s = 0;
};

// The way of the default run, by the twin.
const std::vector<teletact::TruthSample>& plain_way() {
  static const std::vector<teletact::TruthSample> way = [] {
    auto s = room();
    return drive(*s, 14).robot.view.truth;
  }();
  return way;
}

// Somewhere along the way that the robot takes without it, up to 0.3 m to its side.
Case draw(std::uint64_t seed) {
  rt::Random random(seed);
  Case c;
  c.seed = seed;
  const double whole = plain_way().back().path_m, along = random.uniform(0, whole);
  for (const auto& t : plain_way()) {
    if (t.path_m < along) continue;
    c.x_m = t.x_m + random.uniform(-0.3, 0.3);
    c.y_m = t.y_m + random.uniform(-0.3, 0.3);
    break;
  }
  c.at_s = random.uniform(3, 9);
  c.radius_m = random.uniform(0.03, 0.25);
  return c;
}

const char* text_of(const Driven& d) {
  return d.arrived ? "arrived" : d.failed ? "no way" : "NEITHER";
}

Driven run_case(const Case& c, const std::vector<std::string>& overrides = {},
                double seconds = 16) {
  auto s = room(overrides);
  s->operator_script.edits.push_back(disc(c.x_m, c.y_m, c.radius_m, c.at_s));
  const char* folder = std::getenv("TELETACT_DISC_LOGS");
  const VirtualRun r = drive(
      *s, seconds, folder != nullptr ? std::string(folder) + "/" + std::to_string(c.seed) : "");
  if (folder != nullptr) {
    std::ofstream out(std::string(folder) + "/" + std::to_string(c.seed) + "/truth.csv");
    for (const auto& t : r.robot.view.truth)
      out << 1e-9 * static_cast<double>(rt::ns_of(t.stamp) - r.robot.epoch_ns) << "," << t.x_m
          << "," << t.y_m << "," << t.yaw_rad << "," << t.collisions << "\n";
    std::ofstream p(std::string(folder) + "/" + std::to_string(c.seed) + "/paths.csv");
    for (const auto& q : r.op.view.paths)
      for (int i = 0; i < q.size; ++i)
        p << q.seq << "," << 1e-9 * static_cast<double>(rt::ns_of(q.made) - r.op.epoch_ns) << ","
          << q.points[static_cast<std::size_t>(i)][0] << ","
          << q.points[static_cast<std::size_t>(i)][1] << ","
          << q.points[static_cast<std::size_t>(i)][2] << "\n";
  }
  const Driven d = judge(*s, r);
  std::printf(
      "  seed %llu: disc of %.3f m at (%.2f, %.2f), %.2f s: %s, %u collisions, clearance %.1f mm "
      "at %.2f s, %u paths, %.2f m driven, end speed %.3f m/s, arrived %.2f s\n",
      static_cast<unsigned long long>(c.seed), c.radius_m, c.x_m, c.y_m, c.at_s, text_of(d),
      d.collisions, 1e3 * d.clearance_m, d.clearance_at_s, d.paths, d.way_m, d.speed_at_end_m_per_s,
      d.arrived_at_s);
  std::fflush(stdout);
  return d;
}

std::vector<std::string> asked_overrides() {
  std::vector<std::string> out;
  if (const char* delay = std::getenv("TELETACT_DISC_DELAY_MS"); delay != nullptr)
    out.push_back(std::string("link.shape.delay_ms=") + delay);
  return out;
}

TEST(DrawnDiscs, TheRobotTouchesNothing) {
  const char* asked = std::getenv("TELETACT_DISCS");
  const int n = asked != nullptr ? std::atoi(asked) : 0;
  const char* chosen = std::getenv("TELETACT_DISC_SEED");
  const std::uint64_t first = chosen != nullptr ? std::strtoull(chosen, nullptr, 10) : 1;
  std::vector<Case> cases;
  if (chosen == nullptr) cases.push_back({0, 0.69, 0.75, 0.08, 5.2});
  for (int i = 0; i < n; ++i) cases.push_back(draw(first + static_cast<std::uint64_t>(i)));
  for (const Case& c : cases) {
    const Driven d = run_case(c, asked_overrides());
    EXPECT_EQ(d.collisions, 0U) << "seed " << c.seed;
    EXPECT_GT(d.clearance_m, 0) << "seed " << c.seed;
    EXPECT_TRUE(d.arrived || d.failed) << "seed " << c.seed;
    EXPECT_LT(d.speed_at_end_m_per_s, 0.01) << "seed " << c.seed;
  }
}

}  // namespace
}  // namespace tests
