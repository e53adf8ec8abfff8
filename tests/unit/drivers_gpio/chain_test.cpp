// The safety chain on simulated lines: what opens at once, what closes late, what ends the
// heartbeat. The oracle of the contacts looks at the whole history of edges.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "drivers/gpio/safety_chain.hpp"
#include "drivers/gpio/twin/gpio_twin.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::Lamp;
using drivers::SafetyInputs;
using drivers::SafetyOutputs;
using drivers::gpio::GpioConfig;
using drivers::gpio::GpioTwin;
using drivers::gpio::SafetyChain;

GpioConfig all_lines() {
  GpioConfig c;
  c.kind = "twin";
  c.estop_line = 4;
  c.estop_line_2 = 5;
  c.enable_line = 6;
  c.heartbeat_line = 12;
  c.lamp_line = 13;
  return c;
}

struct Rig {
  explicit Rig(const GpioConfig& c = all_lines())
      : twin(startup.token(), c.lines()), chain(startup.token(), c, twin) {}
  const SafetyInputs& job(bool alive = true, Lamp lamp = Lamp::kOff) {
    now += 1ms;
    chain.sense(now, in);
    chain.act(now, {alive, lamp});
    return in;
  }
  void run(int jobs) {
    for (int i = 0; i < jobs; ++i) job();
  }
  rt::Startup startup;
  rt::Time now = rt::time_from_ns(5'000'000'000);
  GpioTwin twin;
  SafetyChain chain;
  SafetyInputs in;
};

TEST(SafetyChain, HealthyFromTheFirstJob) {
  Rig r;
  const SafetyInputs& in = r.job();
  EXPECT_TRUE(in.fitted && in.readable && in.enable_fitted && in.enable_held);
  EXPECT_FALSE(in.estop_open || in.estop_disagrees || in.edges_lost || in.outputs_failed);
}

TEST(SafetyChain, OpenAtTheStartIsOpen) {
  Rig r;
  r.twin.press(r.now);
  EXPECT_TRUE(r.job().estop_open);
}

// Shorter than a job: the level is closed again when it is read, the edges tell.
TEST(SafetyChain, AShortPressCounts) {
  Rig r;
  r.run(10);
  r.twin.press(r.now + 300us);
  r.twin.release(r.now + 400us);
  const rt::Time released = r.now + 400us;
  EXPECT_TRUE(r.job().estop_open);
  EXPECT_EQ(r.in.estop_opened, released - 100us) << "the edge's own time";
  int open = 1;
  while (r.job().estop_open && open < 100) ++open;
  EXPECT_GE(r.now - released, 20ms);
  EXPECT_LE(r.now - released, 22ms);
}

TEST(SafetyChain, WithoutEdgesTheLevelTells) {
  Rig r;
  r.run(10);
  r.twin.lose_edges(true);
  r.twin.press(r.now + 100us);
  EXPECT_TRUE(r.job().estop_open);
  r.twin.release(r.now + 100us);
  r.run(10);
  EXPECT_TRUE(r.in.estop_open);
  r.run(15);
  EXPECT_FALSE(r.in.estop_open);
}

TEST(SafetyChain, ABrokenWireIsOpenUntilMended) {
  Rig r;
  r.run(10);
  r.twin.break_wire(r.now);
  EXPECT_TRUE(r.job().estop_open);
  r.twin.release(r.now);
  r.run(200);
  EXPECT_TRUE(r.in.estop_open) << "a release does not mend it";
  r.twin.mend_wire(r.now);
  r.run(30);
  EXPECT_FALSE(r.in.estop_open);
}

TEST(SafetyChain, ContactsThatDisagree) {
  Rig r;
  r.run(10);
  r.twin.weld_second(true);
  r.twin.press(r.now);
  r.run(45);
  EXPECT_TRUE(r.in.estop_open) << "one contact is enough";
  EXPECT_FALSE(r.in.estop_disagrees) << "not yet";
  r.run(10);
  EXPECT_TRUE(r.in.estop_disagrees);
}

TEST(SafetyChain, NotReadableIsOpenAndLetGo) {
  Rig r;
  r.run(10);
  r.twin.unreadable(true);
  r.job();
  EXPECT_TRUE(r.in.estop_open);
  EXPECT_FALSE(r.in.readable || r.in.enable_held || r.in.estop_disagrees);
  r.twin.unreadable(false);
  r.job();
  EXPECT_TRUE(r.in.readable && r.in.estop_open) << "only after the quiet time";
  r.run(25);
  EXPECT_FALSE(r.in.estop_open);
}

TEST(SafetyChain, TooManyEdgesAreToldAndTheLevelIsTrue) {
  Rig r;
  r.run(10);
  r.twin.bounce(r.now + 10us, 120, 1us);  // the last one closes
  r.job();
  EXPECT_TRUE(r.in.estop_open);
  int lost = r.in.edges_lost ? 1 : 0;
  for (int i = 0; i < 40; ++i) lost += r.job().edges_lost ? 1 : 0;
  EXPECT_GE(lost, 1);
  EXPECT_FALSE(r.in.estop_open);
}

// Random presses, releases and bounces. At a job's instant the contact is closed exactly when it is
// closed now, no edge to open lies since the last job, and the last edge of all is at least the
// quiet time ago. The first job that sees a level may count its quiet time from itself.
TEST(SafetyChain, AnswersAsTheWholeHistorySays) {
  GpioConfig c = all_lines();
  c.estop_line_2 = c.enable_line = -1;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Rig r(c);
    rt::Random random(seed, 3);
    struct Edge {
      rt::Time at;
      bool closed;
    };
    std::vector<Edge> history;
    r.run(5);
    rt::Time next = r.now + 100us;
    bool closed = true;
    for (int job = 0; job < 3000; ++job) {
      while (next < r.now + 1ms) {
        closed = !closed;
        if (closed)
          r.twin.release(next);
        else
          r.twin.press(next);
        history.push_back({next, closed});
        const bool bounces = random.uniform() < 0.7;
        next += rt::Nanos{bounces ? random.integer(20'000, 3'000'000)
                                  : random.integer(5'000'000, 60'000'000)};
      }
      const rt::Time before = r.now;
      r.job();
      const bool level = history.empty() || [&] {
        bool l = true;
        for (const Edge& e : history) l = e.at <= r.now ? e.closed : l;
        return l;
      }();
      bool opened = false;
      rt::Time last = rt::time_from_ns(0);
      for (const Edge& e : history) {
        if (e.at > r.now) continue;
        opened = opened || (e.at > before && !e.closed);
        last = std::max(last, e.at);
      }
      const bool quiet = r.now - last >= 20ms;
      if (!level || opened || !quiet) {
        ASSERT_TRUE(r.in.estop_open) << "seed " << seed << " job " << job;
      }
      if (level && r.now - last >= 21ms) {
        ASSERT_FALSE(r.in.estop_open) << "seed " << seed << " job " << job;
      }
    }
    ASSERT_GT(history.size(), 50U);
  }
}

TEST(SafetyChain, HeartbeatIsASquareWaveAndHoldsTheRelay) {
  Rig r;
  r.run(1000);
  EXPECT_NEAR(static_cast<double>(r.twin.beats()), 500, 1) << "an edge every 2 ms";
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
  for (int i = 0; i < 7; ++i) r.job(false);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms)) << "not alive";
  r.job();
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
  r.chain.make_safe();
  r.run(7);
  EXPECT_FALSE(r.twin.relay_closed(r.now, 6ms)) << "made safe";
  r.chain.allow_again();
  r.run(2);
  EXPECT_TRUE(r.twin.relay_closed(r.now, 6ms));
  const rt::Time last = r.now;  // the owner hangs: no job, no edge
  EXPECT_FALSE(r.twin.relay_closed(last + 7ms, 6ms));
}

TEST(SafetyChain, JobsThatStartUnevenlyKeepTheWave) {
  Rig r;
  rt::Random random(11);
  const rt::Time begin = r.now;
  for (int i = 0; i < 1000; ++i) {
    r.now = begin + i * 1ms + rt::Nanos{random.integer(0, 200'000)};
    r.chain.act(r.now, {true, Lamp::kOff});
  }
  EXPECT_NEAR(static_cast<double>(r.twin.beats()), 500, 2);
}

TEST(SafetyChain, LampShowsWhatItIsTold) {
  for (const auto& [lamp, changes] : {std::pair{Lamp::kOff, 0}, {Lamp::kSlow, 8}, {Lamp::kFast, 32},
                                      {Lamp::kOn, 1}}) {
    Rig r;
    int seen = 0;
    bool last = false;
    for (int i = 0; i < 4000; ++i) {
      r.job(true, lamp);
      const bool on = r.twin.output(1);
      seen += on != last ? 1 : 0;
      last = on;
    }
    EXPECT_NEAR(seen, changes, 1);
  }
}

TEST(SafetyChain, OutputsThatDoNotTakeAreToldInTheNextJob) {
  Rig r;
  r.run(3);
  r.twin.unwritable(true);
  r.run(2);
  EXPECT_TRUE(r.in.outputs_failed || r.job().outputs_failed);
  r.twin.unwritable(false);
  r.run(3);
  EXPECT_FALSE(r.in.outputs_failed);
}

TEST(SafetyChain, AllocatesNothing) {
  Rig r;
  r.run(10);
  rt_guard::reset();
  {
    rt::Section section;
    for (int i = 0; i < 500; ++i) {
      if (i % 50 == 0) r.twin.press(r.now + 200us);
      if (i % 50 == 7) r.twin.release(r.now + 200us);
      r.job(true, Lamp::kFast);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

TEST(SafetyIo, AByteKeepsAllThatAJobReads) {
  for (int b = 0; b < 256; ++b) {
    const auto byte = static_cast<std::uint8_t>(b);
    EXPECT_EQ(drivers::to_byte(drivers::safety_inputs_of(byte)), byte);
  }
  SafetyInputs in;
  in.fitted = in.enable_held = true;
  EXPECT_TRUE(drivers::safety_inputs_of(drivers::to_byte(in)).enable_held);
  EXPECT_FALSE(drivers::safety_inputs_of(drivers::to_byte(in)).estop_open);
}

TEST(GpioConfig, ALineHasOneUse) {
  GpioConfig c = all_lines();
  EXPECT_EQ(c.lines().inputs, (std::vector<int>{4, 5, 6}));
  EXPECT_EQ(c.lines().outputs, (std::vector<int>{12, 13}));
  c.lamp_line = 4;
  EXPECT_THROW((void)c.lines(), std::invalid_argument);
  c = all_lines();
  c.estop_line = -1;
  EXPECT_THROW((void)c.lines(), std::invalid_argument);
}

TEST(GpioTwin, FollowsItsScript) {
  Rig r;
  std::vector<drivers::gpio::TwinEvent> script(2);
  script[0].at_s = 0.1;
  script[0].what = "release";
  script[1].at_s = 0.05;
  script[1].what = "press";
  r.twin.follow(r.startup.token(), script, r.now);
  r.run(50);
  EXPECT_TRUE(r.in.estop_open);
  r.run(50);
  EXPECT_TRUE(r.in.estop_open);
  r.run(25);
  EXPECT_FALSE(r.in.estop_open);
}

}  // namespace
