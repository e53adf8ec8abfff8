// What a person has put into a scene is saved, taken away, and opened again; the run replays. A run
// that starts with a session has its keep-outs before anything moves.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/unit/desk_run/person.hpp"

namespace {

using desk_run::Person;
using nlohmann::json;
using teletact::SessionStore;
using testing::HasSubstr;

constexpr const char* kWorld = "00000000000000aa";

json drawn(int id, double x_m) {
  return {{"act", "draw"},
          {"obstacle",
           {{"id", id},
            {"kind", "disc"},
            {"centre", {x_m, 0.75, 0}},
            {"half", {0.10, 0.10, 0.1}},
            {"yaw", 0}}}};
}
json named(const char* act, const char* name) { return {{"act", act}, {"name", name}}; }

std::string why(const Person& p, std::int64_t id) {
  const auto answer = p.answers.find(id);
  return answer == p.answers.end() ? "not answered" : answer->second.why;
}
bool ok(const Person& p, std::int64_t id) {
  const auto answer = p.answers.find(id);
  return answer != p.answers.end() && answer->second.ok;
}

TEST(DeskSessions, ASceneIsSavedAndOpenedAndTheRunReplays) {
  const std::string folder = (desk_run::folder() / "kept").string();
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  p.holds = json::array({"engage"});
  p.sessions.folder = folder;
  p.sessions.world = kWorld;
  std::int64_t save = 0, none = 0, engaged = 0, engage = 0, open = 0, early = 0, later = 0,
               undo = 0;
  std::size_t left = 9;
  p.act = [&](double t) {
    if (p.once("one", t, 2.0)) p.say(drawn(4, 1.6));
    if (p.once("two", t, 2.1)) p.say(drawn(7, 1.9));
    if (p.once("mark", t, 2.2))
      p.say({{"act", "mark"}, {"points", {{0.9, 0.7, 0}, {1.0, 0.7, 0}}}});
    if (p.once("save", t, 2.5)) save = p.say(named("save", "lab"));
    if (p.once("none", t, 2.8)) none = p.say(named("open", "nothing"));
    if (p.once("erase", t, 3.0)) p.say({{"act", "erase"}, {"obstacle_id", 0}});
    if (p.once("other", t, 3.1)) p.say(drawn(1, 1.2));
    if (p.once("engage", t, 3.5)) engage = p.say({{"act", "engage"}});
    if (p.once("while engaged", t, 4.2)) engaged = p.say(named("open", "lab"));
    if (p.once("hold", t, 4.5)) p.say({{"act", "hold"}});
    if (p.once("open", t, 5.5)) open = p.say(named("open", "lab"));
    // In the same tick: it waits in line behind what is being read.
    if (p.once("early", t, 5.5)) early = p.say(named("save", "lab"));
    if (p.once("look", t, 7.0)) left = p.desk->acts().obstacles().size();
    if (p.once("undo", t, 7.1)) undo = p.say({{"act", "undo"}});
    if (p.once("later", t, 7.2)) later = p.say(named("save", "again"));
  };
  teletact::DemoOptions options;
  options.report = (desk_run::folder() / "sessions").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  static_cast<void>(desk_run::run(*s, 8, p, options));
  EXPECT_TRUE(ok(p, save)) << why(p, save);
  EXPECT_THAT(p.answers[save].result, HasSubstr("2 keep-outs, 1 mark, 0 objects"));
  EXPECT_FALSE(ok(p, none));
  EXPECT_THAT(why(p, none), HasSubstr("no saved session nothing"));
  EXPECT_TRUE(ok(p, engage)) << why(p, engage);
  EXPECT_FALSE(ok(p, engaged));
  EXPECT_THAT(why(p, engaged), HasSubstr("hold first"));
  EXPECT_TRUE(ok(p, open)) << why(p, open);
  EXPECT_FALSE(ok(p, early));
  EXPECT_TRUE(ok(p, later)) << why(p, later);
  EXPECT_FALSE(ok(p, undo)) << "what was undoable went with the scene before";
  EXPECT_EQ(left, 2U) << "the one that was drawn meanwhile is gone";
  ASSERT_EQ(p.desk->acts().obstacles().count(4), 1U);
  EXPECT_EQ(p.desk->acts().obstacles().at(7).centre_W.x(), 1.9);
  ASSERT_EQ(p.desk->acts().marks().size(), 1U);
  EXPECT_EQ(p.desk->acts().marks()[0].points_W.size(), 2U);
  const auto again = SessionStore(folder).read("again");
  ASSERT_TRUE(again) << again.error();
  EXPECT_EQ(again.value().obstacles.size(), 2U);
  const auto first = SessionStore(folder).read("lab");
  ASSERT_TRUE(first) << first.error();
  EXPECT_EQ(first.value().world, kWorld);
  const json text = json::parse(p.text);
  ASSERT_EQ(text["sessions"].size(), 2U);
  EXPECT_TRUE(text["sessions"][0]["here"]);
  EXPECT_FALSE(text["sessions"][0]["map"]) << "the run had not ended";
  EXPECT_TRUE(desk_run::same_again(options.log_folder, rt::Box::kOperator));
  EXPECT_TRUE(desk_run::same_again(options.log_folder, rt::Box::kRobot));
}

// A piece of the run is named once it has ended, and none begins twice.
TEST(DeskSessions, APieceOfTheRunIsNamedWithItsSeconds) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  std::int64_t none = 0, begin = 0, twice = 0, end = 0;
  bool recording = false;
  const auto record = [&](bool on) { return p.say({{"act", "record"}, {"on", on}}); };
  p.act = [&](double t) {
    if (p.once("none", t, 0.5)) none = record(false);
    if (p.once("begin", t, 1.0)) begin = record(true);
    if (p.once("twice", t, 1.2)) twice = record(true);
    if (p.once("look", t, 1.8)) recording = json::parse(p.text)["recording"];
    if (p.once("end", t, 2.0)) end = record(false);
  };
  static_cast<void>(desk_run::run(*s, 2.5, p));
  EXPECT_FALSE(ok(p, none));
  EXPECT_TRUE(ok(p, begin)) << why(p, begin);
  EXPECT_FALSE(ok(p, twice));
  EXPECT_TRUE(recording);
  EXPECT_TRUE(ok(p, end)) << why(p, end);
  // The console looks every 20 ms.
  EXPECT_THAT(p.answers[end].result, testing::ContainsRegex("piece 1 ends.*--from 1\\.0[0-2]"));
  EXPECT_FALSE(p.desk->acts().recording());
}

// The saved scene is one that a run can be started with.
TEST(DeskSessions, ARunStartsWithASessionAndAnotherWorldIsRefused) {
  const std::string folder = (desk_run::folder() / "start").string();
  teletact::SavedSession lab;
  lab.name = "lab";
  lab.world = kWorld;
  for (int id = 1; id <= 32; ++id) {
    teletact::DrawnObstacle o;
    o.id = static_cast<std::uint16_t>(id);
    o.centre_W = {2.0, 0.02 * id, 0};
    o.half_m = {0.05, 0.05, 0.1};
    lab.obstacles.push_back(o);
  }
  lab.marks_W = {{perception::Vec3(1, 0.7, 0)}};
  auto s = desk_run::scene();
  ASSERT_TRUE(SessionStore(folder).save(lab, config::effective(s->schema)));
  teletact::SavedSession far = lab;
  far.name = "far";
  far.world = "00000000000000bb";
  ASSERT_TRUE(SessionStore(folder).save(far, ""));
  const auto again = teletact::load_scene(folder + "/lab/scene.toml", {});
  EXPECT_EQ(config::effective(again->schema), config::effective(s->schema));

  Person p;
  p.sessions.folder = folder;
  p.sessions.world = kWorld;
  p.sessions.at_start = SessionStore(folder).read("lab").value();
  std::int64_t open = 0;
  std::size_t at_once = 0;
  p.act = [&](double t) {
    if (p.once("look", t, 1.5)) at_once = p.desk->acts().obstacles().size();
    if (p.once("far", t, 2.0)) open = p.say(named("open", "far"));
  };
  static_cast<void>(desk_run::run(*s, 3, p));
  EXPECT_EQ(at_once, 32U) << "more than the ring takes at once";
  EXPECT_EQ(p.desk->acts().marks().size(), 1U);
  EXPECT_FALSE(ok(p, open));
  EXPECT_THAT(why(p, open), HasSubstr("--session far"));
}

}  // namespace
