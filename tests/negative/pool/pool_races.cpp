// Forks and joins over plain memory, built with ThreadSanitizer.
//
//   pool_races product|relaxed_call|relaxed_join|no_wake
//
// `product` is clean and exits 0. Without the order of the calls (the caller's writes before a
// part) or of the join (the parts' writes before what the caller does next) ThreadSanitizer must
// report a data race. With `no_wake` the last worker does not wake the caller: a watcher sees that
// nothing moves.
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <string_view>
#include <thread>
#include <type_traits>

#include "rt/sched/worker_pool.hpp"

namespace {

constexpr auto kWeak = std::memory_order_relaxed;

// An atomic word whose rising (calls) or falling (join) accesses ignore the order asked for. Calls
// are only raised, the join only lowered and stored.
template <class U, bool kWeakCall, bool kWeakJoin>
class Weakened {
 public:
  Weakened() = default;
  Weakened(U v) : v_(v) {}  // NOLINT: implicit as in std::atomic
  U load(std::memory_order o) const noexcept { return v_.load(kWeakCall || kWeakJoin ? kWeak : o); }
  void store(U v, std::memory_order o) noexcept { v_.store(v, kWeakJoin ? kWeak : o); }
  U fetch_add(U d, std::memory_order o) noexcept { return v_.fetch_add(d, kWeakCall ? kWeak : o); }
  U fetch_sub(U d, std::memory_order o) noexcept { return v_.fetch_sub(d, kWeakJoin ? kWeak : o); }

 private:
  std::atomic<U> v_{};
};

// The word of the join never seems to become 0 to the one who lowers it last.
template <class U>
class NoWake : public Weakened<U, false, false> {
 public:
  using Weakened<U, false, false>::Weakened;
  U fetch_sub(U d, std::memory_order o) noexcept {
    return Weakened<U, false, false>::fetch_sub(d, o) + 1;
  }
};

template <bool kWeakCall, bool kWeakJoin>
struct Weak {
  template <class U>
  using Atomic = Weakened<U, kWeakCall, kWeakJoin>;
};
struct Unwoken {
  template <class U>
  using Atomic = NoWake<U>;
};

template <class Protocol>
int run() {
  constexpr int kForks = 3000;
  rt::Startup startup;
  rt::BasicWorkerPool<Protocol> pool(startup.token(), 2);
  std::array<std::thread, 2> threads{std::thread([&] { pool.serve(0); }),
                                     std::thread([&] { pool.serve(1); })};
  std::atomic<int> done{0};
  std::thread watcher([&] {
    for (int seen = -1; done.load() < kForks;) {
      if (done.load() == seen) {
        std::puts("a join never came back");
        std::fflush(stdout);
        ::_exit(1);
      }
      seen = done.load();
      for (int n = 0; n < 50 && done.load() < kForks; ++n) ::usleep(100'000);
    }
  });
  std::array<std::uint64_t, 3> word{};
  std::uint64_t input = 0, wrong = 0;
  for (int n = 0; n < kForks; ++n) {
    input = static_cast<std::uint64_t>(n);
    pool.for_parts(3, [&](int p) {
      if (p > 0) ::usleep(n % 100 == 0 ? 200 : 0);  // now the caller waits, now it does not
      word[static_cast<std::size_t>(p)] = 7 * input + static_cast<std::uint64_t>(p);
    });
    for (std::uint64_t p = 0; p < 3; ++p) wrong += word[p] != 7 * input + p ? 1U : 0U;
    done.store(n + 1);
  }
  watcher.join();
  pool.stop();
  for (auto& t : threads) t.join();
  std::printf("%llu wrong words\n", static_cast<unsigned long long>(wrong));
  return wrong == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view what = argc > 1 ? argv[1] : "";
  if (what == "product") return run<rt::WorkerPoolProtocol>();
  if (what == "relaxed_call") return run<Weak<true, false>>();
  if (what == "relaxed_join") return run<Weak<false, true>>();
  if (what == "no_wake") return run<Unwoken>();
  std::fprintf(stderr, "pool_races product|relaxed_call|relaxed_join|no_wake\n");
  return 2;
}
