#include "drivers/mouse/mouse_device.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <filesystem>
#include <limits>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using drivers::MouseConfig;
using drivers::MouseDevice;
using drivers::MouseMove;
using drivers::MouseParser;
using drivers::StylusSample;
using perception::Vec3;

std::vector<std::uint8_t> packet(const MouseMove& m, bool overflow = false) {
  const int wire_wheel = -m.wheel;
  return {static_cast<std::uint8_t>(0x08 | (m.button ? 1 : 0) | (m.clutch ? 2 : 0) |
                                    (m.right < 0 ? 0x10 : 0) | (m.up < 0 ? 0x20 : 0) |
                                    (overflow ? 0xC0 : 0)),
          static_cast<std::uint8_t>(m.right & 0xFF), static_cast<std::uint8_t>(m.up & 0xFF),
          static_cast<std::uint8_t>(wire_wheel & 0x0F)};
}

// A named pipe in place of /dev/input/mice.
struct Pipe {
  std::string path =
      (std::filesystem::temp_directory_path() / ("teletact_mouse_" + std::to_string(::getpid())))
          .string();
  int fd = -1;
  Pipe() {
    ::unlink(path.c_str());
    EXPECT_EQ(::mkfifo(path.c_str(), 0600), 0);
  }
  ~Pipe() {
    if (fd >= 0) ::close(fd);
    ::unlink(path.c_str());
  }
  void write(const std::vector<std::uint8_t>& bytes) {
    if (fd < 0) fd = ::open(path.c_str(), O_WRONLY | O_NONBLOCK);
    ASSERT_EQ(::write(fd, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
};

struct Rig {
  rt::Startup startup;
  MouseDevice device;
  rt::Time now = rt::time_from_ns(1000000);
  StylusSample s;
  explicit Rig(const MouseConfig& c) : device(startup.token(), c) {}
  void tick() {
    now += std::chrono::milliseconds{1};
    ASSERT_TRUE(device.sense(now, s));
  }
};

TEST(MouseParser, EveryMotionSurvives) {
  MouseParser parser;
  for (int right = -256; right < 256; right += 3) {
    for (int up = -256; up < 256; up += 17) {
      for (int wheel = -7; wheel <= 7; wheel += 7) {
        const MouseMove m{right, up, wheel, (right & 1) != 0, (up & 1) != 0};
        const auto bytes = packet(m);
        for (std::size_t i = 0; i < 3; ++i) ASSERT_FALSE(parser.push(bytes[i]));
        ASSERT_TRUE(parser.push(bytes[3]));
        ASSERT_EQ(parser.move().right, right);
        ASSERT_EQ(parser.move().up, up);
        ASSERT_EQ(parser.move().wheel, wheel);
        ASSERT_EQ(parser.move().button, m.button);
        ASSERT_EQ(parser.move().clutch, m.clutch);
      }
    }
  }
  EXPECT_EQ(parser.skipped(), 0U);
}

TEST(MouseParser, AnyBytesStayInBounds) {
  const std::uint64_t seed = 531;
  rt::Random random(seed);
  MouseParser parser;
  std::uint64_t packets = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    if (!parser.push(static_cast<std::uint8_t>(random.integer(0, 255)))) continue;
    ++packets;
    const MouseMove& m = parser.move();
    ASSERT_LE(std::abs(m.right), 256);
    ASSERT_LE(std::abs(m.up), 256);
    ASSERT_LE(std::abs(m.wheel), 8);
  }
  EXPECT_LT(1'000'000U - 4 * packets - parser.skipped(),
            4U);  // each byte is in a packet or skipped
  EXPECT_GT(packets, 190'000U);
}

TEST(MouseParser, AnOverflowIsNoMotion) {
  MouseParser parser;
  bool done = false;
  for (const auto b : packet({200, -100, 0, true}, true)) done = parser.push(b);
  ASSERT_TRUE(done);
  EXPECT_EQ(parser.move().right, 0);
  EXPECT_EQ(parser.move().up, 0);
  EXPECT_TRUE(parser.move().button);
}

TEST(MouseDevice, MovesInTheFrameOfTheHand) {
  Pipe pipe;
  MouseConfig c;
  c.path = pipe.path;
  Rig rig(c);
  rig.tick();
  EXPECT_EQ(rig.s.p_DH, Vec3::Zero());
  EXPECT_FALSE(rig.s.repeated);
  rig.tick();
  EXPECT_TRUE(rig.s.repeated);
  Pipe& p = pipe;
  p.write(packet({100, 0, 0, false}));
  rig.tick();
  EXPECT_LT((rig.s.p_DH - Vec3(0, -0.005, 0)).norm(), 1e-12);  // to the right
  p.write(packet({0, 200, 0, true}));
  rig.tick();
  EXPECT_LT((rig.s.p_DH - Vec3(0.01, -0.005, 0)).norm(), 1e-12);  // away
  EXPECT_TRUE(rig.s.button);
  p.write(packet({0, 0, -3, false}));
  rig.tick();
  EXPECT_LT((rig.s.p_DH - Vec3(0.01, -0.005, -0.006)).norm(), 1e-12);  // down
  EXPECT_FALSE(rig.s.button);
  EXPECT_EQ(rig.s.state, drivers::DeviceState::kForce);
  // A packet in two halves.
  const auto whole = packet({-100, 0, 0, false});
  p.write({whole[0], whole[1]});
  rig.tick();
  EXPECT_TRUE(rig.s.repeated);
  p.write({whole[2], whole[3]});
  rig.tick();
  EXPECT_LT((rig.s.p_DH - Vec3(0.01, 0, -0.006)).norm(), 1e-12);
}

TEST(MouseDevice, StaysInTheWorkspace) {
  const std::uint64_t seed = 532;
  MouseConfig c;
  c.path.clear();
  Rig rig(c);
  rt::Random random(seed);
  for (int i = 0; i < 5000; ++i) {
    (void)rig.device.push({static_cast<int>(random.integer(-256, 255)),
                           static_cast<int>(random.integer(-256, 255)),
                           static_cast<int>(random.integer(-8, 8)), false});
    rig.tick();
    ASSERT_LE(rig.s.p_DH.norm(), 0.075 * (1 + 1e-12));
  }
}

TEST(MouseDevice, RendersNoForceAndForbidsNoStiffness) {
  MouseConfig c;
  c.path.clear();
  Rig rig(c);
  EXPECT_EQ(rig.device.properties().force_limit_N, 0);
  EXPECT_FALSE(rig.device.properties().renders_force);
  EXPECT_EQ(rig.device.properties().stiffness_limit(1e-3), std::numeric_limits<double>::infinity());
  rig.device.act(rig.now, {Vec3(5, 0, 0)});
  rig.tick();
  EXPECT_EQ(rig.s.p_DH, Vec3::Zero());
}

// A terminal's far end that closes is a source that ends, as an unplugged mouse does.
TEST(MouseDevice, UnpluggedKeepsThePlaceAndLetsTheButtonGo) {
  const int far = ::posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_GE(far, 0);
  ASSERT_EQ(::grantpt(far), 0);
  ASSERT_EQ(::unlockpt(far), 0);
  MouseConfig c;
  c.path = ::ptsname(far);
  {
    const int line = ::open(c.path.c_str(), O_RDWR | O_NOCTTY);
    termios raw{};
    ::tcgetattr(line, &raw);
    ::cfmakeraw(&raw);
    ::tcsetattr(line, TCSANOW, &raw);
    Rig rig(c);
    const auto bytes = packet({10, 0, 0, true});
    ASSERT_EQ(::write(far, bytes.data(), bytes.size()), 4);
    for (int i = 0; i < 200 && !rig.s.button; ++i) {
      rig.tick();
      ::usleep(1000);
    }
    ASSERT_TRUE(rig.s.button);
    const Vec3 place = rig.s.p_DH;
    EXPECT_LT((place - Vec3(0, -0.0005, 0)).norm(), 1e-12);
    ::close(far);
    rig.tick();
    EXPECT_TRUE(rig.device.source_lost());
    EXPECT_FALSE(rig.s.button);
    EXPECT_EQ(rig.s.p_DH, place);
    ::close(line);
  }
}

TEST(MouseDevice, MissingOrWrongSourceIsOneLine) {
  const auto refused = [](const std::string& path) -> std::string {
    rt::Startup startup;
    MouseConfig c;
    c.path = path;
    try {
      const MouseDevice device(startup.token(), c);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "opened";
  };
  EXPECT_EQ(refused("/dev/input/no_such_mouse"),
            "mouse: /dev/input/no_such_mouse: No such file or directory");
  EXPECT_EQ(refused("/tmp"), "mouse: /tmp: is not a mouse");
  const auto file =
      std::filesystem::temp_directory_path() / ("teletact_no_mouse_" + std::to_string(::getpid()));
  std::fclose(std::fopen(file.c_str(), "w"));
  EXPECT_EQ(refused(file), "mouse: " + file.string() + ": is not a mouse");
  std::filesystem::remove(file);
}

TEST(MouseDevice, NothingAllocates) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  MouseConfig c;
  c.path.clear();
  Rig rig(c);
  (void)rig.device.push({1, 1, 0, false});
  rt_guard::reset();
  {
    const rt::Section section;
    (void)rig.device.sense(rig.now, rig.s);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
