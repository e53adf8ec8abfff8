// Boards whose mailbox answers with zeros, refuses, or says nothing: asked again, then named, and the
// other rows are there.
#include <gmock/gmock.h>

#include "drivers/youbot_bus/youbot_setup.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

using testing::HasSubstr;
using Faults = yb::DriveBoard::MailboxFaults;

struct Bench {
  explicit Bench(const yb::YoubotChainConfig& c = {}) : rig(c) {
    rig.bring_up();
    session.emplace(rig.startup.token(), rig.master, rig.port, c.kind);
  }
  std::vector<yb::DriveReport> check() {
    const auto rows = yb::check(*session);
    EXPECT_TRUE(rows) << rows.error();
    return rows ? rows.value() : std::vector<yb::DriveReport>{};
  }
  // From here on, of the bench's own clock.
  [[nodiscard]] double seconds_of(const std::function<void()>& act) {
    const rt::Time begun = rig.port.now();
    act();
    return rt::seconds(rig.port.now() - begun);
  }
  BusRig rig;
  std::optional<yb::DriveSession> session;
};

TEST(MailboxPatience, ZerosInPlaceOfAVersionAreAskedForAgain) {
  for (const int zeros : {1, 3, 49}) {
    Bench bench;
    for (const std::size_t i : {1U, 4U, 8U})
      bench.rig.chain.drive(i)->set_mailbox_faults({.empty_versions = zeros});
    const auto rows = bench.check();
    ASSERT_EQ(rows.size(), 9U);
    for (const auto& r : rows) EXPECT_EQ(r.firmware.version, 200) << r.name << ", " << zeros;
  }
}

TEST(MailboxPatience, AVersionThatNeverComesIsNamedAndTheOtherRowsAreThere) {
  Bench bench;
  bench.rig.chain.drive(1)->set_mailbox_faults({.empty_versions = 1'000'000});
  const auto rows = bench.check();
  ASSERT_EQ(rows.size(), 9U);
  EXPECT_EQ(rows[0].firmware.controller, 0);
  EXPECT_NEAR(rows[0].supply_V, 24, 1e-9) << "the rest of its row";
  EXPECT_THAT(rows[0].wrong,
              HasSubstr("does not tell its firmware: its firmware's version is no text (asked 50"));
  for (std::size_t k = 1; k < rows.size(); ++k) EXPECT_EQ(rows[k].firmware.version, 200) << k;
}

TEST(MailboxPatience, ARefusedAndASilentParameterAreNamed) {
  Bench bench;
  bench.rig.chain.drive(2)->set_mailbox_faults({.refuses = 151});
  bench.rig.chain.drive(3)->set_mailbox_faults({.silent = 152});
  std::vector<yb::DriveReport> rows;
  const double took_s = bench.seconds_of([&] { rows = bench.check(); });
  ASSERT_EQ(rows.size(), 9U);
  EXPECT_TRUE(std::isnan(rows[1].supply_V));
  EXPECT_THAT(rows[1].wrong, HasSubstr("does not tell its supply voltage (axis parameter 151): "));
  EXPECT_THAT(rows[1].wrong, HasSubstr("wrong type"));
  EXPECT_NEAR(rows[1].temperature_C, 25, 1);
  EXPECT_TRUE(std::isnan(rows[2].temperature_C));
  EXPECT_THAT(rows[2].wrong, HasSubstr("silent for 5 s"));
  EXPECT_EQ(rows[3].wrong.find("tell"), std::string::npos) << rows[3].wrong;
  EXPECT_LT(took_s, 8);
}

TEST(MailboxPatience, ADeadMailboxCostsFiveSeconds) {
  Bench bench;
  bench.rig.chain.drive(6)->set_mailbox_faults({.dead = true});
  std::vector<yb::DriveReport> rows;
  const double took_s = bench.seconds_of([&] { rows = bench.check(); });
  ASSERT_EQ(rows.size(), 9U);
  EXPECT_GE(took_s, 5);
  EXPECT_LT(took_s, 6.5);
  EXPECT_THAT(rows[4].wrong, HasSubstr("its mailbox has been silent for 5 s"));
  EXPECT_EQ(rows[4].firmware.controller, 0);
  for (const std::size_t k : {3U, 5U, 8U}) EXPECT_EQ(rows[k].firmware.version, 200) << k;
}

// Loses every frame in which a reply is read out of a mailbox, so many times.
class LosesReplies final : public ec::Port {
 public:
  explicit LosesReplies(ec::TwinPort& wire) : wire_(wire) {}
  bool send(std::span<const std::uint8_t> f) noexcept override {
    ec::parse_frame(f, view_);
    lose_ = false;
    for (std::size_t i = 0; i < view_.count; ++i) {
      const ec::DatagramView& d = view_.datagram[i];
      if (d.command == ec::Command::kFprd && d.address >> 16U == 0x1080 && left > 0) lose_ = true;
    }
    left -= lose_ ? 1 : 0;
    return wire_.send(f);
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    const std::size_t n = wire_.receive(into, deadline);
    return lose_ ? 0 : n;
  }
  [[nodiscard]] rt::Time now() const noexcept override { return wire_.now(); }
  void sleep_until(rt::Time t) noexcept override { wire_.sleep_until(t); }
  int left = 0;

 private:
  ec::TwinPort& wire_;
  ec::FrameView view_;
  bool lose_ = false;
};

// With and without the repeat bit; and no answer is taken for the next one's.
TEST(MailboxPatience, ALostReplyIsGotAllTheSame) {
  for (const bool repeats : {true, false}) {
    yb::YoubotChainConfig c;
    c.kind = yb::ChainKind::kBase;
    c.esc.knows_repeat = repeats;
    c.esc.mailbox_delay = 3ms;
    BusRig rig(c);
    LosesReplies port(rig.port);
    ec::Master master(rig.startup.token(), port);
    ASSERT_TRUE(master.find(rig.startup.token()));
    ASSERT_TRUE(master.configure(rig.startup.token()));
    ASSERT_TRUE(master.start(rig.startup.token()));
    yb::DriveSession session(rig.startup.token(), master, port, c.kind);
    for (int k = 0; k < 20; ++k) {
      port.left = 1 + k % 2;
      const auto steps = session.get(1, 250);
      ASSERT_TRUE(steps) << steps.error() << ", repeat bit " << repeats;
      EXPECT_EQ(steps.value(), 4000);
      port.left = 0;
      const auto poles = session.get(1, 253);
      ASSERT_TRUE(poles) << poles.error();
      EXPECT_EQ(poles.value(), 16) << "of its own question";
    }
  }
}

// A movement by so many counts, whose reply is lost, is not made twice.
TEST(MailboxPatience, AMovementIsNotAskedForTwice) {
  yb::YoubotChainConfig c;
  c.kind = yb::ChainKind::kBase;
  c.esc.knows_repeat = false;
  c.initialised = true;
  BusRig rig(c);
  LosesReplies port(rig.port);
  ec::Master master(rig.startup.token(), port);
  ASSERT_TRUE(master.find(rig.startup.token()));
  ASSERT_TRUE(master.configure(rig.startup.token()));
  ASSERT_TRUE(master.start(rig.startup.token()));
  yb::DriveSession session(rig.startup.token(), master, port, c.kind);
  ASSERT_TRUE(session.put(1, 158, 1));
  port.left = 1000;
  const auto moved = session.ask(
      1, {0, static_cast<std::uint8_t>(drivers::tmcl::Command::kMoveToPosition), 1, 0, 100});
  EXPECT_FALSE(moved);
  EXPECT_EQ(1000 - port.left, 1) << "the reply was read once, and the question not put again";
}

}  // namespace
}  // namespace tests
