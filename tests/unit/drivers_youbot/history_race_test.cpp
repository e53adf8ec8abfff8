// The camera twin reads true poses while the robot's thread writes them: what is read must be a
// pose that was written, never a mixture. (Run under the thread sanitizer as well.)
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "drivers/youbot/virtual_youbot.hpp"

namespace {

using drivers::PoseHistory;

TEST(PoseHistory, ReadersNeverSeeATornSample) {
  PoseHistory history;
  std::atomic<bool> done{false};
  std::atomic<int> good{0};
  const auto reader = [&] {
    PoseHistory::Sample s;
    while (!done.load()) {
      if (!history.newest(s)) continue;
      // Every field of a sample is written with the same number.
      const double n = static_cast<double>(rt::ns_of(s.time));
      ASSERT_EQ(s.X_WB.x, n);
      ASSERT_EQ(s.X_WB.y, n);
      ASSERT_EQ(s.v_B.wz, 0);
      ASSERT_EQ(s.path_m, n);
      ++good;
      PoseHistory::Sample old;
      if (history.at(s.time - rt::Nanos{500}, old)) {
        ASSERT_EQ(old.path_m, n - 500);
      }
    }
  };
  std::thread a(reader), b(reader);
  for (std::int64_t n = 1; n <= 300'000; ++n) {
    const double v = static_cast<double>(n);
    history.publish({rt::time_from_ns(n), {v, v, 0}, {}, 0, v});
    if (n % 5000 == 0) std::this_thread::yield();
  }
  while (good.load() < 1000) std::this_thread::yield();
  done = true;
  a.join();
  b.join();
}

}  // namespace
