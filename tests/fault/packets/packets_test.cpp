// `teletact robot` and `teletact operator` over a road of real packets: TLS, two namespaces, a late
// and lossy road. Judged is what does not hang on this machine's speed: both run to their end, the
// kernel works with the congestion control that was set, pictures and states arrive, none younger
// than the road allows, and the base that nobody engaged stands. Skipped with one line where the
// rights lack.
#include <gtest/gtest.h>

#include <cmath>

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

}  // namespace
