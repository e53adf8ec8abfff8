#include "perception/simd/isa.hpp"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <array>
#include <atomic>

#include "perception/simd/targets.hpp"

#include <hwy/highway.h>

namespace perception::simd {
namespace {

constexpr Isa kAll[] = {Isa::kScalar, Isa::kSse4, Isa::kAvx2, Isa::kAvx512};

std::int64_t bit_of(Isa isa) noexcept {
  switch (isa) {
    case Isa::kSse4:
      return HWY_SSE4;
    case Isa::kAvx2:
      return HWY_AVX2;
    case Isa::kAvx512:
      return HWY_AVX3;
    case Isa::kScalar:
      break;
  }
  return 0;
}

// Everything the machine has and the kernels were compiled for, best last.
struct Available {
  std::array<Isa, 4> list{};
  std::size_t count = 0;
  Available() noexcept {
    const std::int64_t have = hwy::SupportedTargets() & HWY_TARGETS;
    for (const Isa isa : kAll)
      if (isa == Isa::kScalar || (have & bit_of(isa)) != 0) list[count++] = isa;
  }
};
const Available& machine() noexcept {
  static const Available a;
  return a;
}

std::atomic<int> forced{-1};

bool fast_gather() noexcept {
#if defined(__x86_64__)
  unsigned a = 0, b = 0, c = 0, d = 0;
  if (__get_cpuid(0, &a, &b, &c, &d) == 0 || b != signature_INTEL_ebx) return false;
  constexpr unsigned kAvxVnni = 1U << 4U;
  return __get_cpuid_count(7, 1, &a, &b, &c, &d) != 0 && (a & kAvxVnni) != 0;
#else
  return false;
#endif
}

}  // namespace

const char* name_of(Isa isa) noexcept {
  constexpr const char* kNames[] = {"scalar", "sse4", "avx2", "avx512"};
  return kNames[static_cast<std::size_t>(isa)];
}

std::span<const Isa> available() noexcept { return {machine().list.data(), machine().count}; }

Isa chosen() noexcept {
  const int f = forced.load(std::memory_order_relaxed);
  return f >= 0 ? static_cast<Isa>(f) : available().back();
}

bool gathers() noexcept {
  static const bool fast = fast_gather();
  return fast;
}

bool choose(Isa isa) noexcept {
  for (const Isa a : available()) {
    if (a != isa) continue;
    if (isa != Isa::kScalar) {
      // Of what highway would choose from, this one alone.
      hwy::SetSupportedTargetsForTest(bit_of(isa));
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    }
    forced.store(static_cast<int>(isa), std::memory_order_relaxed);
    return true;
  }
  return false;
}

bool choose(std::string_view name) noexcept {
  if (name == "auto") return choose(available().back());
  for (const Isa isa : kAll)
    if (name == name_of(isa)) return choose(isa);
  return false;
}

}  // namespace perception::simd
