// teletact robot and teletact operator as two processes that know each other only by the road: they
// start in any order, are killed and started again, and go on; motion wants an act each time. What
// is judged is what the boxes say of themselves (teletact status). No limit on wall time: waits are
// generous, and a run that the machine itself disturbed is made again.
#include <fcntl.h>

#include <array>
#include <map>
#include <string>
#include <vector>

#include "rt/quantile.hpp"
#include "tests/fault/two_boxes/boxes.hpp"
#include "tests/support/paths.hpp"
#include "tools/host/run_results.hpp"

namespace {

using namespace two_boxes;

// Steps of the story return false when it can not go on.
bool both_hold_for_two_seconds(Boxes& b) {
  double since = -1;
  bool moved = false;
  const bool held = b.until([&](const Json& r, const Json& o) {
    if (!connected(r) || !connected(o)) return false;
    moved = moved || engaged(r) || engaged(o);
    if (since < 0) since = r["up_s"];
    return moved || static_cast<double>(r["up_s"]) > since + 2;
  });
  EXPECT_FALSE(moved) << "nobody engaged, and it was engaged\n" << b.said();
  return held && !moved;
}

// From the arrival of a picture to the job of fusion that takes it, decoding included. Without the
// rule that releases follow pictures (docs/link.md) the boxes' epochs give it a phase by chance.
void pictures_soon_find_their_job(const Boxes& b) {
  teletact::OperatorHalf half;
  teletact::load_half((b.folder / "operator" / "raw").string(), half);
  std::map<rt::Time, rt::Time> arrived;  // by exposure
  for (const auto& s : half.link.newest) {
    if (s.picture) arrived[s.made] = s.stamp;
  }
  std::vector<double> waits_ms;
  for (const auto& job : half.view.fusion) {
    const auto picture = arrived.find(job.exposure);
    const bool settled =
        !arrived.empty() && job.exposure - arrived.begin()->first > std::chrono::seconds{3};
    if (job.consumed && settled && picture != arrived.end())
      waits_ms.push_back(1e3 * rt::seconds(job.stamp - picture->second));
  }
  if (waits_ms.size() < 30) {
    std::printf("the waits of pictures are not judged: %zu of them are no second\n",
                waits_ms.size());
    return;
  }
  const double half_wait_ms = rt::quantile(waits_ms, 0.5);
  std::printf("%zu pictures, half of them waited for %.1f ms at most\n", waits_ms.size(),
              half_wait_ms);
  EXPECT_LT(half_wait_ms, 20) << b.op.output();
}

// Where the robot dials, with codecs: the bytes of lossless depth take two thirds of the period.
Ending story(const std::string& name, bool operator_first, bool robot_dials) {
  Boxes b(name, robot_dials);
  if (robot_dials) {
    for (BoxProgram* box : {&b.robot, &b.op})
      box->go_by({box == &b.robot ? "--operator-address" : "--listen", b.place(), "--set",
                  "link.depth_codec=\"auto\"", "--set", "link.colour_codec=\"h264\""});
  }
  const auto both_engaged = [](const Json& r, const Json& o) { return engaged(r) && engaged(o); };
  (operator_first ? b.op : b.robot).start();
  if (!b.until([&](const Json& r, const Json& o) { return waits(operator_first ? o : r); }))
    return b.ending;
  (operator_first ? b.robot : b.op).start();
  if (!b.until(both_engaged)) return b.ending;

  // The robot's box dies. The operator's goes on, says so, and waits.
  b.robot.kill_it();
  if (!b.until([](const Json&, const Json& o) { return waits(o); })) return b.ending;
  EXPECT_FALSE(b.op.ended());
  EXPECT_NE(b.op.output().find("the other box is gone"), std::string::npos) << b.op.output();
  b.robot.start();
  if (!both_hold_for_two_seconds(b)) return b.ending;

  // The operator's box dies. Started again its person engages, which is an act.
  b.op.kill_it();
  if (!b.until([](const Json& r, const Json&) { return waits(r); })) return b.ending;
  b.op.start();
  if (!b.until(both_engaged)) return b.ending;
  // Pictures enough behind the start, at which two boxes share two cores.
  if (robot_dials &&
      !b.until([](const Json&, const Json& o) { return static_cast<double>(o["up_s"]) > 6; }))
    return b.ending;

  const std::string status =
      tests::in_build("teletact") + " status > " + (b.folder / "status.txt").string();
  EXPECT_EQ(std::system(status.c_str()), 0);
  const std::string text = read_file(b.folder / "status.txt");
  EXPECT_NE(text.find("connections               2\n"), std::string::npos) << text;
  EXPECT_EQ(b.op.stop(), 0) << b.op.output();
  EXPECT_TRUE(fs::exists(b.op.report())) << b.op.output();
  if (robot_dials) pictures_soon_find_their_job(b);
  if (!b.until([](const Json& r, const Json&) { return waits(r); })) return b.ending;
  EXPECT_EQ(b.robot.stop(), 0) << b.robot.output();
  EXPECT_TRUE(fs::exists(b.robot.report())) << b.robot.output();
  return Ending::kGood;
}

template <class Story>
void tell(const std::string& name, const Story& story) {
  for (int n = 1; n <= kTries; ++n) {
    const Ending ending = story(name + std::to_string(n));
    if (testing::Test::HasFailure()) return;
    if (ending == Ending::kNoRoom) GTEST_SKIP() << "the cores are taken";
    if (ending == Ending::kGood) return;
    std::printf("try %d: the machine disturbed the tasks; not judged\n", n);
  }
  GTEST_SKIP() << "not judged: the machine disturbed each of " << kTries << " tries";
}

TEST(TwoBoxes, TheOperatorFirstAndTheRobotListens) {
  tell("a", [](const std::string& name) { return story(name, true, false); });
}
TEST(TwoBoxes, TheRobotFirstAndDials) {
  tell("b", [](const std::string& name) { return story(name, false, true); });
}

// A camera with a clock of its own: a frame is there 7 ms after a release of the box's grid at the
// earliest (30 ms of phase, 10 of exposure, and what the twin renders), and would wait up to 26 ms.
Ending camera_story(const std::string& name) {
  Boxes b(name, false);
  const auto log = b.folder / "robot" / "raw" / "robot.log";
  const std::string moved = "capture is released ";
  b.robot.go_by({"--listen", b.place(), "--set", "camera.phase_ms=30"});
  b.robot.start();
  if (!b.until([&](const Json&, const Json&) {
        return read_file(log).find(moved) != std::string::npos;
      }))
    return b.ending;
  EXPECT_EQ(b.robot.stop(), 0) << b.robot.output();
  const std::string said = read_file(log);
  const double by_ms = std::stod(said.substr(said.find(moved) + moved.size()));
  EXPECT_GT(by_ms, 6.7) << said;
  EXPECT_LT(by_ms, 6.7 + 20) << said;
  return Ending::kGood;
}
TEST(TwoBoxes, CaptureFollowsACameraWithAClockOfItsOwn) { tell("own", camera_story); }

// As a service does it: SIGTERM, and the same command again. Nothing that the first run left
// refuses the second.
TEST(TwoBoxes, AnOrderlyStopAndAStartAgainInTheSameFolder) {
  Boxes b("again", false);
  for (BoxProgram* box : {&b.robot, &b.op}) {
    for (int n = 1; n <= 2; ++n) {
      box->start();
      const bool up = b.until([&](const Json& r, const Json& o) {
        return waits(box == &b.robot ? r : o) || box->ended();
      });
      if (!up && b.ending != Ending::kGood) GTEST_SKIP() << "the machine disturbed the tasks";
      ASSERT_FALSE(box->ended()) << "start " << n << ": " << box->output();
      EXPECT_EQ(box->stop(), 0) << box->output();
    }
  }
}

// Started over a road that breaks too: the lines of the robot's box are read no more, then its
// terminal is gone. The first changes nothing; the second ends it as SIGTERM does.
Ending gone_story(const std::string& name) {
  Boxes b(name, false);
  std::array<int, 2> ends{};
  EXPECT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
  b.robot.say_to(ends[1]);
  b.robot.start();
  ::close(ends[1]);
  const bool up = b.until([](const Json& r, const Json&) { return waits(r); });
  ::close(ends[0]);
  if (!up) return b.ending;
  b.op.start();  // the link's lines, and one each second
  if (!b.until([](const Json& r, const Json& o) { return engaged(r) && engaged(o); }))
    return b.ending;
  EXPECT_EQ(b.op.stop(), 0) << b.op.output();
  if (!b.until([](const Json& r, const Json&) { return waits(r); })) return b.ending;
  EXPECT_FALSE(b.robot.ended());
  EXPECT_EQ(b.robot.stop(SIGHUP), 0);
  EXPECT_TRUE(fs::exists(b.robot.report()));
  return Ending::kGood;
}
TEST(TwoBoxes, WhoReadsItsLinesIsGoneAndThenItsTerminal) { tell("gone", gone_story); }

// Over TLS: the operator's box dies while it is engaged and comes back; then its certificate is
// revoked while it is engaged, and it is out, told, and not let in again.
Ending tls_story(const std::string& name) {
  Boxes b(name, false);
  b.use_keys();
  const auto both_engaged = [](const Json& r, const Json& o) { return engaged(r) && engaged(o); };
  b.robot.start();
  b.op.start();
  if (!b.until(both_engaged)) return b.ending;
  EXPECT_NE(b.robot.status().value("peer", "").find("ada"), std::string::npos) << b.robot.status();
  b.op.kill_it();
  if (!b.until([](const Json& r, const Json&) { return waits(r); })) return b.ending;
  b.op.start();
  if (!b.until(both_engaged)) return b.ending;

  b.revoke_operator();
  const auto out = [](const Json& r, const Json& o) {
    return waits(r) && waits(o) && r.value("turned_away", 0) > 0;
  };
  if (!b.until(out)) return b.ending;
  EXPECT_NE(b.robot.status().value("turned_away_newest", "").find("revoked"), std::string::npos)
      << b.robot.status();
  EXPECT_NE(b.robot.output().find("revoked"), std::string::npos) << b.robot.output();
  EXPECT_FALSE(b.op.ended());
  EXPECT_EQ(b.op.stop(), 0) << b.op.output();
  EXPECT_EQ(b.robot.stop(), 0) << b.robot.output();
  return Ending::kGood;
}

TEST(TwoBoxes, OverTlsKilledStartedAndRevokedWhileEngaged) { tell("tls", tls_story); }

}  // namespace
