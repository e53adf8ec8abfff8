// The lines of a chip through libgpiod 1.6, against a stand-in for the library: the functions here
// go before those of the shared library. (A chip of the kernel's own: tests/vm.)
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gpiod.h>
#include <gtest/gtest.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <deque>
#include <map>
#include <string>

#include "drivers/gpio/chip_lines.hpp"
#include "rt/clock/box_time.hpp"

#ifdef GPIOD_LINE_BULK_MAX_LINES

struct gpiod_line {
  unsigned offset = 0;
  int fd = -1, flags = 0, value = 0;
  bool output = false;
  std::deque<gpiod_line_event> events;
};
struct gpiod_chip {
  std::map<unsigned, gpiod_line> lines;
};

namespace {

struct Kernel {
  gpiod_chip chip;
  bool unreadable = false;
  int busy_offset = -1;
  std::string opened;
};
Kernel* kernel = nullptr;

}  // namespace

extern "C" {
gpiod_chip* gpiod_chip_open(const char* path) {
  kernel->opened = path;
  if (std::string(path) != "/dev/gpiochip7") {
    errno = ENOENT;
    return nullptr;
  }
  return &kernel->chip;
}
void gpiod_chip_close(gpiod_chip* chip) {
  for (auto& [offset, line] : chip->lines)
    if (line.fd >= 0) close(line.fd);
  chip->lines.clear();
}
gpiod_line* gpiod_chip_get_line(gpiod_chip* chip, unsigned offset) {
  if (offset > 31) {
    errno = EINVAL;
    return nullptr;
  }
  gpiod_line& line = chip->lines[offset];
  line.offset = offset;
  return &line;
}
int gpiod_line_request_both_edges_events_flags(gpiod_line* line, const char*, int flags) {
  if (static_cast<int>(line->offset) == kernel->busy_offset) {
    errno = EBUSY;
    return -1;
  }
  line->flags = flags;
  line->fd = eventfd(0, 0);
  return 0;
}
int gpiod_line_request_output(gpiod_line* line, const char*, int value) {
  line->output = true;
  line->value = value;
  return 0;
}
int gpiod_line_event_get_fd(gpiod_line* line) { return line->fd; }
int gpiod_line_event_read_fd_multiple(int fd, gpiod_line_event* out, unsigned n) {
  if ((fcntl(fd, F_GETFL) & O_NONBLOCK) == 0) ADD_FAILURE() << "a read that may wait";
  for (auto& [offset, line] : kernel->chip.lines) {
    if (line.fd != fd) continue;
    unsigned k = 0;
    for (; k < n && !line.events.empty(); ++k, line.events.pop_front())
      out[k] = line.events.front();
    if (k > 0) return static_cast<int>(k);
  }
  errno = EAGAIN;
  return -1;
}
int gpiod_line_get_value(gpiod_line* line) { return kernel->unreadable ? -1 : line->value; }
int gpiod_line_set_value(gpiod_line* line, int value) {
  if (!line->output) return -1;
  line->value = value;
  return 0;
}
}

namespace {

using namespace std::chrono_literals;
using drivers::gpio::GpioConfig;
using drivers::gpio::LineEdge;

GpioConfig lines() {
  GpioConfig c;
  c.kind = "chip";
  c.chip = "gpiochip7";
  c.estop_line = 3;
  c.enable_line = 9;
  c.heartbeat_line = 20;
  c.bias = "pull-up";
  return c;
}

struct ChipV1 : testing::Test {
  void SetUp() override { kernel = &fake; }
  void edge(unsigned offset, bool active, std::int64_t ns) {
    gpiod_line_event e{};
    e.event_type = active ? GPIOD_LINE_EVENT_RISING_EDGE : GPIOD_LINE_EVENT_FALLING_EDGE;
    e.ts.tv_sec = ns / 1'000'000'000;
    e.ts.tv_nsec = ns % 1'000'000'000;
    fake.chip.lines[offset].events.push_back(e);
  }
  Kernel fake;
  rt::Startup startup;
};

TEST_F(ChipV1, OpensAsTheSceneSays) {
  const auto chip = open_chip_lines(startup.token(), lines());
  EXPECT_EQ(fake.opened, "/dev/gpiochip7");
  EXPECT_EQ(fake.chip.lines[3].flags,
            GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW | GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP);
  EXPECT_TRUE(fake.chip.lines[20].output);
  EXPECT_STREQ(drivers::gpio::libgpiod_version(), "1.6");
}

TEST_F(ChipV1, EdgesLevelsAndOutputs) {
  const auto chip = open_chip_lines(startup.token(), lines());
  const rt::Time now = rt::time_from_ns(77'000'000'000'000);  // of another clock
  fake.chip.lines[9].value = 1;
  std::uint32_t active = 0;
  ASSERT_TRUE(chip->levels(now, active));
  EXPECT_EQ(active, 2U) << "the second input";
  edge(3, false, rt::monotonic_ns() - 3'000'000);
  edge(3, true, rt::monotonic_ns() - 1'000'000);
  std::array<LineEdge, 8> out{};
  const auto d = chip->drain(now, out);
  ASSERT_EQ(d.count, 2);
  EXPECT_FALSE(d.lost);
  EXPECT_EQ(out[0].input, 0);
  EXPECT_FALSE(out[0].active);
  EXPECT_TRUE(out[1].active);
  EXPECT_LE(out[0].at, now - 3ms);
  EXPECT_LT(out[0].at, out[1].at);
  EXPECT_LE(out[1].at, now - 1ms);
  EXPECT_EQ(chip->drain(now, out).count, 0);
  EXPECT_TRUE(chip->set(now, 0, true));
  EXPECT_EQ(fake.chip.lines[20].value, 1);
  EXPECT_FALSE(chip->set(now, 1, true)) << "there is one output";
  fake.unreadable = true;
  EXPECT_FALSE(chip->levels(now, active));
}

// Kernels before 5.7 stamp by the wall clock.
TEST_F(ChipV1, AWallClockStampIsRead) {
  const auto chip = open_chip_lines(startup.token(), lines());
  timespec wall{};
  clock_gettime(CLOCK_REALTIME, &wall);
  const std::int64_t wall_ns = wall.tv_sec * 1'000'000'000LL + wall.tv_nsec;
  ASSERT_GT(wall_ns - rt::monotonic_ns(), 2'000'000'000);
  edge(3, false, wall_ns - 5'000'000);
  std::array<LineEdge, 8> out{};
  const rt::Time now = rt::time_from_ns(1'000'000'000'000);
  ASSERT_EQ(chip->drain(now, out).count, 1);
  EXPECT_LE(out[0].at, now - 5ms);
  EXPECT_GT(out[0].at, now - 60s);
}

TEST_F(ChipV1, AFullQueueIsTold) {
  const auto chip = open_chip_lines(startup.token(), lines());
  for (int i = 0; i < 16; ++i) edge(3, i % 2 != 0, rt::monotonic_ns());
  std::array<LineEdge, 64> out{};
  const auto d = chip->drain(rt::time_from_ns(1), out);
  EXPECT_EQ(d.count, 16);
  EXPECT_TRUE(d.lost);
}

TEST_F(ChipV1, WhatIsMissingIsSaidInOneLine) {
  const auto problem = [&](const GpioConfig& c) -> std::string {
    try {
      (void)open_chip_lines(startup.token(), c);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  GpioConfig c = lines();
  c.chip = "/dev/gpiochip1";
  EXPECT_THAT(problem(c), testing::HasSubstr("ls /dev/gpiochip*"));
  c = lines();
  c.enable_line = 40;
  EXPECT_THAT(problem(c), testing::HasSubstr("line 40"));
  fake.busy_offset = 9;
  EXPECT_THAT(problem(lines()), testing::HasSubstr("gpioinfo"));
}

}  // namespace

#endif
