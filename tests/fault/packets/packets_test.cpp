// `teletact robot` and `teletact operator` over a road of real packets: TLS, two namespaces, a late
// and lossy road. Judged is what does not hang on this machine's speed: both run to their end, the
// kernel works with the congestion control that was set, pictures and states arrive, none younger
// than the road allows, and the base that nobody engaged stands. Skipped with one line where the
// rights lack.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tasks/contract/table.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tools/measure/bench/link/link_rig.hpp"
#include "tools/measure/bench/link/link_window.hpp"
#include "tools/measure/tun_road/tun_device.hpp"

namespace {

using teletact::LinkRig;
using teletact::RigRun;

TEST(Packets, BothBoxesMeetOverALateAndLossyRoad) {
  if (const auto why = teletact::link_rig_refusal(); !why.empty())
    GTEST_SKIP() << "the road " << why;
  const LinkRig rig(TELETACT_BINARY_DIR);
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

// What the base may still do once its box has noticed a silence (90 ms): two periods, the ramp, the
// tail (docs/faults.md, How soon), and what a machine that other work shares may be late.
constexpr std::int64_t kStands_ns = 197'000'000 + 20'000'000;
constexpr double kStands_m_per_s = 0.01, kDrives_m_per_s = 0.1;
constexpr double kLossy_at_s = 14, kLossyFor_s = 4;

struct Motion {
  double before_m_per_s = 0, later_m_per_s = 0;  // fastest, around the loss
  int silences = 0;                              // of those long enough to have to stand in
  double late_m_per_s = 0;                       // fastest when it had to stand
};

// By the robot's own records: each of its jobs says whether the link is silent to it, each sample
// how fast the base is and in which mode.
Motion motion_of(const teletact::RobotHalf& robot, std::int64_t road_epoch_ns) {
  Motion out;
  std::vector<std::pair<std::int64_t, std::int64_t>> silent;
  const auto& all = robot.log.tasks;
  const auto task = std::find_if(all.begin(), all.end(), [](const auto& t) {
    return t.id == static_cast<std::uint16_t>(tasks::TaskId::kRobotIo);
  });
  if (task == all.end()) return out;
  bool was = false;
  for (const auto& j : task->jobs) {
    const bool is = j.fault == tasks::robot_io_fault::kLinkSilent;
    if (is && !was) silent.emplace_back(j.start_ns, j.start_ns);
    if (is) silent.back().second = j.start_ns;
    was = is;
  }
  std::int64_t out_since = 0;  // of the engaged mode
  for (const auto& s : robot.view.robot) {
    const std::int64_t t = rt::ns_of(s.stamp);
    const auto v = static_cast<double>(s.speed_m_per_s);
    const double at_s = 1e-9 * static_cast<double>(t - road_epoch_ns);
    if (at_s > kLossy_at_s - 1 && at_s < kLossy_at_s)
      out.before_m_per_s = std::max(out.before_m_per_s, v);
    if (at_s > kLossy_at_s + kLossyFor_s) out.later_m_per_s = std::max(out.later_m_per_s, v);
    const bool engaged = s.mode == static_cast<std::uint8_t>(tasks::Mode::kEngaged);
    if (engaged) out_since = 0;
    if (!engaged && out_since == 0) out_since = t;
    if (out_since != 0 && t - out_since > kStands_ns)
      out.late_m_per_s = std::max(out.late_m_per_s, v);
  }
  for (const auto& [from, to] : silent) {
    if (to - from <= kStands_ns) continue;
    ++out.silences;
    for (const auto& s : robot.view.robot) {
      const std::int64_t t = rt::ns_of(s.stamp);
      if (t > from + kStands_ns && t <= to)
        out.late_m_per_s = std::max(out.late_m_per_s, static_cast<double>(s.speed_m_per_s));
    }
  }
  return out;
}

TEST(Packets, ThirtyPercentLossStopsWhatIsSilentAndEndsNoRun) {
  if (const auto why = teletact::link_rig_refusal(); !why.empty())
    GTEST_SKIP() << "the road " << why;
  const LinkRig rig(TELETACT_BINARY_DIR);
  RigRun run;
  run.name = "thirty_percent";
  run.scene = "rounds";  // it drives for longer than this takes
  run.keys = {"link.shape.delay_ms=0", "link.shape.jitter_ms=0", "link.shape.rate_Mbit_per_s=0",
              "link.depth_codec=\"moving\""};
  run.road = {"rate_Mbit_per_s=10", "queue_kB=200",   "delay_ms=75", "jitter_ms=20",
              "loss=0.3",           "loss_from_s=14", "loss_for_s=4"};
  run.seconds = 35;
  const auto r = rig.run(run);
  if (r.problem.find("not registered") != std::string::npos)
    GTEST_SKIP() << "the cores are taken: " << r.problem;
  ASSERT_EQ(r.problem, "") << "both boxes live through it";
  const Motion m = motion_of(r.robot, r.road_epoch_ns);
  std::printf(
      "%.2f m/s before, %.2f behind it; %d silences in which it had to stand; then %.3f m/s; "
      "engaged %u times; others took %.2f of a core\n",
      m.before_m_per_s, m.later_m_per_s, m.silences, m.late_m_per_s, r.op.view.engages,
      r.others_cores);
  EXPECT_LE(m.late_m_per_s, kStands_m_per_s) << "nothing moves later than its bound";
  std::uint64_t later = 0;
  for (const auto& s : r.op.link.newest) {
    const double at_s = 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.road_epoch_ns);
    later += s.picture && at_s > kLossy_at_s + kLossyFor_s + 5;
  }
  EXPECT_GT(later, 0U) << "pictures go on";
  if (m.before_m_per_s < kDrives_m_per_s)
    GTEST_SKIP() << "it did not drive before: this machine was too slow";
  EXPECT_GT(m.later_m_per_s, kDrives_m_per_s) << "work goes on, after another act where it must";
}

}  // namespace
