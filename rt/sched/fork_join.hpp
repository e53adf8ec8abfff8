// A piece of work cut into parts that do not touch each other, for whoever is there to take part.
//
// Which parts there are, and in which order their results are put together, is the caller's business and must not
// depend on how many threads there are: then one and n threads give the same bytes. Part p always goes to
// member p % width() (member 0 is the caller), so what each costs repeats too.
#pragma once

#include <cstdint>

namespace rt {

class ForkJoin {
 public:
  virtual ~ForkJoin() = default;
  // Threads that take part, the caller's own included.
  [[nodiscard]] virtual int width() const noexcept = 0;
  // How much longer than the caller's own parts the longest other member took, thread CPU summed over all
  // forks so far: caller's CPU + this = the way through. 0 unless it is being measured.
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

// The caller does it all, in rising order.
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
