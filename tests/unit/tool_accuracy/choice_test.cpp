// What a choice on one half of the data is worth on the other.
#include "tools/measure/accuracy/choice_study.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace {

using teletact::Choice;
using teletact::ChoiceRow;

// The third setting is the best of the first half and worth .02 more on the second; the second is
// the best there, and worse here.
ChoiceRow planted() {
  return {"planted", "score", {{.80, .70}, {.79, .75}, {.85, .72}, {.60, .60}}};
}

TEST(Choice, IsMadeOnOneHalfAndJudgedOnTheOther) {
  const ChoiceRow row = planted();
  EXPECT_EQ(row.best(0), 2U);
  EXPECT_EQ(row.best(1), 1U);
  EXPECT_EQ(row.better(0), 1);
  EXPECT_EQ(row.better(1), 2);
  EXPECT_NEAR(row.unseen_gain(0), -.01, 1e-12);
  EXPECT_NEAR(row.unseen_gain(1), .02, 1e-12);
}

TEST(Choice, AChoiceThatIsBetterUnseenIsAMiss) {
  Choice choice{{planted()}};
  EXPECT_EQ(teletact::missed(choice.limits()), 1);
  choice.rows[0].scores[2][1] = .709;
  EXPECT_EQ(teletact::missed(choice.limits()), 0);
}

TEST(Choice, TheDefaultIsChosenWhereNothingIsBetter) {
  const ChoiceRow row{"planted", "score", {{.9, .9}, {.8, .8}}};
  EXPECT_EQ(row.best(0), 0U);
  EXPECT_EQ(row.unseen_gain(0), 0);
}

TEST(Choice, AHalfWithoutObjectsIsNotMeasured) {
  const Choice choice{{{"planted", "score", {{.9, std::nan("")}, {.8, std::nan("")}}}}};
  EXPECT_EQ(teletact::missed(choice.limits()), 0);
  std::ostringstream said;
  choice.print(said);
  EXPECT_NE(said.str().find("no object in this half"), std::string::npos) << said.str();
}

TEST(Choice, AFolderOfNeitherKindIsRefused) {
  std::ostringstream progress;
  EXPECT_THROW(static_cast<void>(teletact::study_choice(progress, {"/nonexistent", 1, 1})),
               std::runtime_error);
}

}  // namespace
