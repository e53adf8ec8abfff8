// Which instruction set the vector kernels of perception run on. The best one the machine has,
// unless one is forced (--isa) before the first kernel runs.
//
// kScalar is the plain reference that the tests hold the others against. All give the same bytes:
// no contraction of products and sums, fixed lane order in every reduction.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace perception::simd {

enum class Isa : std::uint8_t { kScalar = 0, kSse4, kAvx2, kAvx512 };

[[nodiscard]] const char* name_of(Isa isa) noexcept;
// What this machine can run, kScalar first, the best one last.
[[nodiscard]] std::span<const Isa> available() noexcept;
[[nodiscard]] Isa chosen() noexcept;
// For the whole process; not while another thread runs a kernel. False: the machine does not have
// it.
bool choose(Isa isa) noexcept;
// "auto" or a name; false: unknown, or the machine does not have it.
bool choose(std::string_view name) noexcept;

// Whether many 4-byte loads are quicker by the gather instruction than one by one (both give the
// same): on Intel's processors since AVX-VNNI by three, 16 in 6 cycles; neither on those before,
// mended in microcode, nor on AMD's.
[[nodiscard]] bool gathers() noexcept;

}  // namespace perception::simd
