// Seeded no-go discs drawn in the robot's way, at several delays of the link: the robot touches
// nothing, and arrives or says that there is no way and stands.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "tests/unit/tasks_driving/loop.hpp"

namespace tests {
namespace {

const drivers::World& world() {
  static const drivers::World w = test_support::load_world(startup().token(), "default_room.toml");
  return w;
}
const RoomMap& room() {
  static const RoomMap m(world());
  return m;
}

// The robot's way without a disc.
const std::vector<std::array<double, 4>>& plain_way() {
  static const std::vector<std::array<double, 4>> way = [] {
    std::vector<std::array<double, 4>> out;
    (void)ride(world(), room(), {}, 30ms, 12, 1, &out);
    return out;
  }();
  return way;
}

// About the way, in time mostly before the robot is there.
Disc draw(std::uint64_t seed) {
  rt::Random random(seed);
  const auto n = static_cast<std::int64_t>(plain_way().size());
  const auto& on = plain_way()[static_cast<std::size_t>(random.integer(n / 20, n * 3 / 5))];
  Disc d;
  d.x_m = on[1] + random.uniform(-0.3, 0.3);
  d.y_m = on[2] + random.uniform(-0.3, 0.3);
  d.at_s = random.uniform(0.4, 6);
  d.radius_m = random.uniform(0.03, 0.25);
  return d;
}

struct Count {
  int rides = 0, collided = 0, arrived = 0, no_way = 0, neither = 0, moving = 0, still = 0;
  double least_m = 1e9;
};

Count sweep(rt::Nanos one_way, std::uint64_t first, int n, bool tell) {
  Count c;
  for (int i = 0; i < n; ++i) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(i);
    const Disc d = draw(seed);
    // A later link is driven slower.
    const Ride r = ride(world(), room(), d, one_way, 20 + 40 * rt::seconds(one_way), seed);
    ++c.rides;
    c.collided += r.collisions > 0 ? 1 : 0;
    c.arrived += r.arrived ? 1 : 0;
    c.no_way += r.failed ? 1 : 0;
    c.neither += !r.arrived && !r.failed ? 1 : 0;
    c.moving += r.speed_at_end_m_per_s > 0.01 ? 1 : 0;
    c.still += r.drove ? 0 : 1;
    c.least_m = std::min(c.least_m, r.clearance_m);
    if (tell || r.collisions > 0 || (!r.arrived && !r.failed) || r.speed_at_end_m_per_s > 0.01) {
      std::printf(
          "  seed %llu: disc of %.3f m at (%.2f, %.2f), %.2f s: %s, %u collisions, clearance %.1f "
          "mm at "
          "%.2f s, %u paths, end speed %.3f m/s, end error %.3f m\n",
          static_cast<unsigned long long>(seed), d.radius_m, d.x_m, d.y_m, d.at_s,
          r.arrived  ? "arrived"
          : r.failed ? "no way"
                     : "NEITHER",
          r.collisions, 1e3 * r.clearance_m, r.clearance_at_s, r.paths, r.speed_at_end_m_per_s,
          r.end_error_m);
      std::fflush(stdout);
    }
  }
  std::printf(
      "  one way %lld ms: %d rides from seed %llu: %d collided, %d arrived, %d no way, %d neither, "
      "%d moving at "
      "the end, %d never drove, least clearance %.1f mm\n",
      static_cast<long long>(one_way.count() / 1000000), c.rides,
      static_cast<unsigned long long>(first), c.collided, c.arrived, c.no_way, c.neither, c.moving,
      c.still, 1e3 * c.least_m);
  return c;
}

int asked(const char* name, int usual) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::atoi(text) : usual;
}

TEST(Driving, TouchesNothingWhateverIsDrawnInItsWay) {
  const int n = asked("TELETACT_DISCS", 12);
  const auto first = static_cast<std::uint64_t>(asked("TELETACT_DISC_SEED", 1));
  for (const rt::Nanos one_way : {rt::Nanos{30ms}, rt::Nanos{100ms}, rt::Nanos{200ms}}) {
    const Count c = sweep(one_way, first, n, asked("TELETACT_DISC_TELL", 0) != 0);
    EXPECT_EQ(c.collided, 0);
    EXPECT_EQ(c.neither, 0);
    EXPECT_EQ(c.moving, 0);
    EXPECT_EQ(c.still, 0);
  }
}

// Robot states half a second old do not drive: it says so by standing.
TEST(Driving, StandsWhereTheLinkIsTooSlow) {
  const Ride r = ride(world(), room(), {}, 500ms, 6);
  EXPECT_FALSE(r.drove);
  EXPECT_FALSE(r.arrived);
  EXPECT_EQ(r.collisions, 0U);
}

}  // namespace
}  // namespace tests
