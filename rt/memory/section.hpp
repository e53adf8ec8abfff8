// Marks the calling thread as inside a real-time section. The executors open one around every
// step(); the guard of the test builds (tools/measure/support/rt_guard.cpp) counts or aborts on an
// allocation, a lock or a throw inside one. Costs two thread-local adds where no guard is linked.
#pragma once

namespace rt {

namespace detail {
inline thread_local int section_depth = 0;
}

class Section {
 public:
  explicit Section(bool armed = true) noexcept : armed_(armed) {
    if (armed_) ++detail::section_depth;
  }
  ~Section() {
    if (armed_) --detail::section_depth;
  }
  Section(const Section&) = delete;
  Section& operator=(const Section&) = delete;
  [[nodiscard]] static bool active() noexcept { return detail::section_depth > 0; }

 private:
  bool armed_;
};

}  // namespace rt
