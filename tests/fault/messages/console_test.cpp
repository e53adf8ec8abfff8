// The console's rows of kLimitTable on the virtual clock: what it shows that is silent, or old, it
// names; within the limits nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/fault/messages/faulty_run.hpp"

namespace {

using messages::Line;
using messages::run;
using teletact::VirtualRun;

// Beyond their limits at the end of the run.
std::vector<std::string_view> names(const VirtualRun& r) {
  std::vector<std::string_view> seen = r.op.view.beyond;
  std::sort(seen.begin(), seen.end());
  return seen;
}

// Mesh and list of objects come only where a scene asks for them.
const std::vector<std::string> kWithMeshAndObjects{"fusion.mesh_blocks=100",
                                                   "fusion.objects.enabled=true"};

// The console names what it shows that is silent, or old.
TEST(MessageFaults, TheConsoleNamesWhatIsBeyondItsLimits) {
  const std::vector<std::string_view> named{"frame",       "view",          "cost_map", "hand",
                                            "camera_pose", "path",          "task",     "mode",
                                            "robot_state", "odometry_frame"};
  // These, two of the next test and the robot's mode are the console's rows.
  auto rows_here = named;
  rows_here.insert(rows_here.end(), {"mesh", "objects", "robot_mode"});
  std::vector<std::string_view> rows_there;
  for (const auto& r : tasks::kLimitTable) {
    if (r.reader == tasks::kConsole)
      rows_there.push_back(tasks::kEdgeTable[tasks::index_of(r.edge)].name);
  }
  EXPECT_THAT(rows_here, testing::UnorderedElementsAreArray(rows_there));
  EXPECT_TRUE(names(run(6.5, {})).empty());
  for (const char* kind : {"drop", "stale"}) {
    std::vector<Line> lines;
    for (const auto edge : named) {
      const auto& rows = tasks::kEdgeTable;
      const auto row =
          std::find_if(rows.begin(), rows.end(), [&](auto& e) { return e.name == edge; });
      const bool robot = edge == "robot_state";
      const int hz = edge == "hand"                             ? 1000
                     : edge == "mode" || robot                  ? 100
                     : edge == "camera_pose" || edge == "frame" ? 30
                                                                : 10;
      ASSERT_NE(row, rows.end());
      lines.push_back({kind, std::string(edge), edge == "view" ? 10 : static_cast<int>(5.3 * hz), 1,
                       0, std::string_view(kind) == "stale" ? 1.1e7 : 0.0});
    }
    lines.push_back(
        {kind, "robot_mode", 530, 1, 0, std::string_view(kind) == "stale" ? 1.1e7 : 0.0});
    const auto r = run(7.2, lines);
    auto want = named;
    // Robot states of long ago are as a silent link: with the ramp down planning drops its path.
    if (std::string_view(kind) == "stale") want.erase(std::find(want.begin(), want.end(), "path"));
    std::sort(want.begin(), want.end());
    EXPECT_EQ(names(r), want) << kind;
    EXPECT_TRUE(r.robot.view.mode_beyond) << kind;
  }
}

// Each so old that its own limit alone decides, on this side of it and beyond.
TEST(MessageFaults, TheConsoleNamesAnOldMeshOldObjectsAndAnOldPath) {
  const auto old_by = [](double mesh_us, double objects_us, double path_us) {
    return run(6.8,
               {{"stale", "mesh", 0, 1, 0, mesh_us},
                {"stale", "objects", 0, 1, 0, objects_us},
                {"stale", "path", 0, 1, 0, path_us}},
               {}, kWithMeshAndObjects);
  };
  const auto within = old_by(1.5e6, 0.7e6, 8.5e6);
  EXPECT_EQ(within.op.view.paths.size(), 1U);
  EXPECT_GT(within.op.view.objects.seq, 0U);
  EXPECT_TRUE(names(within).empty()) << names(within).front();
  const auto beyond = old_by(2.1e6, 1.1e6, 10.1e6);
  EXPECT_EQ(names(beyond), (std::vector<std::string_view>{"mesh", "objects", "path"}));
}

// A mesh that does not change is not sent: silent is fusion itself.
TEST(MessageFaults, TheConsoleNamesMeshAndObjectsOfAFusionThatEnded) {
  const auto dead_at_5s = [](double seconds) {
    return run(seconds, {{"dead_thread", "fusion", 150}}, {}, kWithMeshAndObjects);
  };
  EXPECT_TRUE(names(dead_at_5s(5.7)).empty());
  const auto after = dead_at_5s(6.4);
  EXPECT_EQ(names(after),
            (std::vector<std::string_view>{"camera_pose", "cost_map", "mesh", "objects"}));
}

// All of a mesh again where pieces do not come: what is there is as good as it was.
TEST(MessageFaults, PiecesOfAMeshThatDoNotComeAreNotOld) {
  const auto r = run(6.8, {{"drop", "mesh", 2}}, {}, kWithMeshAndObjects);
  EXPECT_TRUE(names(r).empty()) << names(r).front();
}

}  // namespace
