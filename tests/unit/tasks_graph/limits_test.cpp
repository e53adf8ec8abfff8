// The limits of kLimitTable are those in force: defaults of the configurations,
// docs/architecture.md. TELETACT_UPDATE=1 in the environment writes the page anew.
#include <gtest/gtest.h>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tasks/contract/table.hpp"
#include "tasks/graph/graph_config.hpp"
#include "tasks/graph/limits.hpp"
#include "tests/support/paths.hpp"

namespace {

using tasks::EdgeId;

std::string words(std::string_view text) { return std::string(text); }

const tasks::EdgeRow& edge_of(EdgeId id) { return tasks::kEdgeTable[tasks::index_of(id)]; }

// What is in force before a scene says anything is what the table says, in every row.
TEST(Limits, ConfigurationsStartFromTheTable) {
  const tasks::GraphConfig c;
  for (std::size_t i = 0; i < tasks::kLimitTable.size(); ++i) {
    const auto& row = tasks::kLimitTable[i];
    const tasks::Limit limit = tasks::limit_in_force(c, i);
    EXPECT_EQ(limit.liveness, std::chrono::milliseconds{row.liveness_ms}) << edge_of(row.edge).name;
    if (row.data_age_ms == tasks::kAgeless)
      EXPECT_EQ(limit.age, rt::Nanos::max()) << edge_of(row.edge).name;
    else
      EXPECT_EQ(limit.age, std::chrono::milliseconds{row.data_age_ms}) << edge_of(row.edge).name;
  }
}

// The keys of a row, of its liveness and of its age: its own, or those of [limits].
std::pair<std::string, std::string> keys_of(const tasks::LimitRow& r) {
  const std::string base =
      "limits." + words(tasks::reader_name(r.reader)) + "." + words(edge_of(r.edge).name);
  std::string age;
  if (!r.age_key.empty())
    age = words(r.age_key);
  else if (r.data_age_ms != tasks::kAgeless)
    age = base + "_age_ms";
  return {r.liveness_key.empty() ? base + "_liveness_ms" : words(r.liveness_key), age};
}

// Every row's limits can be set by the keys that the page names, and change what is in force.
TEST(Limits, KeysReachTheRow) {
  for (std::size_t i = 0; i < tasks::kLimitTable.size(); ++i) {
    const auto [liveness, age] = keys_of(tasks::kLimitTable[i]);
    for (const auto& key : {liveness, age}) {
      if (key.empty()) continue;
      tasks::GraphConfig c;
      config::Section root;
      c.describe(root);
      const tasks::Limit before = tasks::limit_in_force(c, i);
      const bool in_seconds = key.ends_with("_s");
      const auto ok = config::load_override(key + (in_seconds ? "=0.777" : "=777"), root);
      ASSERT_TRUE(ok) << key << ": " << ok.error();
      const tasks::Limit after = tasks::limit_in_force(c, i);
      const bool of_age = key == age;
      EXPECT_EQ(of_age ? after.age : after.liveness, std::chrono::milliseconds{777}) << key;
      EXPECT_EQ(of_age ? after.liveness : after.age, of_age ? before.liveness : before.age) << key;
      EXPECT_FALSE(config::load_override(key + "=-1", root)) << key;
    }
  }
}

std::string ms(int value) {
  return value == tasks::kAgeless ? "does not" : std::to_string(value) + " ms";
}

std::string page_tables() {
  const char* kinds[] = {"Latest", "Ring", "Remote"};
  std::ostringstream out;
  out << "| edge | from | to | kind | without it |\n|---|---|---|---|---|\n";
  for (const auto& e : tasks::kEdgeTable) {
    std::string to;
    for (const auto& r : tasks::kLimitTable) {
      if (r.edge == e.id) to += (to.empty() ? "" : ", ") + words(tasks::reader_name(r.reader));
    }
    out << "| " << e.name << " | " << tasks::reader_name(e.from) << " | " << to << " | "
        << kinds[static_cast<std::size_t>(e.kind)] << " | " << e.beyond << " |\n";
  }
  out << "\n| edge | reader | liveness | age | beyond it | keys of its own "
         "|\n|---|---|---|---|---|---|\n";
  for (const auto& r : tasks::kLimitTable) {
    out << "| " << edge_of(r.edge).name << " | " << tasks::reader_name(r.reader) << " | "
        << ms(r.liveness_ms) << " | " << ms(r.data_age_ms) << " | " << r.beyond << " | ";
    if (!r.liveness_key.empty() && !r.age_key.empty())
      out << "`" << r.liveness_key << "`, `" << r.age_key << "`";
    else if (!r.liveness_key.empty())
      out << "`" << r.liveness_key << "` (liveness)";
    else if (!r.age_key.empty())
      out << "`" << r.age_key << "` (age)";
    out << " |\n";
  }
  return out.str();
}

TEST(Limits, PageIsTheTable) {
  constexpr const char* kBegin = "<!-- tables: tests/unit/tasks_graph writes them -->\n";
  constexpr const char* kEnd = "<!-- end of tables -->\n";
  const std::string path = tests::in_tree("docs/architecture.md");
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
