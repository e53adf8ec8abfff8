// Runs independent parts of a piece of work on several threads.
//
// The caller decides about the parts and the order in which their results are combined. Neither may
// depend on the number of threads; then one thread and n threads give the same bytes. Part p always
// goes to member p % width() (member 0 is the caller), so the cost of each member repeats too.
#pragma once

#include <cstdint>

namespace rt {

class ForkJoin {
 public:
  virtual ~ForkJoin() = default;
  // Threads that take part, the caller's own included.
  [[nodiscard]] virtual int width() const noexcept = 0;
  // By how much the longest other member exceeded the caller's own parts, thread CPU summed over
  // all forks so far. The caller's CPU plus this is the length of the critical path. 0 unless it is
  // being measured.
  [[nodiscard]] virtual std::int64_t beyond_ns() const noexcept { return 0; }
  // fn(p) for p = 0 .. parts - 1, each once; back when all are done. By one thread at a time.
  template <class F>
  void for_parts(int parts, const F& fn) noexcept {
    run(
        parts,
        [](const void* context, int part) noexcept { (*static_cast<const F*>(context))(part); },
        &fn);
  }

 protected:
  using Body = void (*)(const void* context, int part) noexcept;
  virtual void run(int parts, Body body, const void* context) noexcept = 0;
};

// The caller does all parts, in rising order.
class SerialForkJoin final : public ForkJoin {
 public:
  [[nodiscard]] int width() const noexcept override { return 1; }

 protected:
  void run(int parts, Body body, const void* context) noexcept override {
    for (int p = 0; p < parts; ++p) body(context, p);
  }
};

[[nodiscard]] inline ForkJoin& serial() noexcept {
  static SerialForkJoin one;
  return one;
}

}  // namespace rt
