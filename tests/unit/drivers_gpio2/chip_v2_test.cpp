// The lines of a chip through libgpiod 2.x, against a stand-in for the library.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gpiod.h>
#include <gtest/gtest.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "drivers/gpio/chip_lines.hpp"
#include "rt/clock/box_time.hpp"

struct gpiod_chip {};
struct gpiod_line_settings {
  gpiod_line_direction direction = GPIOD_LINE_DIRECTION_AS_IS;
  gpiod_line_edge edge = GPIOD_LINE_EDGE_NONE;
  gpiod_line_bias bias = GPIOD_LINE_BIAS_AS_IS;
  gpiod_line_clock clock = GPIOD_LINE_CLOCK_REALTIME;
  bool active_low = false;
};
struct gpiod_line_config {
  std::vector<unsigned> offsets;
  gpiod_line_settings settings;
};
struct gpiod_request_config {
  std::string consumer;
};
struct gpiod_line_request {
  gpiod_line_config lines;
  int fd = -1;
};
struct gpiod_edge_event {
  gpiod_edge_event_type type;
  std::uint64_t ns;
  unsigned offset;
  unsigned long number;
};
struct gpiod_edge_event_buffer {
  std::vector<gpiod_edge_event> events;
};

namespace {

struct Kernel {
  gpiod_chip chip;
  std::vector<gpiod_line_config> requested;
  std::map<unsigned, int> value;
  std::deque<gpiod_edge_event> events;
  int open = 0;  // objects of the library that were not given back
  bool unreadable = false;
};
Kernel* kernel = nullptr;

}  // namespace

extern "C" {
gpiod_chip* gpiod_chip_open(const char* path) {
  if (std::string(path) != "/dev/gpiochip7") {
    errno = EACCES;
    return nullptr;
  }
  ++kernel->open;
  return &kernel->chip;
}
void gpiod_chip_close(gpiod_chip*) { --kernel->open; }
gpiod_line_request* gpiod_chip_request_lines(gpiod_chip*, gpiod_request_config*,
                                             gpiod_line_config* lines) {
  for (const unsigned offset : lines->offsets) {
    if (offset <= 31) continue;
    errno = EINVAL;
    return nullptr;
  }
  kernel->requested.push_back(*lines);
  ++kernel->open;
  return new gpiod_line_request{*lines, eventfd(0, 0)};
}
gpiod_line_settings* gpiod_line_settings_new() {
  ++kernel->open;
  return new gpiod_line_settings;
}
void gpiod_line_settings_free(gpiod_line_settings* s) {
  --kernel->open;
  delete s;
}
int gpiod_line_settings_set_direction(gpiod_line_settings* s, gpiod_line_direction d) {
  s->direction = d;
  return 0;
}
int gpiod_line_settings_set_edge_detection(gpiod_line_settings* s, gpiod_line_edge e) {
  s->edge = e;
  return 0;
}
int gpiod_line_settings_set_bias(gpiod_line_settings* s, gpiod_line_bias b) {
  s->bias = b;
  return 0;
}
void gpiod_line_settings_set_active_low(gpiod_line_settings* s, bool low) { s->active_low = low; }
int gpiod_line_settings_set_event_clock(gpiod_line_settings* s, gpiod_line_clock c) {
  s->clock = c;
  return 0;
}
gpiod_line_config* gpiod_line_config_new() {
  ++kernel->open;
  return new gpiod_line_config;
}
void gpiod_line_config_free(gpiod_line_config* c) {
  --kernel->open;
  delete c;
}
int gpiod_line_config_add_line_settings(gpiod_line_config* c, const unsigned* offsets, size_t n,
                                        gpiod_line_settings* s) {
  c->offsets.assign(offsets, offsets + n);
  c->settings = *s;
  return 0;
}
gpiod_request_config* gpiod_request_config_new() {
  ++kernel->open;
  return new gpiod_request_config;
}
void gpiod_request_config_free(gpiod_request_config* c) {
  --kernel->open;
  delete c;
}
void gpiod_request_config_set_consumer(gpiod_request_config* c, const char* name) {
  c->consumer = name;
}
void gpiod_request_config_set_event_buffer_size(gpiod_request_config*, size_t) {}
void gpiod_line_request_release(gpiod_line_request* r) {
  --kernel->open;
  close(r->fd);
  delete r;
}
int gpiod_line_request_get_values_subset(gpiod_line_request*, size_t n, const unsigned* offsets,
                                         gpiod_line_value* values) {
  if (kernel->unreadable) return -1;
  for (size_t i = 0; i < n; ++i)
    values[i] =
        kernel->value[offsets[i]] != 0 ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
  return 0;
}
int gpiod_line_request_set_value(gpiod_line_request*, unsigned offset, gpiod_line_value value) {
  kernel->value[offset] = value == GPIOD_LINE_VALUE_ACTIVE ? 1 : 0;
  return 0;
}
int gpiod_line_request_get_fd(gpiod_line_request* r) { return r->fd; }
int gpiod_line_request_read_edge_events(gpiod_line_request* r, gpiod_edge_event_buffer* b,
                                        size_t most) {
  if ((fcntl(r->fd, F_GETFL) & O_NONBLOCK) == 0) ADD_FAILURE() << "a read that may wait";
  b->events.clear();
  for (; b->events.size() < most && !kernel->events.empty(); kernel->events.pop_front())
    b->events.push_back(kernel->events.front());
  if (!b->events.empty()) return static_cast<int>(b->events.size());
  errno = EAGAIN;
  return -1;
}
gpiod_edge_event_buffer* gpiod_edge_event_buffer_new(size_t) {
  ++kernel->open;
  return new gpiod_edge_event_buffer;
}
void gpiod_edge_event_buffer_free(gpiod_edge_event_buffer* b) {
  --kernel->open;
  delete b;
}
gpiod_edge_event* gpiod_edge_event_buffer_get_event(gpiod_edge_event_buffer* b, unsigned long i) {
  return &b->events[i];
}
gpiod_edge_event_type gpiod_edge_event_get_event_type(gpiod_edge_event* e) { return e->type; }
uint64_t gpiod_edge_event_get_timestamp_ns(gpiod_edge_event* e) { return e->ns; }
unsigned gpiod_edge_event_get_line_offset(gpiod_edge_event* e) { return e->offset; }
unsigned long gpiod_edge_event_get_global_seqno(gpiod_edge_event* e) { return e->number; }
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
  c.bias = "pull-down";
  return c;
}

struct ChipV2 : testing::Test {
  void SetUp() override { kernel = &fake; }
  void edge(unsigned offset, bool active, unsigned long number, std::int64_t age_ns) {
    fake.events.push_back({active ? GPIOD_EDGE_EVENT_RISING_EDGE : GPIOD_EDGE_EVENT_FALLING_EDGE,
                           static_cast<std::uint64_t>(rt::monotonic_ns() - age_ns), offset,
                           number});
  }
  Kernel fake;
  rt::Startup startup;
};

TEST_F(ChipV2, OpensAsTheSceneSaysAndGivesAllBack) {
  {
    const auto chip = open_chip_lines(startup.token(), lines());
    EXPECT_STREQ(drivers::gpio::libgpiod_version(), "2");
    ASSERT_EQ(fake.requested.size(), 2U);
    const auto& in = fake.requested[0];
    EXPECT_EQ(in.offsets, (std::vector<unsigned>{3, 9}));
    EXPECT_EQ(in.settings.direction, GPIOD_LINE_DIRECTION_INPUT);
    EXPECT_EQ(in.settings.edge, GPIOD_LINE_EDGE_BOTH);
    EXPECT_EQ(in.settings.bias, GPIOD_LINE_BIAS_PULL_DOWN);
    EXPECT_EQ(in.settings.clock, GPIOD_LINE_CLOCK_MONOTONIC);
    EXPECT_TRUE(in.settings.active_low);
    EXPECT_EQ(fake.requested[1].offsets, (std::vector<unsigned>{20}));
    EXPECT_EQ(fake.requested[1].settings.direction, GPIOD_LINE_DIRECTION_OUTPUT);
    EXPECT_FALSE(fake.requested[1].settings.active_low);
  }
  EXPECT_EQ(fake.open, 0);
}

TEST_F(ChipV2, EdgesLevelsAndOutputs) {
  const auto chip = open_chip_lines(startup.token(), lines());
  const rt::Time now = rt::time_from_ns(77'000'000'000'000);
  fake.value[3] = 1;
  std::uint32_t active = 0;
  ASSERT_TRUE(chip->levels(now, active));
  EXPECT_EQ(active, 1U);
  edge(9, false, 1, 3'000'000);
  edge(3, true, 2, 1'000'000);
  std::array<LineEdge, 8> out{};
  auto d = chip->drain(now, out);
  ASSERT_EQ(d.count, 2);
  EXPECT_FALSE(d.lost);
  EXPECT_EQ(out[0].input, 1);
  EXPECT_FALSE(out[0].active);
  EXPECT_LE(out[0].at, now - 3ms);
  EXPECT_LT(out[0].at, out[1].at);
  edge(3, false, 5, 0);
  d = chip->drain(now, out);
  EXPECT_EQ(d.count, 1);
  EXPECT_TRUE(d.lost) << "numbers 3 and 4 never came";
  EXPECT_EQ(chip->drain(now, out).count, 0);
  EXPECT_TRUE(chip->set(now, 0, true));
  EXPECT_EQ(fake.value[20], 1);
  EXPECT_FALSE(chip->set(now, 1, true));
  fake.unreadable = true;
  EXPECT_FALSE(chip->levels(now, active));
}

TEST_F(ChipV2, WhatIsMissingIsSaidInOneLineAndNothingStaysOpen) {
  GpioConfig c = lines();
  c.chip = "gpiochip0";
  try {
    (void)open_chip_lines(startup.token(), c);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("udev"));
  }
  c = lines();
  c.heartbeat_line = 99;
  EXPECT_THROW((void)open_chip_lines(startup.token(), c), std::runtime_error);
  EXPECT_EQ(fake.open, 0);
}

}  // namespace
