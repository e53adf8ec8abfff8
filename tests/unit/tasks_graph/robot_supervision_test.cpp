// What the robot's supervision takes of the operator's goals as the link comes and goes.
#include <gtest/gtest.h>

#include "rt/memory/non_realtime.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace {

using tasks::EdgeId;
using Engage = tasks::SupervisionTask::Engage;
using std::chrono::milliseconds;

struct RobotBox {
  rt::Startup startup;
  tasks::GraphConfig config;
  tasks::RobotCells cells{startup.token(), rt::FaultPlan{}, true};
  tasks::LinkStatus link;
  tasks::OperatorRequests requests;
  tasks::RobotSetup setup;
  tasks::RobotSupervisionNode node{startup.token(), config, cells, link, requests, setup};
  rt::Tick tick;
  rt::JobRecord record;

  RobotBox() { tick.start = rt::time_from_ns(5'000'000'000); }
  void goal(int engaged) {
    drivers::RobotGoal& g = cells.of<EdgeId::kGoal>().cell.begin_write();
    g = {};
    g.made = tick.start - milliseconds{80};
    g.operator_engaged = static_cast<std::uint8_t>(engaged);
    cells.of<EdgeId::kGoal>().cell.publish(tick.start);
  }
  Engage asked(milliseconds later) {
    tick.start += later;
    ++tick.k;
    link.last_heard_ns = rt::ns_of(tick.start);
    node.latch(tick, record);
    return node.in().requests.engage;
  }
};

TEST(RobotSupervision, WhatAnOlderConnectionSaidIsVoid) {
  constexpr milliseconds kTick{10};
  for (const int said : {0, 1, 2}) {
    const Engage as = said == 1 ? Engage::kYes : said == 2 ? Engage::kPaused : Engage::kNo;
    RobotBox box;
    EXPECT_EQ(box.asked(kTick), Engage::kAbsent);
    box.link.session = 1;
    EXPECT_EQ(box.asked(kTick), Engage::kAbsent);
    box.goal(said);
    EXPECT_EQ(box.asked(kTick), as);
    EXPECT_EQ(box.asked(kTick), as);
    box.link.session = 2;
    EXPECT_EQ(box.asked(kTick), Engage::kAbsent) << said;
    EXPECT_EQ(box.asked(kTick), Engage::kAbsent) << said;
    box.goal(1);
    EXPECT_EQ(box.asked(kTick), Engage::kYes);
    EXPECT_EQ(box.asked(milliseconds{2000}), Engage::kAbsent) << "made too long ago";
  }
}

}  // namespace
