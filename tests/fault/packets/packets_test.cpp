// `teletact robot` and `teletact operator` over a road of real packets: TLS, two namespaces, a late
// and lossy road. Judged is what does not hang on this machine's speed: both run to their end, the
// kernel works with the congestion control that was set, pictures and states arrive, none younger
// than the road allows, and the base that nobody engaged stands. Skipped with one line where the
// rights lack.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tasks/contract/messages.hpp"
#include "tests/fault/packets/heard_stream.hpp"
#include "tests/support/paths.hpp"
#include "tools/measure/bench/link/link_rig.hpp"
#include "tools/measure/bench/link/link_window.hpp"
#include "tools/measure/tun_road/tun_device.hpp"

namespace {

using teletact::LinkRig;
using teletact::RigRun;

TEST(Packets, BothBoxesMeetOverALateAndLossyRoad) {
  if (const auto why = teletact::link_rig_refusal(); !why.empty())
    GTEST_SKIP() << "the road " << why;
  const LinkRig rig(tests::in_build());
  RigRun run;
  run.name = "late_and_lossy";
  run.scene = "default_room";
  run.keys = {"link.shape.delay_ms=0", "link.shape.jitter_ms=0", "link.shape.rate_Mbit_per_s=0",
              "link.depth_codec=\"quiet\"", "operator.engage_after_s=3600"};
  run.road = {"rate_Mbit_per_s=10", "queue_kB=200", "delay_ms=75", "jitter_ms=20", "loss=0.02"};
  run.seconds = 10;
  const auto r = rig.run(run);
  if (r.problem.find("not registered") != std::string::npos)
    GTEST_SKIP() << "the cores are taken: " << r.problem;
  ASSERT_EQ(r.problem, "");
  const std::string congestion = teletact::settable_congestion({"bbr", "cubic"}).front();
  EXPECT_EQ(r.robot_congestion, congestion) << "set and read back by the box";
  EXPECT_EQ(r.operator_congestion, congestion);
  std::uint64_t pictures = 0, states = 0;
  for (const auto& s : r.op.link.newest) {
    (s.picture ? pictures : states) += 1;
    const double age_ms = 1e-6 * static_cast<double>(rt::ns_of(s.stamp) - s.made_remote_ns);
    EXPECT_GE(age_ms, 75) << "nothing is faster than the road";
  }
  std::printf("%llu pictures, %llu states; others took %.2f of a core\n",
              static_cast<unsigned long long>(pictures), static_cast<unsigned long long>(states),
              r.others_cores);
  EXPECT_GT(pictures, 0U);
  EXPECT_GT(states, 0U);
  ASSERT_FALSE(r.robot.view.truth.empty());
  EXPECT_LT(r.robot.view.truth.back().path_m, 0.001) << "nobody engaged";
}

// What the base may still do once its box has noticed a silence: two periods, the ramp, the tail
// (docs/faults.md, How soon), and what a machine that other work shares may be late.
constexpr std::int64_t kStands_ns = 197'000'000 + 20'000'000;
// Until the box has noticed: the silence limit, and how late a shared machine lets an ordinary
// thread read a packet. Where other work holds that thread up for longer, the box still takes goals
// that had come before: counted from the last one.
constexpr std::int64_t kNotices_ns = 90'000'000, kReads_ns = 50'000'000;
constexpr double kStands_m_per_s = 0.01, kDrives_m_per_s = 0.1;
// Work of others that may keep pictures, and with them the robot, waiting.
constexpr double kOthersWork_cores = 0.25;
constexpr double kLossy_at_s = 14, kLossyFor_s = 4;
// Where the rig's robot listens.
constexpr int kPort = 47110;

struct Motion {
  double before_m_per_s = 0, later_m_per_s = 0;  // fastest, around the loss
  int silences = 0;         // into which it drove, and long enough to have to stand in
  double late_m_per_s = 0;  // fastest when it had to stand
};

double fastest(const teletact::RobotHalf& robot, std::int64_t from_ns, std::int64_t to_ns) {
  double most = 0;
  for (const auto& s : robot.view.robot) {
    const std::int64_t t = rt::ns_of(s.stamp);
    if (t > from_ns && t <= to_ns) most = std::max(most, static_cast<double>(s.speed_m_per_s));
  }
  return most;
}

// When the robot last took a new goal in this time; `from_ns`: it took none.
std::int64_t last_goal_taken(const teletact::RobotHalf& robot, std::int64_t from_ns,
                             std::int64_t to_ns) {
  std::int64_t last = from_ns;
  std::uint64_t goal = 0;
  for (const auto& s : robot.view.robot) {
    const std::int64_t t = rt::ns_of(s.stamp);
    if (t > from_ns && t <= to_ns && s.goal_seq != goal) last = t;
    goal = s.goal_seq;
  }
  return last;
}

// Once out of the engaged mode it has to stand, whatever was heard.
double fastest_unengaged(const teletact::RobotHalf& robot) {
  double most = 0;
  std::int64_t out_since = 0;
  for (const auto& s : robot.view.robot) {
    const std::int64_t t = rt::ns_of(s.stamp);
    const bool engaged = s.mode == static_cast<std::uint8_t>(tasks::Mode::kEngaged);
    if (engaged) out_since = 0;
    if (!engaged && out_since == 0) out_since = t;
    if (out_since != 0 && t - out_since > kStands_ns)
      most = std::max(most, static_cast<double>(s.speed_m_per_s));
  }
  return most;
}

// Silences by what came in at the robot's port, motion by the robot's records: a box that notices no
// silence drives on in one, and is found.
Motion motion_of(const teletact::RobotHalf& robot, std::int64_t road_epoch_ns,
                 const std::vector<std::int64_t>& heard) {
  Motion out;
  const std::int64_t lossy = teletact::later(road_epoch_ns, kLossy_at_s);
  out.before_m_per_s = fastest(robot, lossy - 1'000'000'000, lossy);
  out.later_m_per_s =
      fastest(robot, teletact::later(lossy, kLossyFor_s), std::numeric_limits<std::int64_t>::max());
  out.late_m_per_s = fastest_unengaged(robot);
  for (std::size_t i = 1; i < heard.size(); ++i) {
    const std::int64_t from = heard[i - 1], to = heard[i];
    if (to <= from + kNotices_ns + kReads_ns + kStands_ns) continue;
    const std::int64_t read = std::max(from + kReads_ns, last_goal_taken(robot, from, to)),
                       stands = read + kNotices_ns + kStands_ns;
    if (to <= stands) continue;
    out.silences += fastest(robot, from - 100'000'000, from + kNotices_ns) > kDrives_m_per_s;
    out.late_m_per_s = std::max(out.late_m_per_s, fastest(robot, stands, to));
  }
  return out;
}

// The parts of a stream in any order: what goes on, and what only fills in later.
TEST(Packets, AStreamIsHeardWhereItGoesOn) {
  packets_test::Stream s;
  s.begin(0xffff'fff0U);  // over the end of the numbers
  EXPECT_TRUE(s.add(0xffff'fff0U, 8));
  EXPECT_FALSE(s.add(0xffff'fff0U, 8)) << "sent again";
  EXPECT_FALSE(s.add(4, 10)) << "beyond a hole";
  EXPECT_FALSE(s.add(14, 2));
  EXPECT_TRUE(s.add(0xffff'fff8U, 12)) << "the hole is filled";
  EXPECT_FALSE(s.add(2, 14)) << "all of that was there";
  EXPECT_TRUE(s.add(16, 1));
}

TEST(Packets, ThirtyPercentLossStopsWhatIsSilentAndEndsNoRun) {
  if (const auto why = teletact::link_rig_refusal(); !why.empty())
    GTEST_SKIP() << "the road " << why;
  const LinkRig rig(tests::in_build());
  RigRun run;
  run.name = "thirty_percent";
  run.scene = "rounds";  // it drives for longer than this takes
  run.keys = {"link.shape.delay_ms=0", "link.shape.jitter_ms=0", "link.shape.rate_Mbit_per_s=0",
              "link.depth_codec=\"moving\""};
  run.road = {"rate_Mbit_per_s=10", "queue_kB=200",   "delay_ms=75", "jitter_ms=20",
              "loss=0.3",           "loss_from_s=14", "loss_for_s=4"};
  run.seconds = 35;
  packets_test::HeardStream robot_hears("tlink-r" + std::to_string(::getpid()), kPort);
  const auto r = rig.run(run);
  const auto heard = robot_hears.end();
  if (r.problem.find("not registered") != std::string::npos)
    GTEST_SKIP() << "the cores are taken: " << r.problem;
  ASSERT_EQ(r.problem, "") << "both boxes live through it";
  const Motion m = motion_of(r.robot, r.road_epoch_ns, heard);
  std::printf(
      "%.2f m/s before, %.2f behind it; heard %zu times, %d silences into which it drove and had "
      "to "
      "stand; then %.3f m/s; engaged %u times; others took %.2f of a core\n",
      m.before_m_per_s, m.later_m_per_s, heard.size(), m.silences, m.late_m_per_s,
      r.op.view.engages, r.others_cores);
  ASSERT_FALSE(heard.empty()) << "the packets at the robot's port were not all seen";
  EXPECT_LE(m.late_m_per_s, kStands_m_per_s) << "nothing moves later than its bound";
  std::uint64_t later = 0;
  for (const auto& s : r.op.link.newest) {
    const double at_s = 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.road_epoch_ns);
    later += s.picture && at_s > kLossy_at_s + kLossyFor_s + 5;
  }
  EXPECT_GT(later, 0U) << "pictures go on";
  if (m.before_m_per_s < kDrives_m_per_s)
    GTEST_SKIP() << "it did not drive before: this machine was too slow";
  if (m.silences == 0) GTEST_SKIP() << "not judged: no silence was long enough to have to stand in";
  if (m.later_m_per_s <= kDrives_m_per_s && r.others_cores > kOthersWork_cores)
    GTEST_SKIP() << "not judged: it did not drive again, and others took " << r.others_cores
                 << " of a core";
  EXPECT_GT(m.later_m_per_s, kDrives_m_per_s) << "work goes on, after another act where it must";
}

}  // namespace
