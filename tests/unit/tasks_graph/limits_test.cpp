// The limits of kLimitTable are those in force: defaults of the configurations, docs/architecture.md.
// TELETACT_UPDATE=1 in the environment writes the page anew.
#include <gtest/gtest.h>
#include <algorithm>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tasks/graph/graph_config.hpp"
#include "tasks/graph/table.hpp"

namespace {

using tasks::EdgeId;
using tasks::TaskId;

std::string words(std::string_view text) { return std::string(text); }

const tasks::EdgeRow& edge_of(EdgeId id) { return tasks::kEdgeTable[static_cast<std::size_t>(id)]; }
const tasks::TaskRow& task_of(TaskId id) { return tasks::kTaskTable[tasks::index_of(id)]; }

TEST(Limits, ConfigurationsStartFromTheTable) {
  const tasks::GraphConfig c;
  int rows = 0;
  const auto row = [&](EdgeId edge, TaskId reader) {
    for (const auto& r : tasks::kLimitTable) {
      if (r.edge == edge && r.reader == reader) return ++rows, r;
    }
    ADD_FAILURE() << "no row";
    return tasks::kLimitTable[0];
  };
  const auto state = row(EdgeId::kRobotState, TaskId::kPrediction);
  EXPECT_EQ(c.prediction.state_liveness_ms, state.data_age_ms);
  EXPECT_EQ(state.liveness_ms, 0) << "a second limit that nobody reads";
  const auto silence = row(EdgeId::kRobotState, TaskId::kSupervision);
  EXPECT_EQ(c.supervision.link_liveness_s, silence.liveness_ms / 1000.0);
  EXPECT_EQ(silence.data_age_ms, 0);
  const auto goal = row(EdgeId::kGoal, TaskId::kRobotIo);
  EXPECT_EQ(c.robot_io.link_silence_ms, goal.liveness_ms);
  EXPECT_EQ(c.prediction.goal_valid_ms, goal.data_age_ms);
  const auto peer = row(EdgeId::kGoal, TaskId::kRobotSupervision);
  EXPECT_EQ(c.supervision.link_liveness_s, peer.liveness_ms / 1000.0);
  EXPECT_EQ(peer.data_age_ms, 0);
  const auto patch = row(EdgeId::kPatch, TaskId::kHaptic);
  EXPECT_EQ(c.haptic.patch_liveness_s, patch.liveness_ms / 1000.0);
  EXPECT_EQ(patch.data_age_ms, 0);
  EXPECT_EQ(rows, static_cast<int>(tasks::kLimitTable.size()))
      << "a row that no configuration takes";
}

// Every row names an edge that its reader reads, and keys that a scene can set.
TEST(Limits, RowsNameReadersAndKeys) {
  tasks::GraphConfig c;
  config::Section root;
  c.describe(root);
  const std::string scene = config::effective(root);
  for (const auto& r : tasks::kLimitTable) {
    const std::string to = " " + words(edge_of(r.edge).to) + " ";
    EXPECT_NE(to.find(" " + words(task_of(r.reader).name) + " "), std::string::npos)
        << edge_of(r.edge).name;
    EXPECT_GT(r.liveness_ms + r.data_age_ms, 0);
    std::istringstream keys{words(r.key)};
    for (std::string key; std::getline(keys, key, ',');) {
      key.erase(0, key.find_first_not_of(' '));
      const auto dot = key.find('.');
      ASSERT_NE(dot, std::string::npos) << key;
      const auto section = scene.find("[" + key.substr(0, dot) + "]");
      ASSERT_NE(section, std::string::npos) << key;
      // Commented out while it is the default.
      const std::string line = key.substr(dot + 1) + " = ";
      EXPECT_NE(std::min(scene.find("\n" + line, section), scene.find("\n# " + line, section)),
                std::string::npos)
          << key;
    }
  }
}

std::string ms(int value) { return value == 0 ? "-" : std::to_string(value) + " ms"; }

std::string page_tables() {
  const char* kinds[] = {"Latest", "Ring", "Remote"};
  std::ostringstream out;
  out << "| edge | from | to | kind | without it |\n|---|---|---|---|---|\n";
  for (const auto& e : tasks::kEdgeTable) {
    std::string to = words(e.to);
    for (std::size_t at = 0; (at = to.find(' ', at)) != std::string::npos; at += 2)
      to.replace(at, 1, ", ");
    out << "| " << e.name << " | " << e.from << " | " << to << " | "
        << kinds[static_cast<std::size_t>(e.kind)] << " | " << e.beyond << " |\n";
  }
  out << "\n| edge | reader | liveness | age | beyond it | keys |\n|---|---|---|---|---|---|\n";
  for (const auto& r : tasks::kLimitTable) {
    out << "| " << edge_of(r.edge).name << " | " << task_of(r.reader).name << " | "
        << ms(r.liveness_ms) << " | " << ms(r.data_age_ms) << " | " << r.beyond << " | `" << r.key
        << "` |\n";
  }
  return out.str();
}

TEST(Limits, PageIsTheTable) {
  constexpr const char* kBegin = "<!-- tables: tests/unit/tasks_graph writes them -->\n";
  constexpr const char* kEnd = "<!-- end of tables -->\n";
  const std::string path = std::string(TELETACT_SOURCE_DIR) + "/docs/architecture.md";
  std::ostringstream in;
  in << std::ifstream(path).rdbuf();
  const std::string text = in.str();
  const auto begin = text.find(kBegin), end = text.find(kEnd);
  ASSERT_NE(begin, std::string::npos);
  ASSERT_NE(end, std::string::npos);
  const auto from = begin + std::string_view(kBegin).size();
  if (std::getenv("TELETACT_UPDATE") != nullptr) {
    std::ofstream(path) << text.substr(0, from) << page_tables() << text.substr(end);
    return;
  }
  EXPECT_EQ(text.substr(from, end - from), page_tables());
}

}  // namespace
