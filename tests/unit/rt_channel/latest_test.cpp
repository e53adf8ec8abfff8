// Latest: what readers hold stays, sequences rise, nothing tears; sequential model and threads.
#include "rt/channel/latest.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <deque>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
constexpr std::uint64_t kReads = 500;  // sanitizers are about 30 times slower
#else
constexpr std::uint64_t kReads = 20'000;
#endif

// 4 KB that all say the same number.
struct Page {
  std::array<std::uint64_t, 512> w{};
  void fill(std::uint64_t n) {
    for (auto& x : w) x = n;
  }
  bool is(std::uint64_t n) const {
    for (const auto x : w) {
      if (x != n) return false;
    }
    return true;
  }
};

class LatestTest : public testing::Test {
 protected:
  rt::Startup startup_;
  rt::NonRealtime& nrt_ = startup_.token();
};

TEST_F(LatestTest, NothingBeforeTheFirstPublication) {
  rt::Latest<int> cell(nrt_, {1, 2});
  EXPECT_EQ(cell.slot_count(), 5);
  EXPECT_EQ(cell.latest_seq(), 0u);
  EXPECT_FALSE(cell.fresh(0));
  EXPECT_EQ(cell.acquire(0).value, nullptr);
  EXPECT_EQ(cell.acquire_if_new(1).value, nullptr);
  cell.begin_write() = 7;
  EXPECT_EQ(cell.acquire(0).value, nullptr);  // written is not published
  EXPECT_EQ(cell.publish(), 1u);
  EXPECT_TRUE(cell.fresh(0));
  const auto view = cell.acquire(0);
  ASSERT_TRUE(view);
  EXPECT_EQ(*view, 7);
  EXPECT_EQ(view.seq, 1u);
  EXPECT_FALSE(cell.fresh(0));
  EXPECT_TRUE(cell.fresh(1));
}

TEST_F(LatestTest, AnAbandonedWriteIsNotPublished) {
  rt::Latest<int> cell(nrt_, {1});
  cell.begin_write() = 1;
  cell.publish();
  int* slot = &cell.begin_write();
  *slot = 99;  // the job was aborted here
  EXPECT_EQ(*cell.acquire(0), 1);
  EXPECT_EQ(&cell.begin_write(), slot);
  EXPECT_EQ(*cell.acquire(0), 1);
  cell.begin_write() = 2;
  EXPECT_EQ(cell.publish(), 2u);
  EXPECT_EQ(*cell.acquire(0), 2);
  EXPECT_EQ(cell.publish(), 0u);  // nothing was begun
  EXPECT_EQ(cell.latest_seq(), 2u);
}

TEST_F(LatestTest, AcquiringTheSameValueAgainSpendsAWordAndAcquireIfNewDoesNot) {
  rt::Latest<int> cell(nrt_, {2});
  auto publish = [&](int v) {
    cell.begin_write() = v;
    cell.publish();
  };
  publish(1);
  const auto one = cell.acquire(0);
  publish(2);
  const auto two = cell.acquire(0);
  EXPECT_EQ(two.seq, 2u);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(cell.acquire_if_new(0).value, two.value);
  // Still both valid, whatever the writer does.
  for (int v = 3; v < 20; ++v) {
    publish(v);
    EXPECT_EQ(*one, 1);
    EXPECT_EQ(*two, 2);
  }
  const auto nineteen = cell.acquire_if_new(0);
  EXPECT_EQ(nineteen.seq, 19u);
  EXPECT_EQ(cell.acquire(0).seq, 19u);
  // `one` and `two` are given up now, so 19 is held twice and four slots turn over.
  for (int v = 20; v < 40; ++v) {
    publish(v);
    EXPECT_EQ(*nineteen, 19);
  }
}

TEST_F(LatestTest, RefusesWhatItCanNotHold) {
  EXPECT_THROW((rt::Latest<int>(nrt_, {1, 0})), std::invalid_argument);
  EXPECT_THROW((rt::Latest<int>(nrt_, {9})), std::invalid_argument);
  EXPECT_THROW((rt::Latest<int>(nrt_, std::vector<int>(32, 8))), std::invalid_argument);
  rt::Latest<int> nobody(nrt_, {});
  for (int i = 1; i < 10; ++i) {
    nobody.begin_write() = i;
    EXPECT_EQ(nobody.publish(), static_cast<std::uint64_t>(i));
  }
}

struct Counted {
  static inline int alive = 0, throw_at = -1;
  explicit Counted(int n) : buffer(static_cast<std::size_t>(n)) {
    if (alive == throw_at) throw std::runtime_error("deliberate");
    ++alive;
  }
  ~Counted() { --alive; }
  std::vector<int> buffer;
  alignas(256) char payload[300] = {};
};

TEST_F(LatestTest, MakesAndEndsEverySlotOnce) {
  Counted::alive = 0;
  Counted::throw_at = -1;
  {
    rt::Latest<Counted> cell(nrt_, {1, 2}, 17);
    EXPECT_EQ(Counted::alive, 5);
    int slots = 0;
    cell.for_each_slot(nrt_, [&](Counted& c) {
      ++slots;
      EXPECT_EQ(c.buffer.size(), 17u);
      EXPECT_EQ(reinterpret_cast<std::uintptr_t>(&c) % 256, 0u);
    });
    EXPECT_EQ(slots, 5);
  }
  EXPECT_EQ(Counted::alive, 0);
  Counted::throw_at = 3;  // the fourth slot fails: the first three are ended
  EXPECT_THROW((rt::Latest<Counted>(nrt_, {1, 2}, 17)), std::runtime_error);
  EXPECT_EQ(Counted::alive, 0);
}

TEST_F(LatestTest, LargeValuesStayInPlace) {
  struct Patch {
    std::array<std::int16_t, 750'000> d{};  // 1.5 MB
  };
  rt::Latest<Patch> cell(nrt_, {2});
  for (std::int16_t v = 1; v <= 10; ++v) {
    Patch& p = cell.begin_write();
    p.d.fill(v);
    cell.publish();
    const auto view = cell.acquire(0);
    EXPECT_EQ(view.value, &p);  // not copied
    EXPECT_EQ(view->d.front(), v);
    EXPECT_EQ(view->d.back(), v);
  }
}

// One thread plays writer and readers in random order; what is held never changes.
TEST_F(LatestTest, HeldValuesNeverChange) {
  for (const std::uint64_t seed : {11ULL, 12ULL, 13ULL}) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    rt::Random random(seed);
    const std::vector<int> retained{1, 2, static_cast<int>(seed % 8) + 1};
    rt::Latest<std::uint64_t> cell(nrt_, retained);
    std::vector<std::deque<rt::Latest<std::uint64_t>::View>> held(retained.size());
    std::uint64_t published = 0;
    for (int step = 0; step < 200'000; ++step) {
      const auto who = static_cast<std::size_t>(random.integer(0, 3));
      if (who == 3) {
        cell.begin_write() = published + 1;
        if (random.uniform() < 0.7) {
          ASSERT_EQ(cell.publish(), ++published);
        }
      } else {
        const bool only_new = random.uniform() < 0.5;
        const int r = static_cast<int>(who);
        const bool fresh = cell.fresh(r);
        const auto view = only_new ? cell.acquire_if_new(r) : cell.acquire(r);
        ASSERT_EQ(view.seq, published);
        ASSERT_EQ(view.value == nullptr, published == 0);
        if (view && (fresh || !only_new)) held[who].push_back(view);
        if (held[who].size() > static_cast<std::size_t>(retained[who])) held[who].pop_front();
      }
      for (const auto& of_reader : held) {
        for (const auto& view : of_reader) ASSERT_EQ(*view, view.seq);
      }
    }
  }
}

// A flat-out writer and three readers: no page is ever torn, also not the retained one.
TEST_F(LatestTest, NoTornReadsAcrossThreads) {
  rt::Latest<Page> cell(nrt_, {1, 2, 3});
  std::atomic<bool> done{false};
  std::array<std::uint64_t, 3> torn{}, lost{}, backwards{};
  std::array<std::atomic<std::uint64_t>, 3> values{};  // different ones that a reader has seen
  std::vector<std::thread> readers;
  for (int r = 0; r < 3; ++r) {
    readers.emplace_back([&, r] {
      const auto i = static_cast<std::size_t>(r);
      std::deque<rt::Latest<Page>::View> held;
      std::uint64_t last = 0, reads = 0;
      while (!done.load(std::memory_order_relaxed)) {
        const auto before = cell.latest_seq();
        const auto view = reads % 2 == 0 ? cell.acquire(r) : cell.acquire_if_new(r);
        if (!view) continue;
        if (view.seq < before) ++lost[i];
        if (view.seq < last) ++backwards[i];
        if (held.empty() || view.seq != last || reads % 2 == 0) held.push_back(view);
        if (held.size() > i + 1) held.pop_front();
        if (view.seq != last) values[i].fetch_add(1, std::memory_order_relaxed);
        last = view.seq;
        for (const auto& v : held) {
          if (!v->is(v.seq)) ++torn[i];
        }
        if (++reads % 64 == 0) std::this_thread::yield();
      }
    });
  }
  const auto enough = [&] {
    return values[0].load() >= kReads && values[1].load() >= kReads && values[2].load() >= kReads;
  };
  std::uint64_t wrong_seq = 0;
  for (std::uint64_t n = 1; n % 256 != 0 || !enough(); ++n) {
    cell.begin_write().fill(n);
    if (cell.publish() != n) ++wrong_seq;
    if (n % 64 == 0) std::this_thread::yield();
  }
  done.store(true);
  for (auto& t : readers) t.join();
  EXPECT_EQ(wrong_seq, 0u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(torn[i], 0u) << "reader " << i;
    EXPECT_EQ(lost[i], 0u) << "reader " << i;
    EXPECT_EQ(backwards[i], 0u) << "reader " << i;
  }
}

TEST_F(LatestTest, AllocatesAndLocksNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in this build";
  rt::Latest<Page> cell(nrt_, {1, 2});
  rt_guard::reset();
  {
    rt::Section s;
    for (std::uint64_t i = 0; i < 100; ++i) {
      cell.begin_write().fill(i);
      cell.publish();
      (void)cell.acquire(0);
      (void)cell.acquire_if_new(1);
    }
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

}  // namespace
