// Each fault of rules/tasks/haptic/touch_rules.hpp must fail the check of the hard cases that is
// there for it; without one the same check is met.
#include <gtest/gtest.h>

#include <map>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "tasks/haptic/touch_rules.hpp"
#include "tools/measure/stability/cases.hpp"

namespace {

using stability::Check;
using stability::Run;
using stability::Setting;
using tasks::Broken;

struct Fault {
  Broken broken;
  const char* name;
  std::vector<Run> (*run)(const Setting&);
  const char* part;  // of the run's name
  const char* check;
};
const Fault kFaults[] = {
    {Broken::kTouchesOutOfTheUnknown, "TouchesOutOfTheUnknown", &stability::case_border, "",
     "force out of the unknown N"},
    {Broken::kClutchCutsForce, "ClutchCutsForce", &stability::case_start_inside, "re-clutch",
     "J while the clutch is pressed N"},
    {Broken::kClutchKeepsForce, "ClutchKeepsForce", &stability::case_start_inside, "re-clutch",
     "force while clutched N"},
    {Broken::kClutchMovesHand, "ClutchMovesHand", &stability::case_start_inside, "re-clutch",
     "hand in the scene moved mm"},
    {Broken::kAnchorLeaks, "AnchorLeaks", &stability::case_friction_hold, "",
     "hold friction error N"},
    {Broken::kBreaksLooseEarly, "BreaksLooseEarly", &stability::case_friction_hold, "",
     "breakaway friction error N"},
    {Broken::kBumpsTooLow, "BumpsTooLow", &stability::case_texture, "", "amplitude error %"},
    {Broken::kReachFollowsSpeed, "ReachFollowsSpeed", &stability::case_texture, "",
     "loop energy at b 2 mJ"},
    {Broken::kReachFollowsSpeed, "ReachFollowsSpeedOnAHeavyDevice", &stability::case_texture, "",
     "loop energy at b 20 mJ"},
    {Broken::kBumpsTurnTheNormal, "BumpsTurnTheNormal", &stability::case_texture, "",
     "loop energy at b 2 mJ"},
    {Broken::kBumpsTurnTheNormal, "BumpsTurnTheNormalOnAHeavyDevice", &stability::case_texture, "",
     "loop energy at b 20 mJ"},
    {Broken::kTipWithoutRadius, "TipWithoutRadius", &stability::case_slots, "5 mm",
     "not pushed out of the slot N"},
};

struct Judged {
  std::string run;
  std::vector<Check> checks;
};

// Several faults are of one case, and each is judged beside the case without one: a case is run
// once for each.
const std::vector<Judged>& judged(std::vector<Run> (*run)(const Setting&), Broken broken,
                                  std::size_t place) {
  using Key = std::tuple<std::vector<Run> (*)(const Setting&), Broken, std::size_t>;
  static std::map<Key, std::vector<Judged>> known;
  const auto [at, is_new] = known.try_emplace(Key{run, broken, place});
  if (!is_new) return at->second;
  Setting s;
  s.place = rig::placements()[place];
  s.judged = false;
  tasks::broken_now = broken;
  for (const Run& each : run(s)) at->second.push_back({each.name, each.checks});
  tasks::broken_now = Broken::kNone;
  return at->second;
}

// The named check of every run that has it.
std::vector<Check> checks(const Fault& fault, Broken broken, std::size_t place) {
  std::vector<Check> out;
  for (const Judged& run : judged(fault.run, broken, place)) {
    if (run.run.find(fault.part) == std::string::npos) continue;
    for (const Check& c : run.checks) {
      if (c.name == fault.check) out.push_back(c);
    }
  }
  if (out.empty()) throw std::runtime_error(std::string("no check ") + fault.check);
  return out;
}

class Faults : public testing::TestWithParam<Fault> {};

TEST_P(Faults, AreSeenAndTheProductIsNot) {
  for (const std::size_t place : {0U, 4U}) {
    for (const Check& c : checks(GetParam(), Broken::kNone, place)) {
      EXPECT_TRUE(c.met()) << c.name << " " << c.value << " at place " << place;
    }
    for (const Check& c : checks(GetParam(), GetParam().broken, place)) {
      EXPECT_FALSE(c.met()) << c.name << " " << c.value << " at place " << place;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Faults, testing::ValuesIn(kFaults),
                         [](const testing::TestParamInfo<Fault>& each) {
                           return std::string(each.param.name);
                         });

}  // namespace
