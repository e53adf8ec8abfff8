// Two threads over one channel, built with ThreadSanitizer.
//
//   channel_races ring|latest product|relaxed_stores|relaxed_loads
//
// With `product` the run is clean and exits 0; with an order weakened for all stores or all loads
// ThreadSanitizer must report a data race. The values themselves are right in every case on x86:
// only the missing happens-before shows.
#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string_view>
#include <thread>

#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"

namespace {

constexpr auto kWeak = std::memory_order_relaxed;

// Atomics that ignore the order asked for on one kind of access.
template <class U, bool kWeakStores, bool kWeakLoads>
class Weakened {
 public:
  Weakened() = default;
  Weakened(U v) : v_(v) {}  // NOLINT: implicit as in std::atomic
  U load(std::memory_order o) const noexcept { return v_.load(kWeakLoads ? kWeak : o); }
  void store(U v, std::memory_order o) noexcept { v_.store(v, kWeakStores ? kWeak : o); }
  bool compare_exchange_strong(U& expected, U desired, std::memory_order o) noexcept {
    return v_.compare_exchange_strong(expected, desired, kWeakStores || kWeakLoads ? kWeak : o);
  }

 private:
  std::atomic<U> v_{};
};

template <class Base, bool kWeakStores, bool kWeakLoads>
struct Weak : Base {
  template <class U>
  using Atomic = Weakened<U, kWeakStores, kWeakLoads>;
};

struct Block {
  std::array<std::uint64_t, 32> w{};
};

template <class Protocol>
int run_ring() {
  constexpr std::uint64_t kItems = 100'000;
  auto ring = std::make_unique<rt::Ring<Block, 16, Protocol>>();
  std::uint64_t wrong = 0;
  std::thread consumer([&] {
    Block b;
    for (std::uint64_t n = 0; n < kItems;) {
      if (!ring->try_pop(b)) {
        std::this_thread::yield();
        continue;
      }
      for (const auto x : b.w) wrong += x != n ? 1U : 0U;
      ++n;
    }
  });
  Block b;
  for (std::uint64_t n = 0; n < kItems; ++n) {
    b.w.fill(n);
    while (!ring->try_push(b)) std::this_thread::yield();
  }
  consumer.join();
  std::printf("ring: %llu wrong words\n", static_cast<unsigned long long>(wrong));
  return wrong == 0 ? 0 : 1;
}

template <class Protocol>
int run_latest() {
  constexpr std::uint64_t kValues = 1000;  // different ones each reader must have seen
  rt::Startup startup;
  rt::Latest<Block, Protocol> cell(startup.token(), {1, 2});
  std::array<std::atomic<std::uint64_t>, 2> seen{}, wrong{};
  std::atomic<bool> done{false};
  auto read = [&](int r) {
    const auto i = static_cast<std::size_t>(r);
    typename rt::Latest<Block, Protocol>::View before;
    while (!done.load(std::memory_order_relaxed)) {
      const auto view = cell.acquire(r);
      if (!view) continue;
      for (const auto x : view->w) wrong[i] += x != view.seq ? 1U : 0U;
      if (r == 1 && before) {
        for (const auto x : before->w) wrong[i] += x != before.seq ? 1U : 0U;
      }
      if (view.seq != before.seq) seen[i].fetch_add(1, std::memory_order_relaxed);
      if (view.seq == before.seq) std::this_thread::yield();
      before = view;
    }
  };
  std::thread a(read, 0), b(read, 1);
  std::uint64_t n = 0;
  while (seen[0].load(std::memory_order_relaxed) < kValues ||
         seen[1].load(std::memory_order_relaxed) < kValues) {
    cell.begin_write().w.fill(++n);
    cell.publish();
    if (n % 16 == 0) std::this_thread::yield();
  }
  done.store(true, std::memory_order_relaxed);
  a.join();
  b.join();
  const std::uint64_t total = wrong[0] + wrong[1];
  std::printf("latest: %llu wrong words\n", static_cast<unsigned long long>(total));
  return total == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view channel = argc > 1 ? argv[1] : "";
  const std::string_view variant = argc > 2 ? argv[2] : "";
  const bool ring = channel == "ring";
  if (!ring && channel != "latest") return 2;
  if (variant == "product") {
    return ring ? run_ring<rt::RingProtocol>() : run_latest<rt::LatestProtocol>();
  }
  if (variant == "relaxed_stores") {
    return ring ? run_ring<Weak<rt::RingProtocol, true, false>>()
                : run_latest<Weak<rt::LatestProtocol, true, false>>();
  }
  if (variant == "relaxed_loads") {
    return ring ? run_ring<Weak<rt::RingProtocol, false, true>>()
                : run_latest<Weak<rt::LatestProtocol, false, true>>();
  }
  return 2;
}
