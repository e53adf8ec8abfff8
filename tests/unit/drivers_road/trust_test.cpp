// Who is let in: each kind of wrong certificate against a listening robot and against a dialling
// operator, each with its own words; clocks that are unset or wrong; a box's own files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "drivers/road/trust.hpp"
#include "tests/unit/drivers_road/support.hpp"

namespace {

using namespace road_test;
using testing::HasSubstr;

struct Shown {
  std::string certificate, key;
};

// A robot that listens, and strangers that show it things.
struct Gate {
  Lab lab;
  std::unique_ptr<End> robot;
  std::function<std::int64_t()> clock{};
  explicit Gate(std::function<std::int64_t()> wall = {}) : clock(std::move(wall)) {
    auto options = listening(lab, "rover", rt::Box::kRobot);
    options.wall_clock_s = clock;
    robot = std::make_unique<End>(options);
    robot->start();
  }
  Shown box(const std::string& name) const {
    return {lab.box(name) + "/box.crt", lab.box(name) + "/box.key"};
  }
  // What the robot says of who shows that. The stranger hears nothing but the end.
  std::string verdict(const Shown& shown, int version = TLS1_3_VERSION) {
    const auto before = robot->link->counts().refused;
    {
      RawTls stranger(robot->link->port(), shown.certificate, shown.key, version);
      EXPECT_TRUE(stranger.greet().empty()) << "an answer to a stranger";
      EXPECT_TRUE(wait_for([&] { return robot->link->counts().refused > before; }));
    }
    EXPECT_EQ(robot->link->sessions(), 0U);
    return robot->link->last_refusal();
  }
  void expect_friend_welcome() {
    End ada(dialling(lab, "ada", rt::Box::kOperator, robot->link->port()));
    ada.start();
    EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
  }
};

Shown write_shown(const Folder& folder, const std::string& name, EVP_PKEY& key, X509& certificate) {
  const Shown s{folder.path + "/" + name + ".crt", folder.path + "/" + name + ".key"};
  std::ofstream(s.certificate) << teletact::pem_of(certificate);
  std::ofstream(s.key) << teletact::pem_of(key);
  ::chmod(s.key.c_str(), 0600);
  return s;
}

TEST(Certificates, EachWrongOneIsRefusedInItsOwnWords) {
  Gate gate;
  const std::int64_t now = wall_s();
  EXPECT_THAT(gate.verdict({}), HasSubstr("it shows no certificate"));

  Lab other;  // of the same name: only the key tells them apart
  EXPECT_THAT(gate.verdict({other.box("ada") + "/box.crt", other.box("ada") + "/box.key"}),
              HasSubstr("not signed by this lab's CA"));

  gate.lab.issue(rt::Box::kOperator, "old");
  gate.lab.certify("old", rt::Box::kOperator, now - 100 * kDay_s, now - 10 * kDay_s);
  EXPECT_THAT(gate.verdict(gate.box("old")),
              HasSubstr("expired on " + drivers::day_of(now - 10 * kDay_s)));
  gate.lab.certify("old", rt::Box::kOperator, now + 10 * kDay_s, now + 100 * kDay_s);
  EXPECT_THAT(gate.verdict(gate.box("old")),
              HasSubstr("not valid before " + drivers::day_of(now + 10 * kDay_s)));

  EXPECT_THAT(gate.verdict(gate.box("rover")), HasSubstr("role robot, and so is this box"));

  gate.lab.issue(rt::Box::kOperator, "lost");
  const Shown lost = gate.box("lost");
  gate.lab.revoke("lost");
  // Until the robot has read the list again it may still answer.
  ASSERT_TRUE(wait_for([&] {
    RawTls stranger(gate.robot->link->port(), lost.certificate, lost.key, TLS1_3_VERSION);
    static_cast<void>(stranger.greet());
    return gate.robot->link->last_refusal().find("is revoked") != std::string::npos;
  })) << gate.robot->link->last_refusal();
  EXPECT_THAT(gate.verdict(lost), HasSubstr("is revoked"));
  gate.expect_friend_welcome();
}

TEST(Certificates, HomeMadeOnesAreRefused) {
  Gate gate;
  Folder made;
  const std::int64_t now = wall_s();
  auto key = teletact::make_key();
  ASSERT_TRUE(key);
  EVP_PKEY& k = *key.value();
  const teletact::CertificateSpec spec{"ada", "operator", now - 100, now + kDay_s, false};
  auto by_itself = teletact::make_certificate(spec, k, nullptr, k);
  ASSERT_TRUE(by_itself);
  EXPECT_THAT(gate.verdict(write_shown(made, "self", k, *by_itself.value())),
              HasSubstr("signed by itself"));

  // Ada can not make certificates, though hers is good.
  auto ada = drivers::read_certificate(gate.lab.box("ada") + "/box.crt");
  auto ada_key = drivers::read_key(gate.lab.box("ada") + "/box.key");
  auto by_ada = teletact::make_certificate(spec, k, ada.value().get(), *ada_key.value());
  ASSERT_TRUE(by_ada);
  EXPECT_THAT(gate.verdict(write_shown(made, "by_ada", k, *by_ada.value())),
              HasSubstr("not signed by this lab's CA"));

  // A certificate of the lab that names no role, or no box.
  auto ca = drivers::read_certificate(gate.lab.at + "/ca.crt");
  auto ca_key = drivers::read_key(gate.lab.at + "/ca.key");
  teletact::CertificateSpec odd = spec;
  odd.unit = "visitor";
  auto no_role = teletact::make_certificate(odd, k, ca.value().get(), *ca_key.value());
  ASSERT_TRUE(no_role);
  EXPECT_THAT(gate.verdict(write_shown(made, "no_role", k, *no_role.value())),
              HasSubstr("neither robot nor operator"));
  odd = spec;
  odd.name = "a b\x1b[2J";
  auto no_name = teletact::make_certificate(odd, k, ca.value().get(), *ca_key.value());
  ASSERT_TRUE(no_name);
  EXPECT_THAT(gate.verdict(write_shown(made, "no_name", k, *no_name.value())),
              HasSubstr("names no box"));
  gate.expect_friend_welcome();
}

// Else a stranger could have 100 kB of certificates kept of each of its connections.
TEST(Certificates, MoreThanAnyBoxHasAreRefusedAndCounted) {
  Gate gate;
  Folder made;
  std::stringstream one;
  one << std::ifstream(gate.box("ada").certificate).rdbuf();
  const std::string many = made.path + "/many.crt";
  for (int i = 0; i < 20; ++i) std::ofstream(many, std::ios::app) << one.str();
  EXPECT_THAT(gate.verdict({many, gate.box("ada").key}), HasSubstr("more certificates than any"));
  gate.expect_friend_welcome();
  // The longest names that a lab gives.
  Lab lab(std::string(40, 'l'));
  const std::string longest(40, 'o');
  lab.issue(rt::Box::kOperator, longest);
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.start();
  End op(dialling(lab, longest, rt::Box::kOperator, robot.link->port()));
  op.start();
  EXPECT_TRUE(wait_for([&] { return op.ready(); })) << op.link->fault();
}

TEST(Certificates, OlderTlsAndNoTlsAreRefused) {
  Gate gate;
  EXPECT_THAT(gate.verdict(gate.box("ada"), TLS1_2_VERSION), HasSubstr("does not speak TLS 1.3"));
  gate.expect_friend_welcome();
}

// The dialling side judges too: a robot of another lab, and one whose certificate has run out.
TEST(Certificates, AWrongRobotIsNotTalkedTo) {
  Lab lab, other;
  End wrong(listening(other, "rover", rt::Box::kRobot));
  wrong.start();
  End ada(dialling(lab, "ada", rt::Box::kOperator, wrong.link->port()));
  ada.start();
  ASSERT_TRUE(wait_for([&] { return ada.link->counts().failed > 0; }));
  EXPECT_THAT(ada.link->fault(), HasSubstr("its certificate is not signed by this lab's CA"));
  EXPECT_EQ(ada.link->sessions(), 0U);

  // Another operator in the robot's place.
  lab.issue(rt::Box::kOperator, "bob");
  End bob(listening(lab, "bob", rt::Box::kOperator));
  bob.start();
  End eve(dialling(lab, "ada", rt::Box::kOperator, bob.link->port()));
  eve.start();
  ASSERT_TRUE(wait_for([&] { return eve.link->counts().failed > 0; }));
  EXPECT_THAT(eve.link->fault(), HasSubstr("role operator, and so is this box"));

  End rover(listening(lab, "rover", rt::Box::kRobot));
  rover.start();
  const std::int64_t now = wall_s();
  lab.certify("ada", rt::Box::kOperator, now - 100, now + 3000 * kDay_s);
  auto late = dialling(lab, "ada", rt::Box::kOperator, rover.link->port());
  late.wall_clock_s = [now] { return now + 400 * kDay_s; };
  End later(late);
  later.start();
  ASSERT_TRUE(wait_for([&] { return later.link->counts().failed > 0; }));
  EXPECT_THAT(later.link->fault(),
              HasSubstr("(it is taken to be " + drivers::day_of(now + 400 * kDay_s) + ")"))
      << "a clock that is ahead is named";
  EXPECT_THAT(later.link->fault(), HasSubstr("its certificate expired on"));
}

// ---- clocks ----

TEST(Clock, AnUnsetClockIsReplacedByTheNewestDateThatIsKnown) {
  Gate gate([] { return std::int64_t{0}; });  // 1970
  ASSERT_TRUE(wait_for([&] { return !gate.robot->link->note().empty(); }));
  EXPECT_THAT(gate.robot->link->note(), HasSubstr("this box's clock says 1970-01-01"));
  const std::int64_t now = wall_s();
  gate.lab.issue(rt::Box::kOperator, "old");
  gate.lab.certify("old", rt::Box::kOperator, now - 100 * kDay_s, now - 10 * kDay_s);
  EXPECT_THAT(gate.verdict(gate.box("old")), HasSubstr("expired on"))
      << "1970 is before its end, but the box knows better";
  gate.expect_friend_welcome();
}

// An operator was taken on, or its certificate renewed, after all that the robot has was made.
TEST(Clock, AnUnsetClockTakesACertificateThatIsNewerThanAllItKnows) {
  Gate gate([] { return std::int64_t{0}; });
  const std::int64_t now = wall_s();
  gate.lab.certify("ada", rt::Box::kOperator, now + 100 * kDay_s, now + 400 * kDay_s);
  auto options = dialling(gate.lab, "ada", rt::Box::kOperator, gate.robot->link->port());
  options.wall_clock_s = [now] { return now + 200 * kDay_s; };
  End ada(options);
  ada.start();
  EXPECT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
}

// One hour to and fro in a running session: nothing of the session hangs on the wall clock.
TEST(Clock, AStepOfTheWallClockDisturbsNoSession) {
  std::atomic<std::int64_t> wall{wall_s()};
  Gate gate([&] { return wall.load(); });
  End ada(dialling(gate.lab, "ada", rt::Box::kOperator, gate.robot->link->port()));
  ada.talk();
  gate.robot->talk();
  ada.start();
  ASSERT_TRUE(wait_for([&] { return ada.ready(); })) << ada.link->fault();
  for (const std::int64_t step : {3600, -7200, 3600}) {
    wall += step;
    EXPECT_TRUE(ada.ready());
    EXPECT_EQ(ada.link->sessions(), 1U);
    std::this_thread::sleep_for(std::chrono::milliseconds(120));
  }
  EXPECT_EQ(ada.link->sessions(), 1U);
}

// ---- a box's own files ----

std::string refusal(const Lab& lab, const std::string& name, rt::Box role) {
  const auto opened = drivers::RoadLink::open(listening(lab, name, role));
  EXPECT_FALSE(opened);
  const std::string text = opened ? "" : opened.error();
  EXPECT_EQ(text.find('\n'), std::string::npos);
  EXPECT_THAT(text, HasSubstr(lab.box(name)));
  return text;
}

TEST(OwnFiles, EachIsCheckedAndNamed) {
  namespace fs = std::filesystem;
  Lab lab, other;
  const auto robot = [&] { return refusal(lab, "rover", rt::Box::kRobot); };
  EXPECT_THAT(refusal(lab, "rover", rt::Box::kOperator),
              HasSubstr("box.crt: it is the certificate of a robot, this box is the operator"));
  EXPECT_THAT(refusal(lab, "nobody", rt::Box::kRobot), HasSubstr("ca.crt: No such file"));

  const std::string at = lab.box("rover");
  ::chmod((at + "/box.key").c_str(), 0644);
  EXPECT_THAT(robot(), HasSubstr("box.key: a key must belong to the user"));
  ::chmod((at + "/box.key").c_str(), 0600);
  fs::rename(at + "/box.key", at + "/good.key");
  fs::copy_file(lab.box("ada") + "/box.key", at + "/box.key");
  EXPECT_THAT(robot(), HasSubstr("box.key is not the key of this certificate"));
  fs::remove(at + "/box.key");
  fs::rename(at + "/good.key", at + "/box.key");

  fs::copy_file(at + "/ca.crt", at + "/good.crt");
  fs::copy_file(other.at + "/ca.crt", at + "/ca.crt", fs::copy_options::overwrite_existing);
  EXPECT_THAT(robot(), HasSubstr("ca.crl: not signed by the CA of ca.crt"));
  fs::copy_file(other.at + "/ca.crl", at + "/ca.crl", fs::copy_options::overwrite_existing);
  EXPECT_THAT(robot(), HasSubstr("box.crt: not signed by the CA of ca.crt"));
  fs::copy_file(at + "/good.crt", at + "/ca.crt", fs::copy_options::overwrite_existing);
  fs::copy_file(lab.at + "/ca.crl", at + "/ca.crl", fs::copy_options::overwrite_existing);

  const std::int64_t now = wall_s();
  lab.certify("rover", rt::Box::kRobot, now - 100 * kDay_s, now - 10 * kDay_s);
  EXPECT_THAT(robot(), HasSubstr("box.crt: expired on "));
  lab.certify("rover", rt::Box::kRobot, now - 100, now + 5 * kDay_s);
  auto near = drivers::RoadLink::open(listening(lab, "rover", rt::Box::kRobot));
  ASSERT_TRUE(near) << near.error();
  EXPECT_THAT(near.value()->note(), HasSubstr("expires on"));

  std::ofstream(at + "/ca.crl", std::ios::trunc) << "junk";
  EXPECT_THAT(robot(), HasSubstr("ca.crl: not a list of revoked certificates"));
  std::ofstream(at + "/box.crt", std::ios::trunc) << "junk";
  EXPECT_THAT(robot(), HasSubstr("box.crt: not a certificate"));
  std::ofstream(at + "/ca.crt", std::ios::trunc) << std::string(2'000'000, 'x');
  EXPECT_THAT(robot(), HasSubstr("ca.crt: longer than 1 MiB"));
}

// Who may write them decides whom the box trusts.
TEST(OwnFiles, NobodyElseMayWriteThem) {
  Lab lab;
  const std::string at = lab.box("rover");
  for (const std::string name : {"/ca.crt", "/box.crt", "/ca.crl", ""}) {
    const mode_t good = name.empty() ? 0755 : 0644;
    for (const mode_t bad : {good | 0020U, good | 0002U}) {
      ::chmod((at + name).c_str(), bad);
      EXPECT_THAT(refusal(lab, "rover", rt::Box::kRobot), HasSubstr("nobody else may write it"))
          << name;
    }
    ::chmod((at + name).c_str(), good);
    EXPECT_TRUE(drivers::RoadLink::open(listening(lab, "rover", rt::Box::kRobot))) << name;
    if (::geteuid() != 0) continue;
    ASSERT_EQ(::chown((at + name).c_str(), 4711, 4711), 0);
    EXPECT_THAT(refusal(lab, "rover", rt::Box::kRobot), HasSubstr("or to root")) << name;
    ASSERT_EQ(::chown((at + name).c_str(), 0, 0), 0);
  }
}

// A running box takes a renewed certificate without a restart, and keeps the old one where the new
// one is no good; the session that stands does not notice.
TEST(OwnFiles, ARenewedCertificateIsShownFromTheNextHandshakeOn) {
  Lab lab;
  const std::int64_t now = wall_s();
  lab.certify("rover", rt::Box::kRobot, now - 100, now + 5 * kDay_s);
  End robot(listening(lab, "rover", rt::Box::kRobot));
  robot.talk();
  robot.start();
  End ada(dialling(lab, "ada", rt::Box::kOperator, robot.link->port()));
  ada.talk();
  ada.start();
  ASSERT_TRUE(wait_for([&] { return ada.ready() && robot.ready(); })) << ada.link->fault();
  EXPECT_THAT(robot.link->notes().note, HasSubstr("expires on"));
  const std::string serial = ada.link->peer().serial;

  std::ofstream(lab.box("rover") + "/box.crt", std::ios::trunc) << "half a file";
  ASSERT_TRUE(wait_for([&] {
    return robot.link->notes().note.find("the certificate of before stays") != std::string::npos;
  }));
  lab.certify("rover", rt::Box::kRobot, now - 100, now + 300 * kDay_s);
  ASSERT_TRUE(wait_for([&] { return robot.link->notes().note.empty(); }))
      << robot.link->notes().note;
  EXPECT_EQ(robot.link->notes().certificate_until_s, now + 300 * kDay_s);
  EXPECT_TRUE(ada.ready());
  EXPECT_EQ(ada.link->sessions(), 1U) << "what stands goes on";
  ada.link->stop();
  End again(dialling(lab, "ada", rt::Box::kOperator, robot.link->port()));
  again.start();
  ASSERT_TRUE(wait_for([&] { return again.ready(); })) << again.link->fault();
  EXPECT_NE(again.link->peer().serial, serial);
  EXPECT_EQ(again.link->peer().valid_until_s, now + 300 * kDay_s);
}

TEST(Options, EachHasItsRange) {
  Lab lab;
  const auto good = listening(lab, "rover", rt::Box::kRobot);
  const auto error = [](const drivers::RoadOptions& o) {
    const auto opened = drivers::RoadLink::open(o);
    EXPECT_FALSE(opened);
    return opened ? std::string() : opened.error();
  };
  auto o = good;
  o.port = 65536;
  EXPECT_EQ(error(o), "road.port = 65536: allowed 0..65535");
  o = good;
  o.listen = false;
  EXPECT_EQ(error(o), "road.port = 0: allowed 1..65535");
  o = good;
  o.address = "nowhere";
  EXPECT_THAT(error(o), HasSubstr("listen on nowhere:0: not an IPv4 or IPv6 address"));
  o.address = "";
  EXPECT_THAT(error(o), HasSubstr("road.address"));
  o = good;
  o.rate_Mbit_per_s = -1;
  EXPECT_THAT(error(o), HasSubstr("road.rate_Mbit_per_s"));
  for (const char* peer : {"sha256:12", "a b", "sha256:zz"}) {
    o = good;
    o.expected_peer = peer;
    EXPECT_THAT(error(o), HasSubstr("road.expected_peer")) << peer;
  }
  o = good;
  End first(good);
  o.port = first.link->port();
  EXPECT_THAT(error(o), HasSubstr("Address already in use"));
}

}  // namespace
