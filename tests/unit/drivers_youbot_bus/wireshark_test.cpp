// The frames of a whole bring-up, cycles, TMCL and faults, written as pcap: tshark's EtherCAT
// dissector finds none malformed and reads the numbers that were sent. Skipped where tshark is not
// installed. The mailbox dissector is off: raw TMCL has no mailbox head, and it takes it for one.
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "drivers/ethercat/capture_port.hpp"
#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

namespace fs = std::filesystem;

std::string output_of(const std::string& command) {
  std::string out;
  std::FILE* pipe = ::popen((command + " 2>/dev/null").c_str(), "r");
  if (pipe == nullptr) return out;
  std::array<char, 4096> piece{};
  while (std::fgets(piece.data(), piece.size(), pipe) != nullptr) out += piece.data();
  ::pclose(pipe);
  return out;
}

struct Expected {
  std::uint64_t frames = 0;
  std::map<int, int> commands;  // by code, of every datagram
};

// The same file, by the driver's own reader: what tshark must count.
Expected read_back(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<char> bytes((std::istreambuf_iterator<char>(in)), {});
  Expected e;
  std::vector<std::uint8_t> all(bytes.begin(), bytes.end());
  for (std::size_t at = 24; at + 16 <= all.size();) {
    const std::size_t n = ec::load_u32(all, at + 8);
    ec::FrameView v;
    ec::parse_frame(std::span(all).subspan(at + 16, n), v);
    EXPECT_TRUE(v.good()) << to_text(v.fault);
    for (std::size_t i = 0; i < v.count; ++i) ++e.commands[static_cast<int>(v.datagram[i].command)];
    ++e.frames;
    at += 16 + n;
  }
  return e;
}

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

void run_a_bus(const std::string& file) {
  rt::Startup startup;
  yb::YoubotChain chain(startup.token(), {});
  ec::TwinPort twin(chain.wire());
  auto port = ec::CapturePort::open(startup.token(), twin, file);
  ASSERT_TRUE(port) << port.error();
  ec::Master master(startup.token(), *port.value());
  ASSERT_TRUE(master.find(startup.token()));
  ASSERT_TRUE(master.configure(startup.token()));
  ASSERT_TRUE(master.start(startup.token()));
  for (int i = 0; i < 200; ++i) {
    twin.set_now(twin.now() + 1ms);
    if (i % 20 == 0)
      (void)master.post(1, drivers::tmcl::encode(drivers::tmcl::Request{0, 6, 156, 0, i}));
    if (i == 50) chain.wire().cut_behind(4);
    if (i == 60) chain.wire().cut_behind(11);
    (void)master.exchange();
    (void)master.read_inputs();
    (void)master.write_outputs();
  }
  ASSERT_TRUE(port.value()->close());
}

TEST_F(WiresharkTest, NoFrameIsMalformed) {
  const std::string file = folder_ + "/bus.pcap";
  run_a_bus(file);
  const Expected e = read_back(file);
  EXPECT_GT(e.frames, 5000U);
  if (output_of("tshark --version").empty())
    GTEST_SKIP() << "tshark is not installed (Debian package tshark): frames only read by this "
                    "project's own reader";
  const std::string base = "tshark -r " + file + " --disable-protocol ecat_mailbox ";
  EXPECT_EQ(output_of(base + "-Y '_ws.malformed || (eth.type == 0x88a4 && !ecat)'"), "");
  // Every datagram's command, as tshark reads it.
  std::istringstream lines(
      output_of(base + "-T fields -E occurrence=a -E aggregator=, -e ecat.cmd"));
  std::map<int, int> seen;
  std::uint64_t frames = 0;
  for (std::string line; std::getline(lines, line); ++frames) {
    std::istringstream fields(line);
    for (std::string f; std::getline(fields, f, ',');)
      ++seen[static_cast<int>(std::stoul(f, nullptr, 0))];
  }
  EXPECT_EQ(frames, e.frames);
  EXPECT_EQ(seen, e.commands);
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
  EXPECT_NE(
      output_of("tshark -r " + file +
                " --disable-protocol ecat_mailbox -Y '_ws.malformed || (eth.type == 0x88a4 && "
                "!ecat)'"),
      "");
}

}  // namespace
}  // namespace tests
