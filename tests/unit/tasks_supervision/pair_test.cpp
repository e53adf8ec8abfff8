// Both boxes' supervision over a late line of which one way, or both, falls silent at random: as
// TCP has it, what a silence holds up comes behind it, in order. The operator holds the engage.
// Nothing here knows how a pause is agreed on; judged is what a person would see.
#include <algorithm>
#include <cstdio>
#include <deque>

#include "rt/random.hpp"
#include "tests/unit/tasks_supervision/story.hpp"

namespace tests {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTick{10}, kLiveness{180};

template <class M>
class Way {
 public:
  explicit Way(milliseconds delay) : delay_(delay) {}
  void silence(milliseconds from, milliseconds to) { from_ = from, to_ = to; }
  void send(milliseconds now, const M& m) {
    milliseconds at = now + delay_;
    if (at >= from_ && at < to_) at = to_;
    waiting_.push_back({at, m});
  }
  // The newest of what has arrived; null: nothing new.
  const M* take(milliseconds now) {
    bool any = false;
    while (!waiting_.empty() && waiting_.front().first <= now) {
      newest_ = waiting_.front().second;
      waiting_.pop_front();
      any = true;
    }
    return any ? &newest_ : nullptr;
  }

 private:
  milliseconds delay_, from_{0}, to_{0};
  std::deque<std::pair<milliseconds, M>> waiting_;
  M newest_{};
};

struct Goal {
  Engage engage = Engage::kNo;
};
struct State {
  Mode mode = Mode::kInit;
  Pause pause = Pause::kNone;
  rt::Time taken{};
};

struct Pair {
  Story op{Box::kOperator}, robot{Box::kRobot};
  Way<Goal> goals;
  Way<State> states;
  milliseconds now{0}, robot_heard{-1000}, op_heard{-1000};
  bool engage = false;
  int robot_deaf_ms = 0;  // longest that the robot was engaged without hearing anything

  explicit Pair(milliseconds delay) : goals(delay), states(delay) {
    for (Story* s : {&op, &robot}) {
      s->peer_follows = s->link_up = false;
      s->in.requests.engage = Engage::kNo;
    }
  }
  static void hear(Story& s, milliseconds ago) {
    s.in.link_heard = true;
    s.in.link_last = s.tick.start + kTick - ago;
  }
  void tick() {
    now += kTick;
    if (const Goal* g = goals.take(now)) {
      robot.in.requests.engage = g->engage;
      robot_heard = now;
    }
    if (const State* s = states.take(now)) {
      op.in.peer_mode = s->mode;
      op.in.peer_pause = s->pause;
      op.in.peer_mode_at = s->taken;
      op_heard = now;
    }
    op.in.requests.engage = engage ? Engage::kYes : Engage::kNo;
    if (robot_heard.count() >= 0) hear(robot, now - robot_heard);
    if (op_heard.count() >= 0) hear(op, now - op_heard);
    robot.run(kTick);
    op.run(kTick);
    if (robot.mode() == Mode::kEngaged)
      robot_deaf_ms = std::max(robot_deaf_ms, static_cast<int>((now - robot_heard).count()));
    const Pause pause = !robot.out.mode.resumes         ? Pause::kNone
                        : now - robot_heard > kLiveness ? Pause::kSilent
                                                        : Pause::kHears;
    states.send(now, {robot.mode(), pause, robot.tick.start});
    if (now.count() % 50 == 0)
      goals.send(now, {op.mode() == Mode::kEngaged ? Engage::kYes
                       : op.out.mode.resumes       ? Engage::kPaused
                                                   : Engage::kNo});
  }
  void run(milliseconds time) {
    for (const milliseconds end = now + time; now < end;) tick();
  }
  [[nodiscard]] bool both_engaged() const {
    return op.mode() == Mode::kEngaged && robot.mode() == Mode::kEngaged;
  }
};

struct Draw {
  milliseconds delay{}, silence{};
  bool to_robot = false, to_operator = false;
};
milliseconds drawn(rt::Random& random, double least, double most) {
  return kTick * static_cast<int>(random.uniform(least, most) / 10);
}

Pair engaged_pair(const Draw& d, rt::Random& random) {
  Pair p(d.delay);
  p.run(milliseconds{600});
  p.engage = true;
  p.run(milliseconds{1500} + drawn(random, 0, 200));
  EXPECT_TRUE(p.both_engaged()) << "delay " << d.delay.count() << " ms";
  const milliseconds from = p.now + kTick;
  if (d.to_robot) p.goals.silence(from, from + d.silence);
  if (d.to_operator) p.states.silence(from, from + d.silence);
  return p;
}

Draw draw(rt::Random& random, double least_ms, double most_ms) {
  Draw d{drawn(random, 0, 110), drawn(random, least_ms, most_ms), true, true};
  const double which = random.uniform(0, 3);
  d.to_robot = which < 2;
  d.to_operator = which >= 1;
  return d;
}

// Lost segments, or a stall of a radio.
TEST(SupervisionPair, AShortSilenceOfAnyWayEndsNothingForGood) {
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    rt::Random random(seed, 0);
    const Draw d = draw(random, 20, 800);
    Pair p = engaged_pair(d, random);
    p.run(d.silence + milliseconds{2000});
    EXPECT_TRUE(p.both_engaged()) << "seed " << seed << ": delay " << d.delay.count()
                                  << " ms, silence " << d.silence.count() << " ms, to robot "
                                  << d.to_robot << ", to operator " << d.to_operator << ", causes "
                                  << p.op.out.mode.cause << ", " << p.robot.out.mode.cause;
    EXPECT_LE(p.robot_deaf_ms, 190) << "seed " << seed;
    p.run(milliseconds{3000});
    EXPECT_TRUE(p.both_engaged()) << "seed " << seed << ": it stays so";
  }
}

// The act itself may fall into such a silence, or the answer to it. Where the operator's box takes
// it, it is given once and held; where that box hears nothing, it refuses it at once.
TEST(SupervisionPair, AnActThatFallsIntoASilenceIsFollowedOrRefused) {
  int refused = 0;
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    rt::Random random(seed, 2);
    const Draw d = draw(random, 20, 800);
    Pair p(d.delay);
    p.run(milliseconds{600});
    const milliseconds from = p.now + drawn(random, 0, 800);
    if (d.to_robot) p.goals.silence(from, from + d.silence);
    if (d.to_operator) p.states.silence(from, from + d.silence);
    p.run(milliseconds{300});
    p.engage = true;
    p.tick();
    const bool taken = !p.op.out.engage_refused;
    refused += taken ? 0 : 1;
    p.run(milliseconds{500} + d.silence + milliseconds{2500});
    EXPECT_EQ(p.both_engaged(), taken)
        << "seed " << seed << ": delay " << d.delay.count() << " ms, silence " << d.silence.count()
        << " ms from " << from.count() - 900 << " ms behind the act on, to robot " << d.to_robot
        << ", to operator " << d.to_operator << ", causes " << p.op.out.mode.cause << ", "
        << p.robot.out.mode.cause;
    EXPECT_LE(p.robot_deaf_ms, 190) << "seed " << seed;
  }
  EXPECT_LE(refused, 60);
  EXPECT_GE(refused, 10) << "and some fall into it";
}

// Longer than it survives: no wheel turns and the hand is limp until the operator lets go and
// presses again.
TEST(SupervisionPair, ALongSilenceOfAnyWayDemandsAnAct) {
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    rt::Random random(seed, 1);
    const Draw d = draw(random, 1300, 3000);
    Pair p = engaged_pair(d, random);
    p.run(milliseconds{400} + d.delay + d.delay);
    const char* when = "in the silence";
    for (milliseconds t{0}; t < d.silence + milliseconds{2500}; t += kTick) {
      p.tick();
      if (t > d.silence) when = "behind the silence";
      ASSERT_TRUE(p.robot.mode() != Mode::kEngaged && p.op.mode() != Mode::kEngaged)
          << "seed " << seed << " " << when << ": delay " << d.delay.count() << " ms, silence "
          << d.silence.count() << " ms, to robot " << d.to_robot << ", to operator "
          << d.to_operator;
    }
    EXPECT_LE(p.robot_deaf_ms, 190) << "seed " << seed;
    p.engage = false;
    p.run(milliseconds{800});
    p.engage = true;
    p.run(milliseconds{1500});
    EXPECT_TRUE(p.both_engaged()) << "seed " << seed << ": an act helps";
  }
}

}  // namespace
}  // namespace tests
