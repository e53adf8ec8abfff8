// Revocation of who is already on the way in, on either side of the road; lists with odd dates.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <thread>

#include "drivers/road/pem.hpp"
#include "tests/unit/drivers_road/support.hpp"

namespace {

using namespace road_test;
using testing::HasSubstr;

struct Listener {
  Lab lab;
  std::unique_ptr<End> end;
  Listener() {
    auto options = listening(lab, "rover", rt::Box::kRobot);
    options.handshake_limit = std::chrono::seconds{60};  // no arrival goes by its age
    end = std::make_unique<End>(options);
    end->talk();
    end->start();
  }
  std::unique_ptr<RawTls> raw(const std::string& name = "ada") {
    return std::make_unique<RawTls>(end->link->port(), lab.box(name) + "/box.crt",
                                    lab.box(name) + "/box.key");
  }
  // Until a connection that comes now is refused for it.
  bool list_is_read(const std::string& name) {
    return wait_for([&] {
      auto late = raw(name);
      static_cast<void>(late->greet());
      return end->link->last_refusal().find("is revoked") != std::string::npos;
    });
  }
  void expect_welcome(const std::string& name) {
    End op(dialling(lab, name, rt::Box::kOperator, end->link->port()));
    op.start();
    EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
  }
};

bool welcome(const Bytes& said) { return said.size() == 24 && said[3] == 2; }

// The server's side of a handshake is over a little after the client's.
void let_it_end() { std::this_thread::sleep_for(std::chrono::milliseconds(200)); }

// A thief keeps two connections in store whose handshakes were good.
TEST(Revoked, HandshakesFromBeforeTheListLeadToNoSession) {
  Listener robot;
  robot.lab.issue(rt::Box::kOperator, "bob");
  auto control = robot.raw(), bulk = robot.raw();
  ASSERT_TRUE(control->shaken && bulk->shaken);
  let_it_end();
  robot.lab.revoke("ada");
  ASSERT_TRUE(robot.list_is_read("ada")) << robot.end->link->last_refusal();
  const Bytes said = control->greet();
  EXPECT_FALSE(welcome(said));
  if (welcome(said)) static_cast<void>(bulk->greet(1, Bytes(said.begin() + 8, said.end())));
  EXPECT_TRUE(bulk->hear().empty());
  EXPECT_EQ(robot.end->link->sessions(), 0U);
  EXPECT_GE(robot.end->link->counts().refused, 3U) << "both, and the one that came later";
  robot.expect_welcome("bob");
}

// The first connection is let in, then comes the list, then the second one.
TEST(Revoked, APromiseOfBeforeTheListIsTakenBack) {
  Listener robot;
  robot.lab.issue(rt::Box::kOperator, "bob");
  auto control = robot.raw(), bulk = robot.raw();
  const Bytes said = control->greet();
  ASSERT_TRUE(welcome(said) && bulk->shaken);
  let_it_end();
  robot.lab.revoke("ada");
  ASSERT_TRUE(robot.list_is_read("ada")) << robot.end->link->last_refusal();
  EXPECT_FALSE(welcome(bulk->greet(1, Bytes(said.begin() + 8, said.end()))));
  EXPECT_TRUE(control->hear().empty());
  EXPECT_EQ(robot.end->link->sessions(), 0U);
  robot.expect_welcome("bob");
}

// Who dials has its first connection and looks for the second one's address when the list comes.
TEST(Revoked, ADialThatIsUnderWayEnds) {
  Lab lab;
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.start();
  struct Names {
    std::atomic<int> asked{0};
    std::atomic<bool> open{false};
  };
  const auto names = std::make_shared<Names>();
  auto options = dialling(lab, "ada", rt::Box::kOperator, robot.link->port());
  options.address = "robot.lab";
  options.lookup = [names](const std::string&) -> rt::Result<std::vector<std::string>> {
    if (++names->asked >= 2) wait_for([&] { return names->open.load(); });
    return std::vector<std::string>{"127.0.0.1"};
  };
  End op(options);
  op.start();
  ASSERT_TRUE(wait_for([&] { return names->asked == 2; })) << op.link->fault();
  lab.revoke("rover");
  EXPECT_TRUE(wait_for([&] {
    return op.link->fault().find("the certificate of 'rover' is revoked") != std::string::npos;
  })) << op.link->fault();
  names->open = true;
  EXPECT_TRUE(wait_for([&] { return op.link->counts().failed >= 3; })) << "and it goes on";
  EXPECT_EQ(op.link->sessions(), 0U);
}

// ---- the list's date ----

void put_list(const Lab& lab, const std::string& revoked, std::int64_t number,
              std::int64_t made_s) {
  auto ca = drivers::read_certificate(lab.at + "/ca.crt");
  auto key = drivers::read_key(lab.at + "/ca.key");
  auto lost = drivers::read_certificate(lab.box(revoked) + "/box.crt");
  ASSERT_TRUE(ca && key && lost);
  auto list = teletact::make_revoked(*ca.value(), *key.value(),
                                     {{drivers::serial_of(*lost.value()), made_s}}, number, made_s);
  ASSERT_TRUE(list);
  const std::string at = lab.box("rover") + "/ca.crl";
  std::ofstream(at + ".new") << teletact::pem_of(*list.value());
  std::filesystem::rename(at + ".new", at);
}

// The clock of the CA's machine is two years ahead; boxes have certificates of one year.
TEST(Revoked, AListDatedAfterTheBoxsOwnEndShutsOutWhomItRevokesAlone) {
  Listener robot;
  robot.lab.issue(rt::Box::kOperator, "bob");
  const std::int64_t ahead = wall_s() + 730 * kDay_s;
  put_list(robot.lab, "bob", 50, ahead);
  ASSERT_TRUE(wait_for([&] { return !robot.end->link->note().empty(); }));
  EXPECT_THAT(robot.end->link->note(), HasSubstr("ca.crl: dated " + drivers::day_of(ahead)));
  EXPECT_THAT(robot.end->link->note(), HasSubstr("is the clock of the CA's machine ahead?"));
  EXPECT_TRUE(robot.list_is_read("bob"));
  robot.expect_welcome("ada");

  // Likewise where it is there at the start.
  auto options = listening(robot.lab, "rover", rt::Box::kRobot);
  {
    End again(options);
    again.start();
    EXPECT_THAT(again.link->note(), HasSubstr("is the clock of the CA's machine ahead?"));
    End ada(dialling(robot.lab, "ada", rt::Box::kOperator, again.link->port()));
    ada.start();
    EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
  }
  // A box that does not know the date takes the list's word for it.
  options.wall_clock_s = [] { return std::int64_t{0}; };
  const auto unset = drivers::RoadLink::open(options);
  ASSERT_FALSE(unset);
  EXPECT_THAT(unset.error(), HasSubstr("expired on"));

  put_list(robot.lab, "bob", 51, wall_s());
  EXPECT_TRUE(wait_for([&] { return robot.end->link->note().empty(); })) << "set right again";
}

// A box's folder may be written anew from a backup while the box is down.
TEST(Revoked, AnOlderListChangesNothingAfterARestartEither) {
  namespace fs = std::filesystem;
  Lab lab;
  lab.issue(rt::Box::kOperator, "bob");
  const std::string list = lab.box("rover") + "/ca.crl", old = lab.folder.path + "/old.crl";
  fs::copy_file(list, old);
  auto options = listening(lab, "rover", rt::Box::kRobot);
  options.state = lab.folder.path + "/robot/state";
  const auto started = [&] {
    auto robot = std::make_unique<End>(options);
    robot->start();
    return robot;
  };
  const auto let_in = [&](const char* name, End& robot) {
    End op(dialling(lab, name, rt::Box::kOperator, robot.link->port()));
    op.start();
    EXPECT_TRUE(wait_for([&] { return op.ready() || op.link->counts().failed > 0; }));
    return op.ready();
  };
  EXPECT_TRUE(let_in("bob", *started()));
  lab.revoke("bob");
  EXPECT_EQ(started()->link->note(), "");  // has used the newer one
  const auto overwrite = fs::copy_options::overwrite_existing;
  fs::copy_file(old, list, overwrite);
  fs::copy_file(old, lab.box("bob") + "/ca.crl", overwrite);  // a thief would not ask his own
  {
    const auto robot = started();
    EXPECT_THAT(robot->link->note(), HasSubstr("older than the list that this box has used"));
    EXPECT_FALSE(let_in("bob", *robot));
    EXPECT_THAT(robot->link->last_refusal(), HasSubstr("is revoked"));
    EXPECT_TRUE(let_in("ada", *robot));
  }
  const auto kept = fs::directory_iterator(options.state)->path();
  std::ofstream(kept) << "no list";
  {
    const auto robot = started();
    EXPECT_THAT(robot->link->note(), HasSubstr(kept.string() + ": not a list of revoked"));
    EXPECT_TRUE(let_in("bob", *robot)) << "who can write the folder can take the list away";
  }
  EXPECT_EQ(started()->link->note(), "") << "written anew";
}

TEST(Revoked, ABoxThatCanNotKeepItsListSaysSoAndRuns) {
  Lab lab;
  auto options = listening(lab, "rover", rt::Box::kRobot);
  lab.issue(rt::Box::kOperator, "bob");
  options.state = lab.folder.path + "/state";
  std::ofstream(options.state) << "no folder";
  End robot(options);
  robot.start();
  EXPECT_THAT(robot.link->note(), HasSubstr("the list is not kept over a restart"));
  End op(dialling(lab, "ada", rt::Box::kOperator, robot.link->port()));
  op.start();
  EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
  std::filesystem::remove(options.state);
  lab.revoke("bob");
  EXPECT_TRUE(wait_for([&] { return robot.link->note().empty(); })) << "the next one is kept";
}

}  // namespace
