// Cells follow the rows of kEdges: who may read, how many values are kept, what is made in which
// box.
#include "tasks/edges/edge_cells.hpp"

#include <gtest/gtest.h>

#include "rt/memory/non_realtime.hpp"

namespace tasks {
namespace {

using Operator = EdgeCells<rt::Box::kOperator>;
using Robot = EdgeCells<rt::Box::kRobot>;

template <class Cells, EdgeId E, TaskId R>
concept Reads = requires(Cells c) {
  c.template read<E, R>();
};
template <class Cells, EdgeId E, TaskId R>
concept Takes = requires(Cells c) {
  c.template ring<E, R>();
};

// A reader that a row names, and one that it does not.
static_assert(Reads<Operator, EdgeId::kPatch, TaskId::kHaptic>);
static_assert(!Reads<Operator, EdgeId::kPatch, TaskId::kPlanning>);
static_assert(Reads<Operator, EdgeId::kMode, kConsole>);
static_assert(!Reads<Operator, EdgeId::kPatch, kConsole>);
static_assert(Takes<Operator, EdgeId::kTouch, TaskId::kPlanning>);
static_assert(!Takes<Operator, EdgeId::kTouch, TaskId::kFusion>);
// What a box sends is read by its link alone; what arrives, by the readers.
static_assert(!Reads<Robot, EdgeId::kRobotState, TaskId::kFusion>);
static_assert(Reads<Robot, EdgeId::kGoal, TaskId::kRobotIo>);
static_assert(!Reads<Operator, EdgeId::kGoal, TaskId::kRobotIo>);
static_assert(std::is_same_v<MessageOf<EdgeId::kFrame>, perception::RgbdFrame>);
static_assert(std::is_same_v<SentMessageOf<EdgeId::kFrame>, drivers::EncodedFrame>);

TEST(EdgeCells, EachReaderOfARowHasAPlaceOfItsOwn) {
  rt::Startup startup;
  Operator cells(startup.token(), {}, [](EdgeId) { return true; });
  auto& mode = cells.begin_write<EdgeId::kMode>();
  mode = {};
  mode.mode = Mode::kHold;
  EXPECT_FALSE((cells.read<EdgeId::kMode, TaskId::kHaptic>()));
  EXPECT_EQ(cells.newest<EdgeId::kMode>(), 0U);
  EXPECT_TRUE(cells.publish<EdgeId::kMode>(rt::time_from_ns(5)));
  EXPECT_EQ(cells.newest<EdgeId::kMode>(), 1U);
  const auto seen = cells.read<EdgeId::kMode, TaskId::kHaptic>();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->mode, Mode::kHold);
  EXPECT_EQ(seen.at, rt::time_from_ns(5));
  // Two readers that read at once hold the same value; a later one moves only who asks.
  cells.begin_write<EdgeId::kMode>() = {};
  static_cast<void>(cells.publish<EdgeId::kMode>(rt::time_from_ns(6)));
  EXPECT_EQ((cells.read<EdgeId::kMode, kConsole>().seq), 2U);
  EXPECT_EQ(seen->mode, Mode::kHold);
}

TEST(EdgeCells, SlotsFollowTheRows) {
  rt::Startup startup;
  Operator cells(startup.token(), {}, [](EdgeId) { return true; });
  for_each_edge([](const auto& e) {
    EXPECT_LE(e.readers.size(), 6U) << e.row.name;  // every reader costs a message of memory
  });
  // Readers' values and two: haptic holds two patches while it blends.
  EXPECT_EQ(cells.of<EdgeId::kPatch>().cell.slot_count(), 4);
  EXPECT_EQ(cells.of<EdgeId::kCameraPose>().cell.slot_count(), 5);
  EXPECT_EQ(cells.of<EdgeId::kGoal>().cell.slot_count(), 3);  // the link
}

TEST(EdgeCells, WhatIsNotAskedForIsNotMade) {
  rt::Startup startup;
  Operator cells(startup.token(), {}, [](EdgeId id) { return id != EdgeId::kMesh; });
  EXPECT_FALSE(cells.has<EdgeId::kMesh>());
  EXPECT_TRUE(cells.has<EdgeId::kView>());
  EXPECT_EQ(cells.newest<EdgeId::kMesh>(), 0U);
  EXPECT_FALSE(cells.has<EdgeId::kRobotMode>());  // of the other box
}

TEST(EdgeCells, AGateTakesItsEdgesName) {
  rt::Startup startup;
  rt::FaultPlan plan;
  plan.name = "t";
  rt::FaultEntry drop;
  drop.kind = rt::FaultKind::kDrop;
  drop.target = "mode";
  drop.every = 1;
  plan.entries.push_back(drop);
  Operator cells(startup.token(), plan, [](EdgeId) { return true; });
  cells.begin_write<EdgeId::kMode>() = {};
  EXPECT_FALSE(cells.publish<EdgeId::kMode>(rt::time_from_ns(5)));
  cells.begin_write<EdgeId::kPath>() = {};
  EXPECT_TRUE(cells.publish<EdgeId::kPath>(rt::time_from_ns(5)));
}

}  // namespace
}  // namespace tasks
