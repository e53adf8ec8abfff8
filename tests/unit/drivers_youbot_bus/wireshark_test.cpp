// The frames of a whole bring-up, cycles, TMCL, CoE, faults and a recovery, written as pcap.
// tshark's EtherCAT dissector finds none malformed and reads the numbers that were sent, and a
// reader of the test's own sees what tshark does not look at. Where tshark is not installed that
// reader is alone. The mailbox dissector is off: raw TMCL has no mailbox head, and it takes it for
// one.
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <optional>
#include <thread>

#include "drivers/ethercat/capture_port.hpp"
#include "drivers/ethercat/mailbox_client.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "tests/unit/drivers_ethercat/coe_slave.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"
#include "tests/unit/drivers_youbot_bus/pcap_reader.hpp"

namespace tests {
namespace {

namespace fs = std::filesystem;

class WiresharkTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "teletact_pcap_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string folder_;
};

// A chain behind a port that writes down, and what the counters of its cycles have to be.
struct Recorded {
  Recorded(const std::string& file, const yb::YoubotChainConfig& c)
      : chain(startup.token(), c), twin(chain.wire()) {
    auto opened = ec::CapturePort::open(startup.token(), twin, file);
    EXPECT_TRUE(opened) << opened.error();
    port = std::move(opened.value());
    master.emplace(startup.token(), *port);
    EXPECT_TRUE(master->find(startup.token()));
    EXPECT_TRUE(master->configure(startup.token()));
    EXPECT_TRUE(master->start(startup.token()));
  }
  // A cycle of each form; `drives` of them answer. A drive has inputs and outputs.
  void cycle(int drives, int less = 0) {
    twin.set_now(twin.now() + 1ms);
    if (master->mapping().lrw) {
      expected.push_back(3 * drives - less);
    } else {
      expected.insert(expected.end(), {drives - less, drives});
    }
    (void)master->exchange();
    expected.insert(expected.end(), {drives, drives});
    (void)master->read_inputs();
    (void)master->write_outputs();
  }
  rt::Startup startup;
  yb::YoubotChain chain;
  ec::TwinPort twin;
  std::unique_ptr<ec::CapturePort> port;
  std::optional<ec::Master> master;
  std::vector<int> expected;
};

constexpr int kDrives = 9;  // of base and arm: 11 slaves, two of them without a motor

// Bring-up, TMCL, a cut behind slave 4 (three wheels before it), a slave that falls, the way back.
std::vector<int> run_a_bus(const std::string& file, bool forbids_lrw) {
  yb::YoubotChainConfig c;
  c.forbids_lrw = forbids_lrw;
  Recorded bus(file, c);
  for (int i = 0; i < 900; ++i) {
    if (i % 20 == 0)
      (void)bus.master->post(1, drivers::tmcl::encode(drivers::tmcl::Request{0, 6, 156, 0, i}));
    const bool cut = i >= 50 && i < 60;
    if (i == 50) bus.chain.wire().cut_behind(4);
    if (i == 60) bus.chain.wire().cut_behind(11);
    bus.cycle(cut ? 3 : kDrives);
  }
  bus.chain.wire().slave(6).fall(ec::al_code::kUnspecified, bus.twin.now());
  bus.chain.wire().slave(3).power_cycle(bus.twin.now());
  // What had no power maps nothing and has no address until it is set up again.
  int back = 0;
  bus.master->recover();
  while (bus.master->recovering() && ++back < 1000) {
    bus.twin.set_now(bus.twin.now() + 1ms);
    (void)bus.master->exchange();
  }
  EXPECT_FALSE(bus.master->stopped());
  bus.expected.clear();
  for (int i = 0; i < 30; ++i) bus.cycle(kDrives);
  EXPECT_EQ(bus.master->health().fault, ec::BusFault::kNone);
  EXPECT_TRUE(bus.port->close());
  return bus.expected;
}

TEST_F(WiresharkTest, NoFrameIsMalformed) {
  for (const bool forbids_lrw : {false, true}) {
    const std::string file = folder_ + "/bus.pcap";
    const auto expected = run_a_bus(file, forbids_lrw);
    const Seen s = read_back(file);
    EXPECT_TRUE(s.wrong.empty()) << s.wrong.size() << ", " << s.wrong[0];
    EXPECT_GT(s.frames, 5000U);
    EXPECT_EQ(s.replies, s.frames / 2);
    EXPECT_EQ(s.commands.count(12) == 0, forbids_lrw) << "LRW";
    counters_are(s, expected);
    if (tshark_is_there()) tshark_agrees(file, s);
  }
  if (!tshark_is_there()) GTEST_SKIP() << kNoTshark;
}

// Through a cut, cycle by cycle.
TEST_F(WiresharkTest, CountersOfEachCycleAreThoseOfTheSlavesThatAreThere) {
  const std::string file = folder_ + "/cut.pcap";
  Recorded bus(file, {});
  for (std::size_t n = 1; n <= 11; ++n) {
    bus.chain.wire().cut_behind(n);
    // Slaves 1 and 6 have no motor.
    const int drives = static_cast<int>(n) - (n >= 6 ? 2 : 1);
    for (int i = 0; i < 3; ++i) bus.cycle(drives);
  }
  ASSERT_TRUE(bus.port->close());
  const Seen s = read_back(file);
  EXPECT_TRUE(s.wrong.empty()) << s.wrong[0];
  counters_are(s, bus.expected);
  if (!tshark_is_there()) GTEST_SKIP() << kNoTshark;
  tshark_agrees(file, s);
}

// A counter that is one too small stands there as it was; the frame is whole.
TEST_F(WiresharkTest, AnotherCounterIsOnTheWireAsItIs) {
  const std::string file = folder_ + "/counter.pcap";
  Recorded bus(file, {});
  for (int i = 0; i < 100; ++i) {
    const int less = i % 10 == 0 ? 1 : 0;
    bus.twin.faults().wrong_counter = less;
    bus.cycle(kDrives, less);
  }
  EXPECT_EQ(bus.master->counters().short_counter, 10U);
  ASSERT_TRUE(bus.port->close());
  const Seen s = read_back(file);
  EXPECT_TRUE(s.wrong.empty()) << s.wrong[0];
  counters_are(s, bus.expected);
  if (!tshark_is_there()) GTEST_SKIP() << kNoTshark;
  tshark_agrees(file, s);
}

// Damaged replies: nothing that was sent is wrong, and what the reader finds wrong the master did
// not take. Damage of an index or address makes a frame of another, which only the master can tell.
TEST_F(WiresharkTest, DamagedRepliesAreTheOnlyWrongFrames) {
  const std::string file = folder_ + "/corrupt.pcap";
  Recorded bus(file, {});
  const auto before = bus.master->frames();
  constexpr int kDamaged = 60;
  for (int i = 0; i < kDamaged; ++i) {
    bus.twin.faults().seed = static_cast<std::uint64_t>(i);
    bus.twin.faults().corrupt = 1;
    bus.twin.set_now(bus.twin.now() + 2ms);
    (void)bus.master->exchange();
    bus.twin.set_now(bus.twin.now() + 2ms);
    EXPECT_EQ(bus.master->exchange().status, ec::CycleStatus::kOk);
  }
  const auto& after = bus.master->frames();
  const std::uint64_t damaged = after.damaged - before.damaged;
  ASSERT_TRUE(bus.port->close());
  const Seen s = read_back(file);
  // Reserved bits say nothing, to a master neither: such a frame is good all the same.
  const auto harmless = static_cast<std::uint64_t>(
      std::count_if(s.wrong.begin(), s.wrong.end(), [](const std::string& why) {
        return why.find("bit 11 of") != std::string::npos ||
               why.find("bits 11 to") != std::string::npos;
      }));
  EXPECT_LT(harmless, 10U);
  EXPECT_EQ(damaged + after.foreign - before.foreign, kDamaged - harmless);
  EXPECT_EQ(after.lost - before.lost, kDamaged - harmless);
  EXPECT_EQ(s.wrong_sent, 0) << s.wrong[0];
  EXPECT_GT(s.wrong.size(), 10U);
  EXPECT_LE(s.wrong.size() - harmless, damaged);
  EXPECT_EQ(s.replies, s.frames / 2);
}

// CoE: its mailboxes have their heads, so tshark reads them too.
TEST_F(WiresharkTest, MailboxesWithAHeadAreReadAsSuch) {
  const std::string file = folder_ + "/coe.pcap";
  rt::Startup startup;
  ec::SiiBuilder sii;
  sii.identity(1, 2, 3, 4).mailbox(0x1000, 64, 0x1040, 64, 4).strings({"coe"});
  sii.managers({{0x1000, 64, 0x26, 1, 1}, {0x1040, 64, 0x22, 1, 2}});
  auto made = std::make_unique<CoeSlave>();
  made->objects[0x101801] = {1, 2, 3, 4};
  made->objects[0x100800] = {'a', ' ', 'l', 'o', 'n', 'g', ' ', 'n', 'a', 'm', 'e'};
  ec::TwinChain wire;
  wire.add(
      std::make_unique<ec::Esc>(startup.token(), ec::EscConfig{}, sii.image(), std::move(made)));
  ec::TwinPort twin(wire);
  auto port = ec::CapturePort::open(startup.token(), twin, file);
  ASSERT_TRUE(port);
  ec::RegisterAccess r(*port.value());
  const auto info = ec::scan(startup.token(), r).value().at(0);
  const auto m = ec::map_process_data({info}).value().slaves[0];
  ASSERT_TRUE(ec::to_preop(r, info, m, 1s));
  ec::MailboxClient client(*port.value());
  const std::vector<std::uint8_t> four{5, 6, 7, 8};
  ASSERT_TRUE(client.sdo_upload(info, {0x1018, 1}));
  ASSERT_TRUE(client.sdo_upload(info, {0x1008, 0}));
  ASSERT_TRUE(client.sdo_download(info, {0x1018, 1}, four));
  EXPECT_FALSE(client.sdo_upload(info, {0x2000, 0})) << "an abort";
  ASSERT_TRUE(port.value()->close());
  const Seen s = read_back(file);
  EXPECT_TRUE(s.wrong.empty()) << s.wrong[0];
  if (!tshark_is_there()) GTEST_SKIP() << kNoTshark;
  tshark_agrees(file, s);
  const std::string whole = "tshark -r " + file + " ";
  EXPECT_EQ(output_of(whole + kMalformed), "") << "with the dissector of mailboxes";
  EXPECT_NE(output_of(whole + "-Y 'ecat_mailbox.coe'"), "");
}

// In a network of its own: master and chain at the ends of a pair of virtual cards.
int run_over_cards(const std::string& file) {
  if (::unshare(CLONE_NEWNET) != 0 ||
      std::system("ip link add ws0 type veth peer name ws1 2>/dev/null && ip link set ws0 up && "
                  "ip link set ws1 up") != 0)
    return 2;
  rt::Startup startup;
  auto mine = ec::RawPort::open(startup.token(), "ws0"),
       far = ec::RawPort::open(startup.token(), "ws1");
  if (!mine || !far) return 2;
  auto port = ec::CapturePort::open(startup.token(), *mine.value(), file);
  if (!port) return 3;
  yb::YoubotChain chain(startup.token(), {});
  std::atomic<bool> over{false};
  std::thread slaves([&] {
    std::array<std::uint8_t, ec::kMaxFrame> frame{};
    while (!over.load()) {
      const std::size_t n = far.value()->receive(frame, far.value()->now() + 10ms);
      if (n == 0) continue;
      chain.wire().pass(std::span(frame).first(n), far.value()->now());
      (void)far.value()->send(std::span(frame).first(n));
    }
  });
  ec::MasterConfig config;
  config.reply_timeout = 200ms;  // of a machine that has other work
  config.watchdog_ms = 2000;
  ec::Master master(startup.token(), *port.value(), config);
  master.registers().set_timeout(200ms);
  bool good = master.find(startup.token()) && master.configure(startup.token()) &&
              master.start(startup.token());
  for (int i = 0; good && i < 300; ++i) {
    if (i == 100)
      (void)master.post(1, drivers::tmcl::encode(drivers::tmcl::Request{0, 6, 4, 0, 0}));
    good = master.exchange().status == ec::CycleStatus::kOk;
  }
  over.store(true);
  slaves.join();
  return good && port.value()->close() ? 0 : 4;
}

TEST_F(WiresharkTest, FramesBetweenTwoCardsAreWhole) {
  const std::string file = folder_ + "/cards.pcap";
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) ::_exit(run_over_cards(file));
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 2) GTEST_SKIP() << "no network of its own here";
  ASSERT_EQ(WEXITSTATUS(status), 0);
  const Seen s = read_back(file);
  EXPECT_TRUE(s.wrong.empty()) << s.wrong[0];
  EXPECT_EQ(s.replies, s.frames / 2);
  counters_are(s, std::vector<int>(300, 3 * kDrives));
  if (!tshark_is_there()) GTEST_SKIP() << kNoTshark;
  tshark_agrees(file, s);
}

// The check can fail: a frame whose EtherCAT type is not 1, and one that is cut.
TEST_F(WiresharkTest, ADamagedFrameIsFound) {
  if (output_of("tshark --version").empty())
    GTEST_SKIP() << "tshark is not installed (Debian package tshark)";
  const std::string file = folder_ + "/bad.pcap";
  rt::Startup startup;
  ec::TwinChain wire;
  ec::TwinPort twin(wire);
  auto port = ec::CapturePort::open(startup.token(), twin, file);
  ASSERT_TRUE(port);
  ec::FrameWriter w;
  ASSERT_TRUE(w.add(ec::Command::kLrd, 1, 0, 100));
  ASSERT_TRUE(port.value()->send(w.finish().first(60)));
  ASSERT_TRUE(port.value()->close());
  EXPECT_NE(output_of("tshark -r " + file + " --disable-protocol ecat_mailbox " + kMalformed), "");
  EXPECT_EQ(read_back(file).wrong.size(), 1U);
}

// Each thing that tshark does not see, by hand.
TEST_F(WiresharkTest, TheOwnReaderSeesReservedBits) {
  ec::FrameWriter w;
  ASSERT_TRUE(w.add(ec::Command::kBrd, 1, ec::broadcast_address(0x0130), 2));
  ASSERT_TRUE(w.add(ec::Command::kLrd, 1, 0, 20));
  const std::vector<std::uint8_t> good(w.finish().begin(), w.finish().end());
  const auto why = [&](std::size_t at, unsigned bits, bool back = false) {
    auto f = good;
    f[at] ^= static_cast<std::uint8_t>(bits);
    Seen s;
    return look_at_frame(f, back, s);
  };
  EXPECT_EQ(why(0, 0), "");
  EXPECT_EQ(why(15, 0x08), "bit 11 of the EtherCAT head");
  for (const unsigned bit : {0x08U, 0x10U, 0x20U}) {
    EXPECT_EQ(why(23, bit), "bits 11 to 13 of a length");
    EXPECT_EQ(why(37, bit), "bits 11 to 13 of a length");
  }
  EXPECT_EQ(why(23, 0x40), "a circulating frame");
  EXPECT_EQ(why(23, 0x80), "bytes behind the last datagram");
  EXPECT_EQ(why(37, 0x80), "a datagram is cut");
  EXPECT_EQ(why(16, 0x08), "unknown command 15");
  EXPECT_EQ(why(28, 0x01), "a counter before the first slave");
  EXPECT_EQ(why(24, 0x01), "an event before the first slave");
  EXPECT_EQ(why(28, 0x01, true), "not every slave that was passed answers a broadcast");
}

}  // namespace
}  // namespace tests
