// Ring: order, content, drops, gaps, the wrap at 2^64, against std::deque and across two threads.
#include "rt/channel/ring.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
constexpr std::uint64_t kItems = 300'000;  // sanitizers are about 30 times slower
#else
constexpr std::uint64_t kItems = 10'000'000;
#endif
constexpr std::uint64_t kNearWrap = std::numeric_limits<std::uint64_t>::max() - 5;

struct Event {
  std::uint64_t seq = 0;
  bool gap = false;
};

// Owns nothing but is not trivially copyable, like an event with fixed-size Eigen vectors in it.
struct OwnCopy {
  double x = 0;
  OwnCopy() = default;
  explicit OwnCopy(double v) : x(v) {}
  OwnCopy(const OwnCopy& o) : x(o.x) {}
  OwnCopy& operator=(const OwnCopy& o) {
    x = o.x;
    return *this;
  }
};
static_assert(!std::is_trivially_copyable_v<OwnCopy>);

// 256 bytes that all follow from one number.
struct Block {
  std::array<std::uint64_t, 32> w{};
  static Block of(std::uint64_t n) {
    Block b;
    for (std::size_t i = 0; i < b.w.size(); ++i) b.w[i] = n * 0x9e3779b97f4a7c15ULL + i;
    return b;
  }
  bool is(std::uint64_t n) const { return w == of(n).w; }
};

TEST(Ring, FillsDrainsAndRefuses) {
  rt::Ring<int, 4> ring;
  int out = -1;
  EXPECT_FALSE(ring.try_pop(out));
  EXPECT_EQ(out, -1);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(ring.try_push(i));
  EXPECT_EQ(ring.size(), 4u);
  EXPECT_EQ(ring.high_water(), 4u);
  EXPECT_FALSE(ring.try_push(99));
  EXPECT_FALSE(ring.try_push(100));
  EXPECT_EQ(ring.dropped(), 2u);
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out, i);  // the newest was dropped, not the oldest
  }
  EXPECT_TRUE(ring.empty());
}

TEST(Ring, HighWaterIsTheBacklogMetByADrainingConsumer) {
  rt::Ring<int, 16> ring;
  int out = 0;
  for (const int burst : {3, 7, 2}) {
    for (int i = 0; i < burst; ++i) ring.try_push(i);
    while (ring.try_pop(out)) {
    }
  }
  EXPECT_EQ(ring.high_water(), 7u);
}

TEST(Ring, TheFirstEventAfterADropCarriesTheGap) {
  rt::Ring<Event, 2> ring;
  Event e;
  ring.try_push({1});
  ring.try_push({2});
  EXPECT_FALSE(ring.try_push({3}));
  EXPECT_FALSE(ring.try_push({4}));
  ASSERT_TRUE(ring.try_pop(e));
  EXPECT_FALSE(e.gap);
  EXPECT_TRUE(ring.try_push({5}));
  EXPECT_FALSE(ring.try_push({6}));
  ASSERT_TRUE(ring.try_pop(e));
  EXPECT_EQ(e.seq, 2u);
  EXPECT_FALSE(e.gap);
  ASSERT_TRUE(ring.try_pop(e));
  EXPECT_EQ(e.seq, 5u);
  EXPECT_TRUE(e.gap);
  EXPECT_TRUE(ring.try_push({7}));
  EXPECT_TRUE(ring.try_push({8}));
  ASSERT_TRUE(ring.try_pop(e));
  EXPECT_TRUE(e.gap);  // 6 is missing before 7
  ASSERT_TRUE(ring.try_pop(e));
  EXPECT_FALSE(e.gap);
}

TEST(Ring, TypesWithTheirOwnCopyTravelToo) {
  rt::Ring<OwnCopy, 4> ring(kNearWrap);
  OwnCopy out;
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(ring.try_push(OwnCopy(i * 0.5)));
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out.x, i * 0.5);
  }
}

// Any sequence of operations behaves as a bounded std::deque, from any start of the counters.
TEST(Ring, BehavesAsABoundedQueue) {
  for (const std::uint64_t seed : {1ULL, 2ULL, 3ULL, 4ULL}) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    rt::Random random(seed);
    const std::uint64_t first = seed % 2 == 0 ? kNearWrap : 0;
    rt::Ring<Event, 8> ring(first);
    std::deque<Event> model;
    std::uint64_t next = 0, dropped = 0;
    bool gap = false;
    for (int step = 0; step < 200'000; ++step) {
      const auto what = random.integer(0, 2);
      if (what == 0) {
        for (auto n = random.integer(1, 6); n > 0; --n) {
          const bool fits = model.size() < 8;
          ASSERT_EQ(ring.try_push({next, false}), fits);
          if (fits) {
            model.push_back({next, gap});
            gap = false;
          } else {
            ++dropped;
            gap = true;
          }
          ++next;
        }
      } else if (what == 1) {
        Event e;
        ASSERT_EQ(ring.try_pop(e), !model.empty());
        if (model.empty()) continue;
        ASSERT_EQ(e.seq, model.front().seq);
        ASSERT_EQ(e.gap, model.front().gap);
        model.pop_front();
      } else {
        std::array<Event, 10> out;
        const auto max = static_cast<std::size_t>(random.integer(0, 10));
        const std::size_t n = ring.pop_n(out.data(), max);
        ASSERT_EQ(n, std::min(max, model.size()));
        for (std::size_t i = 0; i < n; ++i) {
          ASSERT_EQ(out[i].seq, model.front().seq);
          ASSERT_EQ(out[i].gap, model.front().gap);
          model.pop_front();
        }
      }
      ASSERT_EQ(ring.size(), model.size());
      ASSERT_EQ(ring.dropped(), dropped);
    }
    EXPECT_GT(dropped, 0u);
  }
}

// Every item arrives, once, in order, whole; the counters pass 2^64 on the way.
template <class T, class Make, class Check>
void send_across(std::uint64_t items, Make make, Check check) {
  auto ring = std::make_unique<rt::Ring<T, 1024>>(~std::uint64_t{0} - items / 2);
  std::uint64_t wrong = 0;
  std::thread consumer([&] {
    std::vector<T> batch(64);
    for (std::uint64_t n = 0; n < items;) {
      // Both ways of taking, in turn.
      if (n % 3 == 0) {
        if (ring->try_pop(batch[0])) {
          wrong += check(batch[0], n++) ? 0U : 1U;
        } else {
          std::this_thread::yield();
        }
      } else {
        const std::size_t got = ring->pop_n(batch.data(), batch.size());
        for (std::size_t i = 0; i < got; ++i) wrong += check(batch[i], n++) ? 0U : 1U;
        if (got == 0) std::this_thread::yield();
      }
    }
  });
  for (std::uint64_t n = 0; n < items; ++n) {
    const T item = make(n);
    while (!ring->try_push(item)) std::this_thread::yield();
  }
  consumer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_TRUE(ring->empty());
}

TEST(RingThreads, WordsArriveInOrder) {
  send_across<std::uint64_t>(
      kItems, [](std::uint64_t n) { return rt::mix64(n); },
      [](std::uint64_t got, std::uint64_t n) { return got == rt::mix64(n); });
}

TEST(RingThreads, BlocksArriveWhole) {
  send_across<Block>(
      kItems / 10, [](std::uint64_t n) { return Block::of(n); },
      [](const Block& got, std::uint64_t n) { return got.is(n); });
}

TEST(RingThreads, DropsAreCountedAndFlagged) {
  constexpr std::uint64_t kCount = kItems / 20;
  auto ring = std::make_unique<rt::Ring<Event, 16>>(~std::uint64_t{0} - kCount / 4);
  std::atomic<bool> start{false}, done{false};
  std::uint64_t received = 0, missing = 0, wrong = 0;
  std::thread consumer([&] {
    std::uint64_t expected = 0;
    Event e;
    while (!start.load()) std::this_thread::yield();
    for (;;) {
      const bool last_look = done.load(std::memory_order_acquire);
      while (ring->try_pop(e)) {
        ++received;
        if (e.seq < expected || e.gap != (e.seq != expected)) ++wrong;
        missing += e.seq - expected;
        expected = e.seq + 1;
      }
      if (last_look) break;
      std::this_thread::yield();
    }
    missing += kCount - expected;  // dropped at the end, no element after them
  });
  std::uint64_t refused = 0;
  rt::Random random(21);
  std::uint64_t n = 0;
  // Full before anybody reads: some are refused, whatever the machine does.
  for (; n < 20; ++n) refused += ring->try_push({n, false}) ? 0 : 1;
  start.store(true);
  while (n < kCount) {
    // Bursts around the capacity, so that most fit and some do not.
    for (auto burst = random.integer(1, 20); burst > 0 && n < kCount; --burst, ++n) {
      if (!ring->try_push({n, false})) ++refused;
    }
    // The reader has its turn, however late a busy machine gives it.
    while (!ring->empty()) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  consumer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(ring->dropped(), refused);
  EXPECT_EQ(missing, refused);
  EXPECT_EQ(received + refused, kCount);
  EXPECT_GT(received, kCount / 10);
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(ring->high_water(), 16u);
}

TEST(Ring, AllocatesAndLocksNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in this build";
  auto ring = std::make_unique<rt::Ring<Block, 64>>();
  Block b = Block::of(1);
  rt_guard::reset();
  {
    rt::Section s;
    for (int i = 0; i < 200; ++i) {
      ring->try_push(b);
      if (i % 3 == 0) ring->try_pop(b);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

}  // namespace
