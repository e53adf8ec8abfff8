// What is asked by a page that does little: a pointer that rests, a quick tap; what is taken back,
// and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/unit/desk_run/person.hpp"

namespace {

using desk_run::Person;
using nlohmann::json;
using teletact::DemoOptions;
using testing::HasSubstr;

json hand(double x, double y, bool press) {
  return {{"act", "hand"},  {"p", {x, y, 0.0}}, {"normal", {0, 0, 1}},
          {"press", press}, {"button", false},  {"clutch", false}};
}
json disc(int id, double x, double y, double z, double radius) {
  return {{"act", "draw"},
          {"obstacle",
           {{"id", id},
            {"kind", "disc"},
            {"centre", {x, y, z}},
            {"half", {radius, radius, 0.1}},
            {"yaw", 0}}}};
}
std::string told(const Person& p, const std::string& kind) {
  std::string all;
  for (const auto& e : p.desk->events().newest())
    if (e.kind == kind) all += e.text + "\n";
  return all;
}

// A line that is late: the page goes on saying that it holds, and learns that it does not.
TEST(DeskRun, AHoldThatLapsedIsToldUntilItIsLetGo) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  json held, lapsed, said_again, let_go;
  p.act = [&](double t) {
    if (p.once("press", t, 1.0)) p.holds = json::array({"hand"});
    if (p.once("held", t, 2.0)) {
      held = json::parse(p.text)["lost"];
      p.holds = nullptr;
    }
    if (p.once("lapsed", t, 2.8)) {
      lapsed = json::parse(p.text)["lost"];
      p.holds = json::array({"hand"});
    }
    if (p.once("again", t, 3.4)) {
      said_again = json::parse(p.text)["lost"];
      p.holds = json::array();
    }
  };
  desk_run::run(*s, 4, p);
  let_go = json::parse(p.text)["lost"];
  EXPECT_EQ(held, json::array());
  EXPECT_EQ(lapsed, json::array({"hand"}));
  EXPECT_EQ(said_again, json::array({"hand"}));
  EXPECT_EQ(let_go, json::array());
}

// The page says where the hand is when it is moved; a pointer that rests on the floor touches on.
TEST(DeskRun, ATouchGoesOnWhileThePointerRestsAndATapIsNotRefused) {
  constexpr double kX = 1.85, kY = -0.38;
  auto s = desk_run::scene();
  Person p;
  bool first_step = false;
  std::vector<bool> contact;
  p.act = [&](double t) {
    if (p.once("tap", t, 1.0)) {
      p.say({{"act", "token"}, {"holds", {"hand"}}});
      p.say(hand(kX, kY, true));
      p.say(hand(kX, kY, false));
      p.say({{"act", "token"}, {"holds", json::array()}});
    }
    if (p.once("press", t, 1.5)) {
      p.holds = json::array({"hand"});
      p.say({{"act", "token"}, {"holds", {"hand"}}});
      p.say(hand(kX, kY, true));
    }
    for (const double at : {4.5, 5.9})
      if (p.once("look" + std::to_string(at), t, at))
        contact.push_back(p.seen().haptic.back().in_contact);
    if (p.once("leave", t, 6.0)) {
      first_step = p.desk->acts().first_steps().touch;
      p.holds = json::array();
    }
    // A press that says nowhere is none, though one before it did.
    if (p.once("empty", t, 7.5)) p.holds = json::array({"hand"});
    if (p.once("late", t, 8.5)) contact.push_back(p.seen().haptic.back().in_contact);
  };
  static_cast<void>(desk_run::run(*s, 9, p));
  EXPECT_EQ(p.desk->refused(), 0U) << (p.answers.empty() ? "" : p.answers.begin()->second.why);
  EXPECT_TRUE(first_step);
  EXPECT_THAT(contact, testing::ElementsAre(true, true, false));
}

// A box whose paced clock is slower than real time looks at what came long ago by the real one: by
// its own clock that was after its last look. On the real clock such a press is too old.
TEST(DeskRun, OnASlowPacedClockAPressIsNotOld) {
  for (const bool paced : {true, false}) {
    auto s = desk_run::scene();
    Person p;
    p.paced = paced;
    p.late_ns = 400'000'000;
    std::int64_t engage = 0;
    p.act = [&](double t) {
      if (!p.once("engage", t, 1.0)) return;
      p.holds = json::array({"engage"});
      p.say({{"act", "token"}, {"holds", {"engage"}}});
      engage = p.say({{"act", "engage"}});
    };
    static_cast<void>(desk_run::run(*s, 3, p));
    EXPECT_EQ(p.answers[engage].ok, paced) << p.answers[engage].why;
    EXPECT_EQ(p.seen().mode.mode == tasks::Mode::kEngaged, paced);
  }
}

// Each act with its answer, and who acts.
TEST(DeskRun, ActsAndAnswersAreLogged) {
  auto s = desk_run::scene();
  Person p;
  p.log = (desk_run::folder() / "acts.log").string();
  std::int64_t drop = 0, none = 0;
  p.act = [&](double t) {
    if (p.once("join", t, 0.5))
      p.desk->role({teletact::RoleEvent::Kind::kJoined,
                    {7, "ada", teletact::ConsoleRole::kOperator, false, true},
                    {}});
    if (p.once("acts", t, 1.0)) {
      drop = p.say({{"act", "cancel"}});
      none = p.say({{"act", "unmark"}, {"mark_id", 9}});
    }
  };
  static_cast<void>(desk_run::run(*s, 1.5, p));
  p.desk.reset();
  std::ostringstream text;
  text << std::ifstream(p.log).rdbuf();
  EXPECT_THAT(text.str(), HasSubstr("role ada (session 7) acts from now on\n"));
  const auto line = [](std::int64_t id, const char* of, const char* end) {
    return std::string(of) + " session 1, " + std::to_string(id) + ": " + end + "\n";
  };
  EXPECT_THAT(text.str(), HasSubstr(line(drop, "act", "cancel")));
  EXPECT_THAT(text.str(), HasSubstr(line(drop, "answer", "done")));
  EXPECT_THAT(text.str(), HasSubstr(line(none, "answer", "refused: no such mark is drawn")));
}

// A later mark of the haptic hand has the goal: taking back the page's does not drop it.
TEST(DeskRun, UndoOfAMarkLeavesTheGoalThatTheHandHasMarkedSince) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  json before, after;
  std::int64_t undo = 0;
  const auto press = [](bool button) {
    json h = hand(1.85, -0.38, true);
    h["button"] = button;
    return h;
  };
  p.act = [&](double t) {
    if (p.once("mark", t, 1.0))
      p.say({{"act", "mark"}, {"points", {{1.2, 0.7, 0.0}, {1.25, 0.7, 0.0}}}});
    if (p.once("press", t, 2.0)) {
      p.holds = json::array({"hand"});
      p.say({{"act", "token"}, {"holds", {"hand"}}});
      p.say(press(false));
    }
    if (p.once("draw", t, 3.5)) p.say(press(true));
    if (p.once("drawn", t, 4.0)) p.say(press(false));
    if (p.once("leave", t, 4.5)) p.holds = json::array();
    if (p.once("look", t, 5.4)) before = json::parse(p.text);
    if (p.once("undo", t, 5.5)) undo = p.say({{"act", "undo"}});
    if (p.once("look again", t, 6.4)) after = json::parse(p.text);
  };
  static_cast<void>(desk_run::run(*s, 6.6, p));
  ASSERT_FALSE(before["marked"].is_null());
  EXPECT_NEAR(before["marked"][0], 1.85, 0.1) << "the hand's mark has the goal";
  EXPECT_TRUE(p.answers[undo].ok) << p.answers[undo].why;
  EXPECT_THAT(p.answers[undo].result, HasSubstr("the goal of the hand's mark stays"));
  EXPECT_TRUE(after["marks"].empty());
  EXPECT_EQ(after["marked"], before["marked"]);
}

TEST(DeskRun, EachActIsOneUndoAndWhatIsForgottenDoesNotComeBack) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  std::map<std::string, std::int64_t> ids;
  std::map<std::string, json> texts;
  std::map<std::string, std::size_t> drawn;
  const json undo{{"act", "undo"}};
  const json mark{{"act", "mark"}, {"points", {{1.2, 0.7, 0.0}, {1.25, 0.7, 0.0}}}};
  bool by_place = true, by_mark = false;
  p.act = [&](double t) {
    const auto say = [&](const char* what, double at, const json& act) {
      if (p.once(what, t, at)) ids[what] = p.say(act);
    };
    const auto look = [&](const char* what, double at) {
      if (!p.once(std::string("look ") + what, t, at)) return;
      texts[what] = json::parse(p.text);
      drawn[what] = p.desk->acts().obstacles().size();
    };
    for (const int k : {1, 2, 3}) {
      const std::string what = "draw" + std::to_string(k);
      if (p.once(what, t, 1.5)) ids[what] = p.say(disc(k, 0.8 * k, -1.0, 0, 0.1));
    }
    say("erase", 1.7, {{"act", "erase"}, {"obstacle_id", 0}});
    look("erased", 1.9);
    say("undo erase", 2.0, undo);
    look("back", 2.4);
    say("forget", 2.5, {{"act", "forget"}, {"centre", {2.0, 0.0, 0.3}}, {"half", {0.1, 0.1, 0.1}}});
    say("undo forget", 2.6, undo);
    look("forgotten", 2.7);
    say("undo draw", 2.8, undo);
    look("one less", 2.9);
    say("go", 3.0, {{"act", "go_to"}, {"x", 1.43}, {"y", 0.70}});
    if (p.once("steps", t, 3.9)) by_place = p.desk->acts().first_steps().mark;
    say("undo go", 4.0, undo);
    look("no goal", 4.6);
    say("mark", 4.7, mark);
    if (p.once("steps 2", t, 4.8)) by_mark = p.desk->acts().first_steps().mark;
    look("marked", 5.6);
    say("undo mark", 5.7, undo);
    look("unmarked", 6.3);
    say("mark 2", 6.4, mark);
    look("marked 2", 7.2);
    if (p.once("unmark", t, 7.3)) ids["unmark"] = p.say({{"act", "unmark"}, {"mark_id", 2}});
    say("unmark again", 7.4, {{"act", "unmark"}, {"mark_id", 2}});
    look("deleted", 7.9);
    say("undo delete", 8.0, undo);
    look("mark back", 8.4);
  };
  static_cast<void>(desk_run::run(*s, 8.6, p));
  for (const auto& [what, id] : ids) {
    const bool refused = what == "undo forget" || what == "unmark again";
    EXPECT_EQ(p.answers[id].ok, !refused) << what << ": " << p.answers[id].why;
  }
  EXPECT_EQ(drawn["erased"], 0U);
  EXPECT_EQ(drawn["back"], 3U) << "one undo";
  EXPECT_THAT(p.answers[ids["undo erase"]].result, HasSubstr("3 keep-outs are back"));
  EXPECT_THAT(p.answers[ids["undo forget"]].why, HasSubstr("does not come back"));
  EXPECT_EQ(drawn["forgotten"], 3U) << "nothing else is taken back for it";
  EXPECT_EQ(drawn["one less"], 2U);
  EXPECT_FALSE(by_place) << "a place is no mark";
  EXPECT_TRUE(by_mark);
  EXPECT_TRUE(texts["no goal"]["marked"].is_null()) << texts["no goal"]["marked"];
  EXPECT_EQ(texts["marked"]["marks"].size(), 1U);
  EXPECT_FALSE(texts["marked"]["marked"].is_null());
  EXPECT_TRUE(texts["unmarked"]["marks"].empty()) << "an undone mark is no mark";
  EXPECT_TRUE(texts["unmarked"]["marked"].is_null());
  EXPECT_EQ(texts["marked 2"]["phase"], "driving");
  EXPECT_TRUE(texts["deleted"]["marks"].empty());
  EXPECT_EQ(texts["deleted"]["phase"], "idle") << "its goal went with it";
  EXPECT_EQ(texts["mark back"]["marks"].size(), 1U);
  EXPECT_EQ(texts["mark back"]["phase"], "idle") << "no goal is set by it";
}

TEST(DeskRun, PlacesBeyondTheMapAreRefusedAndAGoalGivenUpHasAReason) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  std::vector<std::int64_t> beyond;
  std::int64_t round = 0, lost = 0;
  p.act = [&](double t) {
    if (p.once("beyond", t, 1.5)) {
      beyond.push_back(p.say({{"act", "go_to"}, {"x", 900}, {"y", 900}}));
      beyond.push_back(
          p.say({{"act", "mark"}, {"points", json::array({json::array({500, 500, 500})})}}));
      beyond.push_back(p.say(disc(1, 1, 0, 900, 0.2)));
      beyond.push_back(p.say(disc(2, 0, 0, 0, 20)));
      round = p.say(disc(4, 0, 0, 0, 1.5));
    }
    if (p.once("lost", t, 2.5)) lost = p.say({{"act", "go_to"}, {"x", 2.0}, {"y", 0.7}});
  };
  static_cast<void>(desk_run::run(*s, 9, p));
  for (const auto id : beyond) EXPECT_FALSE(p.answers[id].ok) << id;
  EXPECT_THAT(p.answers[beyond[0]].why, HasSubstr("outside the map of the floor"));
  EXPECT_THAT(p.answers[beyond[2]].why, HasSubstr("above the floor"));
  EXPECT_TRUE(p.answers[round].ok) << p.answers[round].why;
  EXPECT_THAT(p.answers[round].result, HasSubstr("the base stands in it"));
  EXPECT_TRUE(p.answers[lost].ok) << p.answers[lost].why;
  const json text = json::parse(p.text);
  EXPECT_EQ(text["phase"], "failed");
  EXPECT_THAT(text["held"].get<std::string>(), HasSubstr("the goal was given up: from where"));
  EXPECT_THAT(told(p, "task"), HasSubstr("failed, from where it stands"));
}

TEST(DeskRun, DrivenByHandIntoAKeepOutThePersonIsTold) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  json while_driven, after;
  p.holds = json::array({"engage"});
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) p.say({{"act", "engage"}});
    if (p.once("draw", t, 1.6)) p.say(disc(3, 0.9, 0, 0, 0.2));
    if (p.once("press", t, 2.5)) {
      p.holds = json::array({"engage", "drive"});
      p.driven = json{{"act", "drive"}, {"vx", 0.3}, {"vy", 0.0}, {"wz", 0.0}};
    }
    if (p.once("look", t, 5.0)) while_driven = json::parse(p.text);
    if (p.once("leave", t, 5.1)) p.holds = json::array({"engage"}), p.driven.reset();
    if (p.once("end", t, 6.0)) after = json::parse(p.text);
  };
  static_cast<void>(desk_run::run(*s, 6.2, p));
  EXPECT_EQ(while_driven.value("drive_warning", ""), "The base is in keep-out 3.");
  EXPECT_FALSE(after.contains("drive_warning"));
  EXPECT_EQ(told(p, "keep-out"),
            "Keep-out 3 is ahead: driven by hand, nothing stops the base.\n"
            "The base is in keep-out 3.\n");
}

// The robot's box stops while the operator's holds, which that does not move: it is told, and a
// clear is what helps.
TEST(DeskRun, ASafeStopOfTheRobotAloneIsTheReasonWhyAnEngageIsRefused) {
  auto s = desk_run::scene();
  DemoOptions options;
  options.fault_plan = (desk_run::folder() / "still.toml").string();
  std::ofstream(options.fault_plan) << "name = 'still'\npurpose = 'robot_io stands still'\n"
                                       "[[fault]]\nkind = 'late_release'\ntarget = 'robot_io'\n"
                                       "first = 1500\ncount = 1\nmagnitude_us = 400000\n";
  Person p;
  p.viewers = 1;
  json stopped, after;
  std::string line;
  std::int64_t first = 0, cleared = 0, second = 0;
  p.act = [&](double t) {
    if (p.once("look", t, 2.8)) stopped = json::parse(p.text), line = p.status_line();
    if (p.once("press", t, 3.0)) {
      p.holds = json::array({"engage"});
      first = p.say({{"act", "engage"}});
    }
    if (p.once("let go", t, 3.2)) p.holds = json::array();
    if (p.once("clear", t, 3.4)) cleared = p.say({{"act", "clear"}});
    if (p.once("press again", t, 5.0)) {
      p.holds = json::array({"engage"});
      second = p.say({{"act", "engage"}});
    }
    if (p.once("end", t, 5.8)) after = json::parse(p.text);
  };
  static_cast<void>(desk_run::run(*s, 6, p, options));
  EXPECT_EQ(stopped.value("mode", ""), "hold");
  EXPECT_EQ(stopped.value("robot_mode", ""), "safe stop");
  const std::string cause = stopped.value("robot_cause", "");
  EXPECT_THAT(cause, HasSubstr("F-RIO-90"));
  EXPECT_THAT(stopped["faults"].dump(), HasSubstr("at the robot: "));
  EXPECT_THAT(told(p, "robot"), HasSubstr("the robot's box: safe stop: " + cause));
  EXPECT_THAT(line, HasSubstr("ROBOT IN A SAFE STOP: " + cause));
  EXPECT_FALSE(p.answers.at(first).ok);
  EXPECT_EQ(p.answers.at(first).why,
            "the robot's box is in a safe stop, " + cause + ": clear it first");
  EXPECT_TRUE(p.answers.at(cleared).ok) << p.answers.at(cleared).why;
  EXPECT_THAT(told(p, "clear"), HasSubstr("safe stop cleared by the operator"));
  EXPECT_TRUE(p.answers.at(second).ok) << p.answers.at(second).why;
  EXPECT_EQ(after.value("mode", ""), "engaged");
  EXPECT_FALSE(after.contains("robot_cause"));
}

// Each job late: the executor stops the motors again and again. That is told, and no clear helps.
TEST(DeskRun, ARobotThatIsAlwaysLateIsToldAndClearingItIsRefused) {
  auto s = desk_run::scene();
  DemoOptions options;
  options.fault_plan = (desk_run::folder() / "late.toml").string();
  std::ofstream(options.fault_plan) << "name = 'late'\npurpose = 'each job of robot_io is late'\n"
                                       "[[fault]]\nkind = 'late_release'\ntarget = 'robot_io'\n"
                                       "first = 1500\nmagnitude_us = 400000\n";
  Person p;
  p.viewers = 1;
  json after;
  std::int64_t cleared = 0;
  p.act = [&](double t) {
    if (p.once("clear", t, 3.0)) cleared = p.say({{"act", "clear"}});
    if (p.once("end", t, 5.4)) after = json::parse(p.text);
  };
  static_cast<void>(desk_run::run(*s, 5.8, p, options));
  EXPECT_FALSE(p.answers.at(cleared).ok);
  EXPECT_EQ(after.value("robot_mode", ""), "safe stop");
  EXPECT_THAT(after["faults"].dump(), HasSubstr("F-RIO-32"));
}

// A clear while the cause lasts is no success, and says what is still there.
TEST(DeskRun, AClearThatEndsNothingIsRefused) {
  auto s = desk_run::scene();
  DemoOptions options;
  options.fault_plan = (desk_run::folder() / "lasting.toml").string();
  std::ofstream plan(options.fault_plan);
  plan << "name = 'lasting'\npurpose = 'the hand is gone'\n"
          "[[fault]]\nkind = 'dead_thread'\ntarget = 'haptic'\nfirst = 1500\n";
  plan.close();
  Person p;
  p.viewers = 1;
  std::int64_t id = 0;
  p.act = [&](double t) {
    if (p.once("clear", t, 2.8)) id = p.say({{"act", "clear"}});
  };
  static_cast<void>(desk_run::run(*s, 5.2, p, options));
  EXPECT_FALSE(p.answers.at(id).ok);
  EXPECT_THAT(p.answers.at(id).why, HasSubstr("still in a safe stop, F-"));
  EXPECT_THAT(p.answers.at(id).why, HasSubstr("; to do: "));
  EXPECT_EQ(told(p, "clear"), "");
}

// What the robot's box said last is not what it is: it may be off, or started anew.
TEST(DeskRun, ARobotThatHasFallenSilentIsTheReasonWhyAnEngageIsRefused) {
  auto s = desk_run::scene();
  DemoOptions options;
  options.fault_plan = (desk_run::folder() / "silent.toml").string();
  std::ofstream(options.fault_plan)
      << "name = 'silent'\npurpose = 'no state comes any more'\n"
         "[[fault]]\nkind = 'dead_thread'\ntarget = 'robot_io'\nfirst = 1500\n";
  Person p;
  p.viewers = 1;
  std::int64_t pressed = 0, cleared = 0;
  p.act = [&](double t) {
    if (p.once("clear", t, 2.6)) cleared = p.say({{"act", "clear"}});
    if (p.once("press", t, 2.8)) {
      p.holds = json::array({"engage"});
      pressed = p.say({{"act", "engage"}});
    }
  };
  static_cast<void>(desk_run::run(*s, 3, p, options));
  EXPECT_FALSE(p.answers.at(pressed).ok);
  EXPECT_THAT(p.answers.at(pressed).why, HasSubstr("nothing comes from the robot's box; to do: "));
  EXPECT_FALSE(p.answers.at(cleared).ok);
  EXPECT_THAT(p.answers.at(cleared).why, HasSubstr("nothing comes from the robot's box; to do: "));
}

}  // namespace
