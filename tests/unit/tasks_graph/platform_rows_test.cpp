// What runs above the tasks, as admission charges it and the registry gets it.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>

#include "rt/sched/registry.hpp"
#include "tasks/graph/calibration.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/static_choices.hpp"

namespace {

// Fusion takes 12 ms at its coarse choice, and too much at the fine one.
tasks::Calibration measured() {
  tasks::Calibration c;
  c.host = "test";
  for (int level = 0; level < 3; ++level) {
    for (const bool coarse : {false, true}) {
      auto& r = c.rows.emplace_back();
      r.name = "fusion";
      r.choice = coarse ? "20 mm" : "10 mm";
      r.level = level;
      r.p999_us = 1000 * (coarse ? 12.0 : 90.0) / (level + 1);
    }
  }
  return c;
}

// The default table on two cores, with the sentinels and watchdogs that its two processes start:
// for each box and CPU that has a task of it one set of sentinel rows, for each box one watchdog.
TEST(Request, BothProcessesPlatformIsChargedAndFitsTwoCores) {
  const auto r = tasks::make_request(tasks::make_specs(measured()), {0, 1}, {.camera_twin = 0.30});
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  const auto table = rt::analyse_modes(r, a, tasks::mode_sets(r, a));
  const auto held_request = rt::largest_of(r, a, table);
  const auto held = rt::admit(held_request);
  ASSERT_TRUE(held.admitted) << held.refusal;
  std::printf("%s", rt::report_table(held).c_str());
  ASSERT_EQ(held.platform.size(), a.platform.size());
  for (const rt::Box box : {rt::Box::kOperator, rt::Box::kRobot}) {
    const auto rows = rt::registry_entries(held_request, held,
                                           [&](const std::string&, rt::Box b) { return b == box; });
    std::map<int, double> woken, released, fastest;  // by CPU, Hz
    std::map<int, int> watchdogs;
    for (const auto& row : rows) {
      const double hz = 1e9 / static_cast<double>(row.T.count());
      if (row.priority == rt::kSentinelPriority) {
        woken[row.cpu] += hz;
      } else if (row.priority == rt::kWatchdogPriority) {
        ++watchdogs[row.cpu];
      } else if (row.priority > 0) {
        released[row.cpu] += hz;
        fastest[row.cpu] = std::max(fastest[row.cpu], hz);
      }
    }
    ASSERT_EQ(woken.size(), released.size());
    for (const auto& [cpu, hz] : released) {
      EXPECT_GE(woken[cpu], fastest[cpu]);
      EXPECT_LE(woken[cpu], hz + 0.01);
    }
    ASSERT_EQ(watchdogs.size(), 1U);
    EXPECT_EQ(watchdogs.begin()->first, released.rbegin()->first) << "the last CPU with a task";
    EXPECT_EQ(watchdogs.begin()->second, 1);
  }
}

}  // namespace
