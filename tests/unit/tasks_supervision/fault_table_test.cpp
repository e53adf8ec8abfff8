// docs/faults.md is the table of fault_ids.hpp, and every id that a task's header names has a row.
// TELETACT_UPDATE=1 in the environment writes the page anew.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tasks/supervision/fault_ids.hpp"
#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;
using tasks::kFaultTable;

std::string read(const fs::path& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

const char* severity_name(rt::Severity s) {
  switch (s) {
    case rt::Severity::kOk:
      return "ok";
    case rt::Severity::kCounted:
      return "count";
    case rt::Severity::kDegraded:
      return "degrade";
    case rt::Severity::kRampDown:
      return "ramp down";
    case rt::Severity::kSafeStop:
      return "safe stop";
  }
  return "";
}

const char* clear_name(tasks::ClearRule c) {
  switch (c) {
    case tasks::ClearRule::kItself:
      return "by itself";
    case tasks::ClearRule::kOperator:
      return "by the operator";
    case tasks::ClearRule::kRestart:
      return "by restart";
  }
  return "";
}

std::vector<tasks::FaultRow> by_code() {
  std::vector<tasks::FaultRow> sorted(kFaultTable.begin(), kFaultTable.end());
  std::sort(sorted.begin(), sorted.end(),
            [](const auto& a, const auto& b) { return a.code < b.code; });
  return sorted;
}

std::string rows() {
  std::ostringstream out;
  out << "| fault | id | what happened | severity | reaction | clears |\n"
      << "|---|---|---|---|---|---|\n";
  for (const auto& r : by_code()) {
    out << "| " << r.code << " | " << r.id << " | " << r.what << " | " << severity_name(r.severity)
        << " | " << r.reaction << " | " << clear_name(r.clear) << " |\n";
  }
  return out.str();
}

std::string advice_rows() {
  std::ostringstream out;
  out << "| fault | what to do |\n|---|---|\n";
  for (const auto& r : by_code()) out << "| " << r.code << " | " << r.advice << " |\n";
  return out.str();
}

// The part of the page between two marks is `wanted`.
void expect_on_page(std::string_view after, std::string_view before, const std::string& wanted) {
  const fs::path page = tests::in_tree("docs/faults.md");
  const std::string text = read(page);
  const auto begin = text.find(after), end = text.find(before);
  ASSERT_NE(begin, std::string::npos);
  ASSERT_NE(end, std::string::npos);
  const auto from = begin + after.size();
  if (std::getenv("TELETACT_UPDATE") != nullptr) {
    std::ofstream(page) << text.substr(0, from) << wanted << text.substr(end);
    return;
  }
  EXPECT_EQ(text.substr(from, end - from), wanted)
      << "run this test once with TELETACT_UPDATE=1 to write docs/faults.md";
}

TEST(FaultTable, PageIsTheTable) {
  expect_on_page("<!-- table: tests/unit/tasks_supervision writes it -->\n",
                 "<!-- end of table -->\n", rows());
}

TEST(FaultTable, PageSaysWhatToDo) {
  expect_on_page("<!-- advice: tests/unit/tasks_supervision writes it -->\n",
                 "<!-- end of advice -->\n", advice_rows());
}

TEST(FaultTable, EveryRowSaysWhatHappenedWhatIsDoneAndWhatToDo) {
  for (const auto& r : kFaultTable) {
    for (const auto text : {r.what, r.reaction, r.advice}) {
      EXPECT_GE(text.size(), 4U) << r.code;
      EXPECT_EQ(text.find('|'), std::string_view::npos) << r.code << " would break the page";
    }
  }
}

TEST(FaultTable, IdsAndCodesAreUnique) {
  std::set<std::string_view> codes;
  for (const auto& r : kFaultTable) {
    EXPECT_TRUE(codes.insert(r.code).second) << r.code;
    EXPECT_NE(r.id, rt::kNoFault);
    EXPECT_EQ(tasks::fault_row(r.id), &r - kFaultTable.data());
    EXPECT_GT(r.severity, rt::Severity::kOk);
  }
  EXPECT_EQ(tasks::fault_row(4242), -1);
  for (int id = tasks::kFaultEstop; id <= tasks::kFaultUnknown; ++id) {
    EXPECT_GE(tasks::fault_row(static_cast<rt::FaultId>(id)), 0);
  }
}

// The constants of the tasks are found by their text, since no task may include another.
TEST(FaultTable, EveryIdNamedByATaskHasARow) {
  const std::regex constant(R"(constexpr\s+rt::FaultId\s+(\w+)\s*=\s*(0x[0-9a-fA-F]+|\d+)\s*;)");
  int found = 0;
  std::map<unsigned long, std::string> owners;
  for (const auto& entry : fs::recursive_directory_iterator(tests::in_tree("tasks"))) {
    if (entry.path().extension() != ".hpp") continue;
    const std::string text = read(entry.path());
    for (std::sregex_iterator it(text.begin(), text.end(), constant), last; it != last; ++it) {
      const auto id = std::stoul((*it)[2].str(), nullptr, 0);
      ++found;
      const auto [owner, is_new] = owners.emplace(id, entry.path().filename().string());
      EXPECT_TRUE(is_new) << id << " is used by " << owner->second << " and by " << entry.path();
      EXPECT_GE(tasks::fault_row(static_cast<rt::FaultId>(id)), 0)
          << entry.path() << ": " << (*it)[1] << " = " << id << " has no row in fault_ids.hpp";
    }
  }
  EXPECT_GE(found, 9);
}

rt::Severity severity_of(const std::string& name) {
  if (name == "kCounted") return rt::Severity::kCounted;
  if (name == "kDegraded") return rt::Severity::kDegraded;
  if (name == "kRampDown") return rt::Severity::kRampDown;
  if (name == "kSafeStop") return rt::Severity::kSafeStop;
  ADD_FAILURE() << name;
  return rt::Severity::kOk;
}

// Supervision takes the worse of what a task reports and what the row says. A report that is worse
// than its row does what the page does not say.
TEST(FaultTable, NoTaskReportsAFaultAsWorseThanItsRowSays) {
  const std::regex constant(R"(constexpr\s+rt::FaultId\s+(\w+)\s*=\s*(0x[0-9a-fA-F]+|\d+)\s*;)");
  const std::regex report(R"(Health::of\(\s*(?:rt::)?Severity::(\w+),\s*(?:\w+::)*(k\w+)\s*\))");
  std::map<std::string, rt::FaultId> ids;
  std::vector<fs::path> sources;
  for (const auto& entry : fs::recursive_directory_iterator(tests::in_tree("tasks"))) {
    if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
    sources.push_back(entry.path());
    const std::string text = read(entry.path());
    for (std::sregex_iterator it(text.begin(), text.end(), constant), last; it != last; ++it)
      ids[(*it)[1]] = static_cast<rt::FaultId>(std::stoul((*it)[2].str(), nullptr, 0));
  }
  int found = 0;
  for (const auto& path : sources) {
    const std::string text = read(path);
    for (std::sregex_iterator it(text.begin(), text.end(), report), last; it != last; ++it) {
      const auto id = ids.find((*it)[2]);
      ASSERT_NE(id, ids.end()) << path << ": " << (*it)[0];
      const int row = tasks::fault_row(id->second);
      ASSERT_GE(row, 0);
      EXPECT_LE(severity_of((*it)[1]), kFaultTable[static_cast<std::size_t>(row)].severity)
          << path << ": " << (*it)[0];
      ++found;
    }
  }
  EXPECT_GE(found, 25);
}

}  // namespace
