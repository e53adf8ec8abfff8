// What may be on its way to a page, against a line and a page that are simulated: 15 pictures a
// second are there to be sent.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <deque>

#include "tools/console/bulk_window.hpp"

namespace {

using teletact::BulkWindow;
constexpr std::uint64_t kPicture = 450'000;
constexpr std::int64_t kMs_ns = 1'000'000;
constexpr int kRun_ms = 100000, kJudged_ms = 10000;

struct Result {
  int seen = 0;                   // in the last kJudged_ms
  std::uint64_t most_unseen = 0;  // likewise
};

// One way `way_ms`; the page takes `work_ms` for each, one behind the other.
Result run(int way_ms, int work_ms) {
  BulkWindow window;
  std::deque<int> coming, words;  // ms: there, and its word here
  int free_at = 0, next = 0;
  std::uint64_t told = 0;
  Result r;
  for (int now = 0; now < kRun_ms; ++now) {
    while (!words.empty() && words.front() <= now) {
      words.pop_front();
      told += kPicture;
      EXPECT_TRUE(window.seen(told, now * kMs_ns));
      r.seen += now >= kRun_ms - kJudged_ms ? 1 : 0;
    }
    while (!coming.empty() && std::max(coming.front(), free_at) <= now) {
      coming.pop_front();
      free_at = now + work_ms;
      words.push_back(free_at + way_ms);
    }
    if (now >= next && window.room()) {
      window.sent(kPicture, now * kMs_ns);
      coming.push_back(now + way_ms);
      next = now + 66;
    }
    if (now >= kRun_ms - kJudged_ms) r.most_unseen = std::max(r.most_unseen, window.unseen());
  }
  return r;
}

// Of 151; each half minute the line is measured anew, with one on its way.
TEST(BulkWindowTest, AQuickPageFarAwayGetsAll) {
  for (const int way_ms : {0, 5, 20, 50, 100, 150}) {
    EXPECT_GE(run(way_ms, 2).seen, 140) << way_ms;
  }
}

// What its line and its work hold, half more (a quarter is tried for, and the rate is measured on
// few views), and one.
TEST(BulkWindowTest, ASlowPageIsBehindByItsWorkAndItsWay) {
  for (const int work_ms : {100, 150, 400, 1000}) {
    for (const int way_ms : {0, 5, 20, 50, 100}) {
      const Result r = run(way_ms, work_ms);
      const double most = 1 + 1.5 * (work_ms + 2 * way_ms) / work_ms;
      EXPECT_LE(static_cast<double>(r.most_unseen) / kPicture, most) << work_ms << ' ' << way_ms;
      EXPECT_GE(r.seen, 0.45 * kJudged_ms / work_ms) << work_ms << ' ' << way_ms;
    }
  }
}

TEST(BulkWindowTest, BeforeTheFirstWordThereIsRoomAndWrongWordsChangeNothing) {
  BulkWindow window;
  for (int i = 0; i < 3000; ++i) window.sent(kPicture, i);
  EXPECT_TRUE(window.room());
  EXPECT_FALSE(window.seen(3000 * kPicture + 1, 5000));
  EXPECT_TRUE(window.room());
  EXPECT_TRUE(window.seen(kPicture, 5000));
  EXPECT_FALSE(window.room());
  EXPECT_FALSE(window.seen(kPicture - 1, 5000));
  EXPECT_TRUE(window.seen(3000 * kPicture, 6000));
  EXPECT_TRUE(window.room());
}

}  // namespace
