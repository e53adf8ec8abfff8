// A run that is driven from a page, on the virtual clock, with a person in place of the page: a
// goal by click, an obstacle drawn on the way, driving by tokens, a stop; and the same again from
// its recording.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rt/quantile.hpp"
#include "tests/support/whole.hpp"
#include "tests/unit/desk_run/person.hpp"

namespace {

using desk_run::folder;
using desk_run::Person;
using desk_run::run;
using desk_run::same_again;
using desk_run::scene;
using nlohmann::json;
using teletact::DemoOptions;
using teletact::VirtualRun;

double since_start(const VirtualRun& r, const tasks::RobotSample& s) {
  return 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.robot.epoch_ns);
}
// Measured speed of the base at an instant of the run.
double speed_at(const VirtualRun& r, double t) {
  double v = -1;
  for (const auto& s : r.robot.view.robot)
    if (since_start(r, s) <= t) v = static_cast<double>(s.speed_m_per_s);
  return v;
}
double path_to(const VirtualRun& r, double t) {
  double way = 0;
  for (const auto& s : r.robot.view.truth)
    if (1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.robot.epoch_ns) <= t) way = s.path_m;
  return way;
}
// Nearest that the points of a path come to a place.
double nearest(const tasks::Path& path, double x, double y) {
  double least = 1e9;
  for (int i = 0; i < path.size; ++i) {
    const auto& p = path.points[static_cast<std::size_t>(i)];
    least = std::min(least, std::hypot(p[0] - x, p[1] - y));
  }
  return least;
}

json drawn_disc(double x_m, double y_m, double radius_m) {
  return {{"act", "draw"},
          {"obstacle",
           {{"id", 1},
            {"kind", "disc"},
            {"centre", {x_m, y_m, 0}},
            {"half", {radius_m, radius_m, 0.1}},
            {"yaw", 0}}}};
}

// The floor that the camera has seen leaves no way round the drawn disc: the base goes as near as
// it can and stands clear of it. With the drawing undone it arrives.
TEST(DeskRun, ADrawnObstacleIsKeptClearOfAndAGoalByClickIsReachedWithoutItAndReplays) {
  constexpr double kX = 1.43, kY = 0.70, kRadius = 0.08;
  auto s = scene({"fusion.mesh_blocks=100"});
  Person p;
  p.viewers = 1;
  p.holds = json::array({"engage"});
  std::int64_t engage = 0, goal = 0, draw = 0, wrong = 0, undo = 0, again = 0;
  double ox = 0, oy = 0, clear_m = 0;
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) engage = p.say({{"act", "engage"}});
    if (p.once("wrong", t, 2.0)) wrong = p.say({{"act", "erase"}, {"obstacle_id", 7}});
    if (p.once("goal", t, 2.5)) goal = p.say({{"act", "go_to"}, {"x", kX}, {"y", kY}});
    if (!p.seen().paths.empty() && p.once("draw", t, 3.5)) {
      const auto& path = p.seen().paths.back();
      for (int i = 0; i < path.size && ox == 0; ++i) {
        const auto& q = path.points[static_cast<std::size_t>(i)];
        if (std::hypot(q[0], q[1]) > 0.8) ox = q[0], oy = q[1];
      }
      draw = p.say(drawn_disc(ox, oy, kRadius));
    }
    if (p.once("look", t, 7.5)) clear_m = nearest(p.seen().paths.back(), ox, oy);
    if (p.once("undo", t, 8.0)) undo = p.say({{"act", "undo"}});
    if (p.once("again", t, 8.5)) again = p.say({{"act", "go_to"}, {"x", kX}, {"y", kY}});
  };
  DemoOptions options;
  options.report = (folder() / "goal").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  const VirtualRun r = run(*s, 18, p, options);
  for (const auto id : {engage, goal, draw, undo, again})
    EXPECT_TRUE(p.answers[id].ok) << id << ": " << p.answers[id].why;
  EXPECT_FALSE(p.answers[wrong].ok);
  ASSERT_GT(std::hypot(ox, oy), 0.8) << "no path to draw on";
  EXPECT_GE(r.op.view.arrivals, 1U);
  ASSERT_FALSE(r.robot.view.truth.empty());
  const auto& end = r.robot.view.truth.back();
  EXPECT_LT(std::hypot(end.x_m - kX, end.y_m - kY), 0.10);
  EXPECT_EQ(end.collisions, 0U);
  EXPECT_LT(nearest(r.op.view.paths.front(), ox, oy), 0.05);
  EXPECT_GT(clear_m, kRadius + 0.25);
  // Views were made.
  using V = teletact::ViewKind;
  for (const V kind : {V::kText, V::kPose, V::kPicture, V::kCostMap, V::kMoving})
    EXPECT_GT(p.views[kind], 5) << static_cast<int>(kind);
  EXPECT_EQ(p.bytes[V::kPose], teletact::kPoseViewBytes);
  EXPECT_GT(p.mesh_blocks, 100);
  const json text = json::parse(p.text);
  EXPECT_EQ(text["mode"], "engaged");
  EXPECT_TRUE(text["obstacles"].empty());
  EXPECT_TRUE(text["first_steps"]["obstacle"]);
  EXPECT_TRUE(same_again(options.log_folder, rt::Box::kOperator));
  EXPECT_TRUE(same_again(options.log_folder, rt::Box::kRobot));
}

// On the real clock the desk is asked between two ticks of the console.
TEST(DeskRun, AnActIsTakenBetweenTwoTicks) {
  auto s = scene();
  Person p;
  bool waited = false, at_once = false, waits_still = true;
  p.act = [&](double t) {
    if (!p.once("hold", t, 1.0)) return;
    const auto hold = p.say({{"act", "hold"}});
    waited = p.desk->await_acts(rt::Nanos{0});
    p.desk->take_acts(p.now());
    at_once = p.answers.contains(hold) && p.answers[hold].ok;
    waits_still = p.desk->await_acts(rt::Nanos{0});
  };
  static_cast<void>(run(*s, 1.5, p));
  EXPECT_TRUE(waited);
  EXPECT_TRUE(at_once);
  EXPECT_FALSE(waits_still);
}

// Nearest that the true base came to a place from an instant on.
double nearest_base(const VirtualRun& r, double from, double x, double y) {
  double least = 1e9;
  for (const auto& s : r.robot.view.truth) {
    if (1e-9 * static_cast<double>(rt::ns_of(s.stamp) - r.robot.epoch_ns) < from) continue;
    least = std::min(least, std::hypot(s.x_m - x, s.y_m - y));
  }
  return least;
}

// From free floor to free floor, 1.4 m straight on; as soon as the base drives there, a disc is
// drawn on its way, 0.7 m ahead: it can stop before it. There is floor enough beside it:
// the scene's hurdle would leave a passage that the base does not take.
TEST(DeskRun, AnObstacleDrawnOnItsWayIsGoneRound) {
  using Phase = tasks::TaskState::Phase;
  constexpr double kX = 2.40, kY = 0.75, kRadius = 0.10;
  auto s = scene();
  std::erase_if(s->world.boxes, [](const auto& b) { return b.name == "hurdle"; });
  Person p;
  p.holds = json::array({"engage"});
  double ox = 0, oy = 0, drawn_at = -1;
  std::int64_t draw = 0;
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) p.say({{"act", "engage"}});
    if (p.once("first", t, 2.0)) p.say({{"act", "go_to"}, {"x", 1.00}, {"y", kY}, {"yaw", 0.0}});
    const bool there = p.seen().task.marks == 1 && p.seen().task.phase == Phase::kArrived;
    if (there && p.once("second", t, 3.0))
      p.say({{"act", "go_to"}, {"x", kX}, {"y", kY}, {"yaw", 0.0}});
    const bool drives = p.seen().task.marks == 2 && p.seen().task.phase == Phase::kDriving;
    if (!drives || std::abs(p.seen().robot.vx) < 0.1 || !p.once("draw", t, 3.0)) return;
    const auto& path = p.seen().paths.back();
    const auto& middle = path.points[static_cast<std::size_t>(path.size / 2)];
    ox = middle[0], oy = middle[1], drawn_at = t;
    draw = p.say(drawn_disc(ox, oy, kRadius));
  };
  const VirtualRun r = run(*s, 26, p);
  ASSERT_GT(drawn_at, 0) << "it never drove";
  EXPECT_TRUE(p.answers[draw].ok) << p.answers[draw].why;
  const double radius = s->graph.planning.robot_radius_m;
  EXPECT_LT(std::abs(oy - kY), 0.15) << "the disc lies across the straight way";
  ASSERT_FALSE(r.robot.view.truth.empty());
  const auto& end = r.robot.view.truth.back();
  EXPECT_LT(std::hypot(end.x_m - kX, end.y_m - kY), 0.10);
  EXPECT_EQ(r.op.view.task.phase, Phase::kArrived);
  EXPECT_FALSE(r.op.view.task.is_short);
  // The base's own disc and the drawn one never touch.
  const double least = nearest_base(r, drawn_at, ox, oy);
  EXPECT_GT(least, kRadius + radius);
  EXPECT_EQ(end.collisions, 0U);
  std::printf(
      "disc at (%.2f, %.2f), nearest %.3f m, touching would be %.3f m; %.3f m off at the end\n", ox,
      oy, least, kRadius + radius, std::hypot(end.x_m - kX, end.y_m - kY));
}

// The same place with no floor left beside the disc that is drawn about it.
TEST(DeskRun, AGoalThatIsDrawnOverIsToldAsNotReached) {
  using Phase = tasks::TaskState::Phase;
  constexpr double kX = 1.60, kY = 0.75, kRadius = 0.30;
  auto s = scene();
  Person p;
  p.viewers = 1;
  p.holds = json::array({"engage"});
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) p.say({{"act", "engage"}});
    if (p.once("draw", t, 2.0)) p.say(drawn_disc(kX, kY, kRadius));
    if (p.once("goal", t, 2.5)) p.say({{"act", "go_to"}, {"x", kX}, {"y", kY}});
  };
  const VirtualRun r = run(*s, 14, p);
  ASSERT_FALSE(r.robot.view.truth.empty());
  const auto& end = r.robot.view.truth.back();
  const double off = std::hypot(end.x_m - kX, end.y_m - kY);
  EXPECT_EQ(r.op.view.task.phase, Phase::kShort);
  EXPECT_EQ(r.op.view.arrivals, 0U);
  EXPECT_GT(off, kRadius + 0.3);
  EXPECT_NEAR(r.op.view.task.off_m, off, 0.10);
  const json text = json::parse(p.text);
  EXPECT_EQ(text["phase"], "short of the goal");
  EXPECT_TRUE(text["goal"]["short"]);
  EXPECT_NEAR(text["goal"]["off_m"].get<double>(), off, 0.10);
  EXPECT_THAT(text["goal"]["text"].get<std::string>(), testing::HasSubstr("short of the goal"));
  bool told = false;
  for (const auto& e : text["events"])
    told = told || (e["kind"] == "task" &&
                    e["text"].get<std::string>().find("short of the goal") != std::string::npos);
  EXPECT_TRUE(told);
}

// Whoever opens the page while the run goes on gets the whole surface, also the first one ever.
TEST(DeskRun, AViewerWhoComesLateGetsTheMesh) {
  auto s = scene({"fusion.mesh_blocks=100"});
  Person p;
  int before = -1;
  p.act = [&](double t) {
    if (p.once("come", t, 4.0)) before = p.mesh_blocks, p.viewers = 1;
  };
  const VirtualRun r = run(*s, 7, p);
  EXPECT_EQ(before, 0) << "nobody looked";
  EXPECT_GT(p.mesh_blocks, 100);
}

// The timing table and the link's figures against the run's own records.
TEST(DeskRun, WhatThePageTellsOfTasksAndLinkIsWhatTheRunRecorded) {
  auto s = scene();
  Person p;
  p.viewers = 1;
  const VirtualRun r = run(*s, 9, p);
  const json text = json::parse(p.text);
  ASSERT_GT(p.text_at_ns, 0);
  int compared = 0;
  for (const auto* half : {&r.op.log, &r.robot.log}) {
    const bool of_op = half == &r.op.log;
    for (const auto& task : half->tasks) {
      const json* row = nullptr;
      for (const auto& t : text["tasks"])
        if (t["name"] == task.spec.name) row = &t;
      ASSERT_NE(row, nullptr) << task.spec.name;
      EXPECT_EQ((*row)["box"], of_op ? "operator" : "robot");
      // The robot's clock is another one: the operator's box alone is compared to the last digit.
      if (!of_op) {
        EXPECT_TRUE(row->contains("cpu_ms")) << task.spec.name;
        continue;
      }
      std::vector<double> late;
      double cpu_ms = 0;
      std::int64_t newest = 0;
      for (const auto& j : task.jobs)
        if (j.end_ns <= p.tasks_at_ns) newest = j.release_ns;
      for (const auto& j : task.jobs) {
        if (j.release_ns > newest || j.release_ns <= newest - 5'000'000'000) continue;
        late.push_back(1e-3 * static_cast<double>(j.start_ns - j.release_ns));
        cpu_ms += 1e-6 * static_cast<double>(j.cpu_ns);
      }
      ASSERT_FALSE(late.empty()) << task.spec.name;
      EXPECT_NEAR((*row)["late_p95_us"].get<double>(), rt::quantile(late, 0.95), 1e-3)
          << task.spec.name;
      EXPECT_NEAR((*row)["cpu_ms"].get<double>(), cpu_ms / static_cast<double>(late.size()), 1e-3)
          << task.spec.name;
      ++compared;
    }
  }
  EXPECT_GE(compared, 5);
  double pictures = 0, bytes = 0;
  for (const auto& l : r.op.link.newest) {
    const std::int64_t ns = rt::ns_of(l.stamp);
    if (ns > p.text_at_ns || ns <= p.text_at_ns - 2'000'000'000) continue;
    pictures += l.picture ? 1 : 0;
    bytes += l.bytes;
  }
  const json& link = text["link"];
  EXPECT_GT(pictures, 20);
  EXPECT_NEAR(link["fps"].get<double>(), pictures / 2, 1e-3);
  EXPECT_NEAR(link["mbit_s"].get<double>(), 8e-6 * bytes / 2, 1e-3);
  EXPECT_GT(link["round_trip_ms"].get<double>(), 60) << "30 ms each way";
  EXPECT_LT(link["round_trip_ms"].get<double>(), 80);
  EXPECT_GT(link["age_ms"].get<double>(), 30);
  EXPECT_LT(link["age_ms"].get<double>(), 200);
  EXPECT_EQ(link["loss"].get<double>(), 0);
  EXPECT_EQ(text["device"]["state"], "forces on");
  EXPECT_THAT(text["bus"].get<std::string>(), testing::HasSubstr("stands, no fault"));
}

TEST(DeskRun, DrivingByHandEndsWithItsTokensAndReplays) {
  auto s = scene();
  Person p;
  p.viewers = 1;
  std::int64_t engage = 0, early = 0, lost = 0;
  const json drive{{"act", "drive"}, {"vx", 0.3}, {"vy", 0.0}, {"wz", 0.0}};
  const json both = json::array({"engage", "drive"}), one = json::array({"engage"});
  p.holds = one;
  p.act = [&](double t) {
    if (p.once("early", t, 1.0)) early = p.say(drive);
    if (p.once("engage", t, 1.5)) engage = p.say({{"act", "engage"}});
    if (p.once("press", t, 2.5)) p.holds = both, p.driven = drive;
    // The key is held, the browser stands still: only its engage goes on.
    if (p.once("silent", t, 4.0)) {
      p.holds = one;
      p.driven.reset();
    }
    if (p.once("again", t, 5.0)) p.holds = both, p.driven = drive;
    // The page is frozen: nothing at all comes.
    if (p.once("frozen", t, 6.0)) p.holds = nullptr;
    if (p.once("thaws", t, 6.6)) {
      p.holds = both;
      lost = p.say(drive);
    }
  };
  DemoOptions options;
  options.report = (folder() / "drive").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  const VirtualRun r = run(*s, 8, p, options);
  EXPECT_FALSE(p.answers[early].ok);
  EXPECT_THAT(p.answers[early].why, testing::HasSubstr("not engaged"));
  EXPECT_TRUE(p.answers[engage].ok) << p.answers[engage].why;
  EXPECT_FALSE(p.answers[lost].ok);
  EXPECT_NEAR(speed_at(r, 3.8), 0.3, 0.02);
  EXPECT_LT(speed_at(r, 4.7), 0.005) << "let go: within a job, the way there and the ramp";
  EXPECT_NEAR(speed_at(r, 5.9), 0.3, 0.02);
  EXPECT_LT(speed_at(r, 6.0 + 0.2 + 0.1 + 0.1 + 0.3), 0.005) << "no token";
  EXPECT_LT(path_to(r, 8) - path_to(r, 6.7), 0.005) << "what is still held is no new press";
  EXPECT_EQ(json::parse(p.text)["mode"], "hold");
  EXPECT_TRUE(same_again(options.log_folder, rt::Box::kOperator));
  EXPECT_TRUE(same_again(options.log_folder, rt::Box::kRobot));
}

// The page says that it sees well and drives on: the box knows better. Frames 105 on do not come,
// of 30 a second.
TEST(DeskRun, NobodyDrivesByAPictureOlderThanASecond) {
  const std::string plan = (folder() / "no_frames.toml").string();
  std::ofstream(plan) << "name = \"no_frames\"\nseed = 1\n[[fault]]\nkind = \"drop\"\n"
                         "target = \"frame\"\nfirst = 105\ncount = 75\n";
  auto s = scene();
  Person p;
  p.viewers = 1;
  std::int64_t early = 0, late = 0, again = 0;
  const json drive{{"act", "drive"}, {"vx", 0.2}, {"vy", 0.0}, {"wz", 0.0}};
  const json both = json::array({"engage", "drive"}), one = json::array({"engage"});
  p.holds = one;
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) static_cast<void>(p.say({{"act", "engage"}}));
    if (p.once("press", t, 2.5)) p.holds = both, p.driven = drive;
    if (p.once("early", t, 4.0)) early = p.say(drive);
    if (p.once("stop saying", t, 5.5)) p.holds = one, p.driven.reset();
    // A new press does not help.
    if (p.once("press again", t, 5.7)) p.holds = both;
    if (p.once("late", t, 5.8)) late = p.say(drive);
    if (p.once("let go", t, 6.0)) p.holds = one;
    if (p.once("pictures", t, 7.0)) p.holds = both, p.driven = drive;
    if (p.once("last", t, 7.6)) again = p.say(drive);
  };
  DemoOptions options;
  options.fault_plan = plan;
  const VirtualRun r = run(*s, 8, p, options);
  EXPECT_EQ(p.answers.count(early), 0U) << p.answers[early].why;
  EXPECT_FALSE(p.answers[late].ok);
  EXPECT_THAT(p.answers[late].why, testing::HasSubstr("s old"));
  EXPECT_EQ(p.answers.count(again), 0U) << p.answers[again].why;
  EXPECT_NEAR(speed_at(r, 4.3), 0.2, 0.02)
      << "older than the page's colour turns, not yet a second";
  EXPECT_LT(speed_at(r, 5.3), 0.005) << "the key is still held";
  EXPECT_LT(path_to(r, 6.9) - path_to(r, 5.4), 0.005);
  EXPECT_NEAR(speed_at(r, 7.7), 0.2, 0.02) << "pictures again, a new press";
  const auto& events = p.desk->events().newest();
  EXPECT_TRUE(std::any_of(events.begin(), events.end(), [](const auto& e) {
    return e.kind == "drive" && e.text.find("the newest picture is") != std::string::npos;
  }));
}

// A person at the page touches the floor beside the pedestal, draws a stroke with the button, and
// the base goes there: as with a device, and as often as it is run again.
TEST(DeskRun, AHandAtThePageTouchesAndMarks) {
  auto s = scene();
  Person p;
  double x = 1.85, y = -0.38;
  p.holds = json::array({"engage"});
  p.act = [&](double t) {
    if (p.once("engage", t, 1.5)) p.say({{"act", "engage"}});
    if (p.once("take", t, 2.0)) p.holds = json::array({"engage", "hand"});
    if (t > 2.0 && t < 5.0) {
      if (t > 4.0) x = 1.85 + 0.05 * (t - 4.0);
      p.driven = json{{"act", "hand"},
                      {"p", {x, y, 0.0}},
                      {"normal", {0, 0, 1}},
                      {"press", t > 3.0 && t < 4.8},
                      {"button", t > 3.8 && t < 4.6},
                      {"clutch", false}};
    }
    if (p.once("leave", t, 5.0)) p.holds = json::array({"engage"}), p.driven.reset();
  };
  DemoOptions options;
  options.report = (folder() / "hand").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  const VirtualRun r = run(*s, 14, p, options);
  EXPECT_TRUE(p.desk->acts().first_steps().touch);
  EXPECT_TRUE(p.desk->acts().first_steps().mark) << "a mark of the hand counts";
  EXPECT_GE(r.op.view.task.marks, 1U);
  EXPECT_GE(r.op.view.arrivals, 1U);
  double deepest = 0, last = 1;
  for (const auto& h : r.op.view.haptic) {
    deepest = std::max(deepest, static_cast<double>(h.force_N));
    last = static_cast<double>(h.force_N);
  }
  EXPECT_GT(deepest, 0.1) << "it pressed";
  EXPECT_LT(last, 0.01);
  EXPECT_TRUE(same_again(options.log_folder, rt::Box::kOperator));
}

// Calls something at instants of the host's clock, between the jobs.
class At final : public rt::Actor {
 public:
  At(rt::Actor& inner, std::function<void(std::int64_t)> call)
      : inner_(inner), call_(std::move(call)) {}
  std::int64_t next_host_ns() const noexcept override {
    return std::min(inner_.next_host_ns(), at_ns);
  }
  void act(std::int64_t host_ns) override {
    if (inner_.next_host_ns() <= host_ns) return inner_.act(host_ns);
    at_ns = std::int64_t{1} << 62;
    call_(host_ns);
  }
  std::int64_t at_ns = std::int64_t{1} << 62;

 private:
  rt::Actor& inner_;
  std::function<void(std::int64_t)> call_;
};

// Stop, with a thousand intents a second before it: from the press to the first falling speed no
// more than one way and 30 ms; then it stands after v / (4 m/s2).
TEST(DeskRun, AStopOvertakesWhateverWaits) {
  constexpr double kOneWay_s = 0.020, kEvery_s = 2.2, kV = 0.3;
  const int kStops = tests::whole() ? 10 : 4;
  auto s = scene({"link.shape.delay_ms=20"});
  Person p;
  const json drive{{"act", "drive"}, {"vx", kV}, {"vy", 0.0}, {"wz", 0.0}};
  const json back{{"act", "drive"}, {"vx", -kV}, {"vy", 0.0}, {"wz", 0.0}};
  std::unique_ptr<At> at;
  std::vector<double> pressed;
  p.act = [&](double t) {
    for (int i = 0; i < 20; ++i) p.say({{"act", "note"}, {"text", "noise"}});
    for (int k = 0; k < kStops; ++k) {
      const double begin = 2 + kEvery_s * k;
      const std::string n = std::to_string(k);
      if (p.once("free" + n, t, begin - 0.3)) p.holds = json::array();
      if (p.once("engage" + n, t, begin)) {
        p.holds = json::array({"engage"});
        p.say({{"act", "engage"}});
      }
      if (p.once("drive" + n, t, begin + 0.2)) {
        p.holds = json::array({"engage", "drive"});
        p.driven = k % 2 == 0 ? drive : back;
      }
      if (p.once("stop" + n, t, begin + 1.2)) {
        // Somewhere within the tasks' periods.
        const double press = t + 0.0003 + 0.0137 * k;
        pressed.push_back(press);
        at->at_ns = 1'000'000'000 + static_cast<std::int64_t>(1e9 * press);
      }
    }
  };
  DemoOptions options;
  options.wrap_link = [&](rt::Actor& link) -> rt::Actor* {
    at = std::make_unique<At>(link, [&](std::int64_t) { p.desk->stop(); });
    return at.get();
  };
  const VirtualRun r = run(*s, 2 + kEvery_s * kStops, p, options);
  ASSERT_EQ(pressed.size(), static_cast<std::size_t>(kStops));
  double worst = 0;
  for (const double press : pressed) {
    double falls = -1, stands = -1, before = -1;
    for (const auto& q : r.robot.view.robot) {
      const double t = since_start(r, q);
      const auto v = static_cast<double>(q.speed_m_per_s);
      if (t < press) before = v;
      if (t >= press && falls < 0 && v < before - 0.004) falls = t;
      if (t >= press && stands < 0 && v < 0.01) stands = t;
    }
    EXPECT_NEAR(before, kV, 0.02) << "it was driving, at " << press;
    ASSERT_GT(falls, 0) << press;
    worst = std::max(worst, falls - press);
    EXPECT_LT(falls - press, kOneWay_s + 0.030) << press;
    EXPECT_LT(stands - falls, kV / 4 + 0.08) << press << ": and the lag of the motors' speed loop";
  }
  std::printf("first falling speed after the press: at most %.1f ms of them %.0f on the way\n",
              1e3 * worst, 1e3 * kOneWay_s);
  EXPECT_TRUE(p.desk->acts().first_steps().stop);
}

}  // namespace
