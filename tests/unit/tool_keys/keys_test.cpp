// The lab's CA: what it makes, with which rights, and what it refuses. `openssl verify`, where it
// is installed, is the second opinion on certificates and lists.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "drivers/road/trust.hpp"
#include "tools/keys/certificate_maker.hpp"
#include "tools/keys/key_lab.hpp"

namespace {

namespace fs = std::filesystem;
using drivers::RoadOptions;
using drivers::RoadTrust;
using teletact::KeyLab;
using testing::EndsWith;
using testing::HasSubstr;

constexpr std::int64_t kDay_s = 86400;

class Keys : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "teletact_keys_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    at_ = name + "/lab";
    now_ = std::time(nullptr);
    const auto made = KeyLab::init(at_, "lab-1", 3650, now_);
    ASSERT_TRUE(made) << made.error();
  }
  void TearDown() override { fs::remove_all(folder_); }
  KeyLab lab() {
    auto opened = KeyLab::open(at_);
    EXPECT_TRUE(opened) << (opened ? "" : opened.error());
    return std::move(opened).value();
  }
  std::string issue(rt::Box role, const std::string& name, int days = 365) {
    auto made = lab().issue(role, name, days, now_);
    EXPECT_TRUE(made) << (made ? "" : made.error());
    return made ? made.value() : "";
  }
  static std::string text(const std::string& path) {
    std::ostringstream s;
    s << std::ifstream(path).rdbuf();
    return s.str();
  }
  static RoadOptions options(const std::string& box, rt::Box role) {
    RoadOptions o;
    o.role = role;
    o.keys = box;
    return o;
  }
  static drivers::RoadPeer peer(const std::string& box) {
    return drivers::read_peer(*drivers::read_certificate(box + "/box.crt").value()).value();
  }
  std::string folder_, at_;
  std::int64_t now_ = 0;
};

TEST_F(Keys, ABoxFolderIsAllThatABoxNeeds) {
  const std::string box = issue(rt::Box::kRobot, "rover");
  EXPECT_THAT(box, EndsWith("/boxes/rover"));
  const auto trust = RoadTrust::load(options(box, rt::Box::kRobot));
  ASSERT_TRUE(trust) << trust.error();
  EXPECT_EQ(trust.value()->self().name, "rover");
  EXPECT_EQ(trust.value()->self().role, rt::Box::kRobot);
  EXPECT_EQ(trust.value()->self().valid_until_s, now_ + 365 * kDay_s);
  EXPECT_EQ(trust.value()->self().key_sha256.size(), 64U);
}

TEST_F(Keys, EverythingIsForItsOwnerAlone) {
  issue(rt::Box::kOperator, "ada");
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(at_)) {
    struct stat info {};
    ASSERT_EQ(::stat(entry.path().c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777U, entry.is_directory() ? 0700U : 0600U) << entry.path();
    files += entry.is_directory() ? 0 : 1;
  }
  EXPECT_EQ(files, 8);
  struct stat info {};
  ASSERT_EQ(::stat(at_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0700U);
}

TEST_F(Keys, NothingIsOverwritten) {
  const std::string box = issue(rt::Box::kRobot, "rover");
  const std::string key = text(box + "/box.key"), ca = text(at_ + "/ca.key");
  auto again = KeyLab::init(at_, "lab-2", 10, now_);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error(), at_ + "/ca.key: is there already and is not overwritten");
  for (const rt::Box role : {rt::Box::kRobot, rt::Box::kOperator}) {
    const auto twice = lab().issue(role, "rover", 365, now_);
    ASSERT_FALSE(twice);
    EXPECT_EQ(twice.error(), box + ": is there already and is not overwritten");
  }
  EXPECT_EQ(text(box + "/box.key"), key);
  EXPECT_EQ(text(at_ + "/ca.key"), ca);
  fs::remove(at_ + "/ca.key");
  EXPECT_FALSE(KeyLab::init(at_, "lab-2", 10, now_)) << "half a lab is a lab";
  const auto lost = KeyLab::open(at_);
  ASSERT_FALSE(lost);
  EXPECT_THAT(lost.error(), HasSubstr("ca.key: No such file"));
}

TEST_F(Keys, RenewKeepsTheKeyAndReplacesTheDates) {
  const std::string box = issue(rt::Box::kRobot, "rover", 10);
  const auto before = peer(box);
  const std::string key = text(box + "/box.key");
  auto renewed = lab().renew("rover", 400, false, now_);
  ASSERT_TRUE(renewed) << renewed.error();
  const auto after = peer(box);
  EXPECT_EQ(after.name, "rover");
  EXPECT_EQ(after.role, rt::Box::kRobot);
  EXPECT_EQ(after.key_sha256, before.key_sha256);
  EXPECT_NE(after.serial, before.serial);
  EXPECT_EQ(after.valid_until_s, now_ + 400 * kDay_s);
  EXPECT_EQ(text(box + "/box.key"), key);
  ASSERT_TRUE(RoadTrust::load(options(box, rt::Box::kRobot)));

  ASSERT_TRUE(lab().renew("rover", 400, true, now_));
  EXPECT_NE(peer(box).key_sha256, before.key_sha256);
  const auto trust = RoadTrust::load(options(box, rt::Box::kRobot));
  EXPECT_TRUE(trust) << trust.error();
  EXPECT_FALSE(fs::exists(box + "/box.key.new"));
}

TEST_F(Keys, RevokeTakesEveryCertificateOfTheNameAndReachesEveryBox) {
  const std::string ada = issue(rt::Box::kOperator, "ada"), bob = issue(rt::Box::kOperator, "bob");
  const auto first = peer(ada);
  ASSERT_TRUE(lab().renew("ada", 365, false, now_));
  const auto second = peer(ada);
  const auto ca = drivers::read_certificate(at_ + "/ca.crt");
  const auto number = [&](const std::string& file) {
    return drivers::revoked_number(*drivers::read_revoked(file, *ca.value()).value());
  };
  EXPECT_EQ(number(bob + "/ca.crl"), 1);
  const auto n = lab().revoke("ada", now_);
  ASSERT_TRUE(n) << n.error();
  EXPECT_EQ(n.value(), 2);
  EXPECT_EQ(number(at_ + "/ca.crl"), 2);
  EXPECT_EQ(text(bob + "/ca.crl"), text(at_ + "/ca.crl"));
  const auto trust = RoadTrust::load(options(bob, rt::Box::kOperator));
  ASSERT_TRUE(trust) << trust.error();
  EXPECT_TRUE(trust.value()->revoked(first.serial));
  EXPECT_TRUE(trust.value()->revoked(second.serial));
  EXPECT_FALSE(trust.value()->revoked(peer(bob).serial));
  EXPECT_FALSE(trust.value()->revoked("00"));
  EXPECT_FALSE(RoadTrust::load(options(ada, rt::Box::kOperator)));

  const auto again = lab().revoke("ada", now_);
  ASSERT_TRUE(again);
  EXPECT_EQ(again.value(), 0);
  EXPECT_EQ(number(at_ + "/ca.crl"), 2) << "nothing new, no new list";

  // What failed half way is made good by the next call.
  const std::string old = text(bob + "/ca.crl");
  std::ofstream(at_ + "/boxes/stray") << "no folder of a box";
  std::filesystem::remove(bob + "/ca.crl");
  std::filesystem::create_directory(bob + "/ca.crl");
  const auto half = lab().revoke("ada", now_);
  ASSERT_FALSE(half);
  EXPECT_THAT(half.error(), HasSubstr(bob + "/ca.crl"));
  std::filesystem::remove(bob + "/ca.crl");
  const auto whole = lab().revoke("ada", now_);
  ASSERT_TRUE(whole) << whole.error();
  EXPECT_EQ(text(bob + "/ca.crl"), old);
  const auto same_key = lab().renew("ada", 365, false, now_);
  ASSERT_FALSE(same_key);
  EXPECT_THAT(same_key.error(), HasSubstr("is revoked; --new-key"));
  ASSERT_TRUE(lab().renew("ada", 365, true, now_));
  EXPECT_TRUE(RoadTrust::load(options(ada, rt::Box::kOperator)));
  // What was revoked stays so when another one is.
  ASSERT_TRUE(lab().revoke("bob", now_ + 5));
  auto list = drivers::read_revoked(at_ + "/ca.crl", *ca.value());
  EXPECT_EQ(teletact::rows_of(*list.value()).size(), 3U);
}

TEST_F(Keys, TheListSaysWhatIsWhat) {
  issue(rt::Box::kRobot, "rover", 20);
  issue(rt::Box::kOperator, "ada");
  ASSERT_TRUE(lab().renew("rover", 300, false, now_ + 10));
  ASSERT_TRUE(lab().revoke("ada", now_));
  const auto rows = lab().list();
  ASSERT_TRUE(rows) << rows.error();
  ASSERT_EQ(rows.value().size(), 3U);
  const auto& r = rows.value();
  EXPECT_EQ(r[0].box.name, "ada");
  EXPECT_TRUE(r[0].revoked);
  EXPECT_EQ(r[1].box.valid_until_s, now_ + 20 * kDay_s);
  EXPECT_FALSE(r[1].current);
  EXPECT_TRUE(r[2].current);
  EXPECT_EQ(r[2].box.valid_until_s, now_ + 10 + 300 * kDay_s);
  std::ofstream(at_ + "/certificates/odd.crt") << "junk";
  const auto odd = lab().list();
  ASSERT_FALSE(odd);
  EXPECT_THAT(odd.error(), HasSubstr("odd.crt: not a certificate"));
}

TEST_F(Keys, NamesAndDaysHaveTheirRanges) {
  for (const char* name : {"", ".", "..", "../x", "a/b", "a b", "-x", "\xc3\xa4", "a\nb",
                           "01234567890123456789012345678901234567890"}) {
    const auto made = lab().issue(rt::Box::kRobot, name, 365, now_);
    ASSERT_FALSE(made) << name;
    EXPECT_THAT(made.error(), HasSubstr("allowed 1 to 40 letters, digits"));
    EXPECT_FALSE(lab().renew(name, 365, false, now_));
    EXPECT_FALSE(lab().revoke(name, now_));
  }
  for (const int days : {0, -5, KeyLab::kMostDays + 1}) {
    const auto made = lab().issue(rt::Box::kRobot, "rover", days, now_);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error(), "--days " + std::to_string(days) + ": allowed 1..7300");
  }
  const auto beyond = lab().issue(rt::Box::kRobot, "rover", 4000, now_);
  ASSERT_FALSE(beyond);
  EXPECT_THAT(beyond.error(), HasSubstr("the CA itself expires on"));
  EXPECT_FALSE(fs::exists(at_ + "/boxes/rover")) << "nothing is left behind";
  EXPECT_TRUE(lab().issue(rt::Box::kRobot, "rover", 365, now_));
  const auto nobody = lab().revoke("nobody", now_);
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error(), "name 'nobody': no certificate was issued for it");
}

TEST_F(Keys, SerialsAreLongAndDiffer) {
  auto key = teletact::make_key();
  ASSERT_TRUE(key);
  std::set<std::string> serials;
  for (int i = 0; i < 50; ++i) {
    auto c = teletact::make_certificate({"x", "robot", now_, now_ + 10, false}, *key.value(),
                                        nullptr, *key.value());
    ASSERT_TRUE(c);
    const std::string serial = drivers::serial_of(*c.value());
    EXPECT_EQ(serial.size(), 32U);
    serials.insert(serial);
  }
  EXPECT_EQ(serials.size(), 50U);
}

TEST_F(Keys, OpensslItselfAgrees) {
  if (std::system("openssl version >/dev/null 2>&1") != 0) GTEST_SKIP() << "no openssl program";
  const std::string ada = issue(rt::Box::kOperator, "ada");
  const auto verify = [&](const std::string& purpose) {
    const std::string command = "openssl verify -x509_strict -crl_check -purpose " + purpose +
                                " -CAfile " + at_ + "/ca.crt -CRLfile " + at_ + "/ca.crl " + ada +
                                "/box.crt >/dev/null 2>&1";
    return std::system(command.c_str()) == 0;
  };
  EXPECT_TRUE(verify("sslclient"));
  EXPECT_TRUE(verify("sslserver"));
  ASSERT_TRUE(lab().revoke("ada", now_));
  EXPECT_FALSE(verify("sslclient"));
}

}  // namespace
