// Every row of docs/faults.md: it lasts 10 s while a person drives; then the person does what the
// row says and nothing else, and the robot drives again, or the page says that it will not.
#include "tests/fault/walk/walk.hpp"

#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

#include "tests/support/paths.hpp"
#include "tests/support/whole.hpp"

namespace walk {
namespace {

struct Count {
  int walked = 0, driven = 0, final = 0;
};

void judge(const Story& story, Count& count) {
  SCOPED_TRACE(story.code + " " + story.what);
  const Outcome o = walk(story);
  std::string causes;
  for (const auto& c : o.causes) causes += " " + c;
  std::printf("  %-9s %-30s %-8s %s, clears %d, engages %d, %.1f s; causes:%s %s\n",
              story.code.c_str(), story.what.c_str(), story.engaged ? "driving" : "holding",
              o.driven  ? "drives"
              : o.final ? "final"
                        : "STANDS",
              o.clears, o.engages, o.after_s, causes.c_str(), o.words.c_str());
  std::fflush(stdout);
  EXPECT_TRUE(o.ready) << "it did not drive before the fault";
  EXPECT_TRUE(o.seen) << "the fault was not made";
  EXPECT_TRUE(o.driven || o.final) << o.words;
  ++count.walked, count.driven += o.driven ? 1 : 0, count.final += o.final ? 1 : 0;
}

TEST(Walk, EachRowIsFollowedUntilTheRobotDrivesAgain) {
  Count count;
  const char* const only = std::getenv("TELETACT_WALK");
  for (Story story : stories()) {
    if (only != nullptr ? story.code != only : !tests::whole() && !story.short_run) continue;
    judge(story, count);
    // What stops the robot's box alone.
    if (row_of(story.code).clear != tasks::ClearRule::kOperator || story.code.starts_with("F-HAP"))
      continue;
    story.engaged = false;
    if (tests::whole() || only != nullptr || story.holding_too) judge(story, count);
  }
  std::printf("  %d walked: %d drive again, %d are final\n", count.walked, count.driven,
              count.final);
}

// Each row is walked, or another test makes it; what is named there is there.
TEST(Walk, EveryRowHasAStory) {
  std::map<std::string, int> rows;
  for (const auto& row : tasks::kFaultTable) rows[std::string(row.code)] = 0;
  for (const Story& s : stories()) ++rows.at(s.code);
  for (const Elsewhere& e : elsewhere()) {
    EXPECT_EQ(rows.at(e.code), 0) << e.code << " is walked";
    ++rows.at(e.code);
    const auto space = e.test.find(' ');
    const std::string file = tests::in_tree(e.test.substr(0, space));
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    EXPECT_NE(text.str().find(e.test.substr(space + 1)), std::string::npos)
        << e.code << ": " << e.test << " is not there";
  }
  for (const auto& [code, times] : rows) EXPECT_GE(times, 1) << code << " has no story";
}

}  // namespace
}  // namespace walk
