// One stripe of a depth image into bytes and back.
//
// Bytes: u8 form; 0 = plain: the points, 16 bits each; 1 = coded: u16 bytes of the tables, u24
// bytes of the raw bits, the tables, the raw bits, the rANS stream. A stripe never takes more than
// kStripeOverhead + 2 bytes a pixel: what coding would make longer goes plain.
//
// A residual is folded (0, -1, 1, -2 ...) to v. v < kDirect is a symbol of its own; above, a symbol
// stands for two lengths of v - kDirect + 1, and raw bits say which and give the bits below its
// first. kSwitch, in time context only: predicted in space after all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/codec/depth_walk.hpp"
#include "drivers/codec/rans.hpp"

namespace drivers::codec {

inline constexpr std::size_t kStripeOverhead = 6;
inline constexpr unsigned kDirect = 22, kSwitch = 31;
static_assert(kSwitch < kRansSymbols);

// Points in steps: a value is its prediction and a number of steps, within [1, top].
struct StepScale {
  int step = 1;  // points
  int top = 65535;
  [[nodiscard]] int value(int prediction, int residual) const noexcept {
    return std::clamp(prediction + step * residual, 1, top);
  }
};

// What the encoder wants of the pixels of a stripe.
struct StripePlan {
  const std::uint16_t* reading = nullptr;  // points; 0: none
  const std::uint16_t* target = nullptr;   // what is to be coded, where it is
  const std::uint8_t* due = nullptr;       // 0: a value before is to stay
  const std::uint8_t* kinds = nullptr;     // of the blocks
  int dead_zone = 0;                       // points: a spatial residual so small is none
};

class StripeEncoder {
 public:
  explicit StripeEncoder(const StripeShape& most);
  // Leaves in `points` what the decoder will have; bytes() until the next call.
  void encode(const StripeShape& shape, const StepScale& scale, const StripePlan& plan,
              std::uint16_t* points, const std::uint8_t* history) noexcept;
  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept {
    return {out_.data(), size_};
  }

 private:
  class Io;
  [[nodiscard]] bool assemble(std::size_t raw_bytes) noexcept;
  void count() noexcept;
  void write_tables(BitWriter& head) noexcept;
  void plain(const StripeShape& shape, const std::uint16_t* points) noexcept;

  WalkRows rows_;
  // What is to be coded, in order: a symbol of a context, or behind those a decision of one.
  static constexpr std::size_t kDecisions = std::size_t{kContexts} * kRansSymbols,
                               kRecords = kDecisions + 2 * std::size_t{kBitContexts};
  std::vector<std::uint16_t> records_;
  std::size_t recorded_ = 0;
  std::array<std::uint32_t, kRecords> counts_{};
  std::array<RansShare, kRecords> shares_{};
  std::vector<std::uint8_t> raw_, rans_, out_;
  std::size_t size_ = 0;
};

class StripeDecoder {
 public:
  explicit StripeDecoder(const StripeShape& most);
  // False: no encoder wrote that. `points` is then of no use.
  [[nodiscard]] bool decode(const StripeShape& shape, const StepScale& scale,
                            std::span<const std::uint8_t> in, std::uint16_t* points,
                            const std::uint8_t* history) noexcept;

 private:
  class Io;
  [[nodiscard]] bool read_tables(BitReader& in) noexcept;

  WalkRows rows_;
  std::vector<RansDecodeTable> tables_;
  std::array<std::uint32_t, kBitContexts> zero_{};
};

}  // namespace drivers::codec
