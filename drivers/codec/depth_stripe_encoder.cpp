#include <bit>

#include "drivers/codec/depth_stripe.hpp"

namespace drivers::codec {

namespace {

constexpr unsigned kSwitchFrom = 6;  // folded residual in time from which space is asked

std::uint32_t fold(int r) noexcept {
  return static_cast<std::uint32_t>(r) << 1U ^ static_cast<std::uint32_t>(r >> 31);
}

}  // namespace

class StripeEncoder::Io {
 public:
  Io(StripeEncoder& to, const StepScale& scale, const StripePlan& plan) noexcept
      : to_(to),
        plan_(plan),
        scale_(scale),
        inverse_(((std::uint64_t{1} << 32U) + static_cast<unsigned>(scale.step) - 1) /
                 static_cast<unsigned>(scale.step)),
        half_(scale.step / 2),
        next_(to.records_.data()),
        raw_(to.raw_) {}

  [[nodiscard]] unsigned kind(int context, int block) noexcept {
    record(context, plan_.kinds[block]);
    return plan_.kinds[block];
  }
  [[nodiscard]] bool valid(int context, int pixel) noexcept {
    const unsigned v = plan_.reading[pixel] != 0 ? 1 : 0;
    note(kDecisions + 2 * static_cast<unsigned>(context) + v);
    return v != 0;
  }
  [[nodiscard]] Coded spatial(int context, int pixel, int prediction) noexcept {
    const int d = plan_.target[pixel] - prediction;
    return write(context, prediction, std::abs(d) <= plan_.dead_zone ? 0 : steps(d));
  }
  template <class InSpace>
  [[nodiscard]] Coded temporal(int context, int pixel, int before,
                               const InSpace& in_space) noexcept {
    const int r = plan_.due[pixel] != 0 ? steps(plan_.target[pixel] - before) : 0;
    if (fold(r) >= kSwitchFrom) {
      const int prediction = in_space();
      const int s = steps(plan_.target[pixel] - prediction);
      if (2 * std::abs(s) < std::abs(r)) {
        record(context, kSwitch);
        return write(kAloneContext, prediction, s);
      }
    }
    return write(context, before, r);
  }
  [[nodiscard]] static bool bad() noexcept { return false; }
  [[nodiscard]] BitWriter& raw() noexcept { return raw_; }
  [[nodiscard]] std::size_t recorded() const noexcept {
    return static_cast<std::size_t>(next_ - to_.records_.data());
  }

 private:
  void record(int context, unsigned symbol) noexcept {
    note(static_cast<unsigned>(context) << 5U | symbol);
  }
  void note(std::size_t record) noexcept { *next_++ = static_cast<std::uint16_t>(record); }
  // To the nearest number of steps.
  [[nodiscard]] int steps(int d) const noexcept {
    const auto n = static_cast<std::uint64_t>(std::abs(d) + half_);
    const int r = static_cast<int>((n * inverse_) >> 32U);
    return d < 0 ? -r : r;
  }
  [[nodiscard]] Coded write(int context, int prediction, int r) noexcept {
    const std::uint32_t v = fold(r);
    if (v < kDirect) {
      record(context, v);
    } else {
      const std::uint32_t u = v - kDirect + 1;
      const auto length = static_cast<unsigned>(std::bit_width(u)) - 1;
      record(context, kDirect + length / 2);
      raw_.put(length & 1U, 1);
      raw_.put(u - (1U << length), length);
    }
    return {scale_.value(prediction, r), std::min(std::abs(r), kMostSize)};
  }

  const StripeEncoder& to_;
  const StripePlan plan_;
  StepScale scale_;
  std::uint64_t inverse_;
  int half_;
  std::uint16_t* next_;  // of the records
  BitWriter raw_;
};

StripeEncoder::StripeEncoder(const StripeShape& most)
    : rows_(most.width),
      records_(3 * static_cast<std::size_t>(most.width * most.rows) +
               static_cast<std::size_t>(most.blocks())),
      raw_(2 * static_cast<std::size_t>(most.width * most.rows)),
      rans_(raw_.size() + 8),
      out_(raw_.size() + kStripeOverhead) {}

void StripeEncoder::encode(const StripeShape& shape, const StepScale& scale, const StripePlan& plan,
                           std::uint16_t* points, const std::uint8_t* history) noexcept {
  Io io(*this, scale, plan);
  Walk<Io> walk(shape, rows_, io, points, history);
  static_cast<void>(walk.run());
  recorded_ = io.recorded();
  count();
  const std::size_t raw_bytes = io.raw().finish();
  if (io.raw().full() || !assemble(raw_bytes) || size_ > shape.plain_bytes()) {
    plain(shape, points);
  }
}

// In two tables by turns: the same record often comes twice, and would wait for itself.
void StripeEncoder::count() noexcept {
  counts_ = {};
  std::array<std::uint32_t, kRecords> odd{};
  std::size_t i = 0;
  for (; i + 1 < recorded_; i += 2) ++counts_[records_[i]], ++odd[records_[i + 1]];
  if (i < recorded_) ++counts_[records_[i]];
  for (i = 0; i < kRecords; ++i) counts_[i] += odd[i];
}

void StripeEncoder::write_tables(BitWriter& head) noexcept {
  RansCounts counts;
  RansTable table;
  for (std::size_t first = 0; first < kDecisions; first += kRansSymbols) {
    std::copy_n(counts_.begin() + static_cast<std::ptrdiff_t>(first), kRansSymbols, counts.begin());
    const bool used = std::any_of(counts.begin(), counts.end(), [](auto n) { return n > 0; });
    head.put(used ? 1 : 0, 1);
    if (!used) continue;
    write_counts(counts, head);
    table.build(counts);
    for (std::size_t s = 0; s < kRansSymbols; ++s) {
      if (table.frequency[s] != 0) shares_[first + s] = {table.start[s], table.frequency[s]};
    }
  }
  for (std::size_t first = kDecisions; first < kRecords; first += 2) {
    const bool used = counts_[first] + counts_[first + 1] > 0;
    head.put(used ? 1 : 0, 1);
    if (!used) continue;
    const std::uint32_t zero = write_bit_model(counts_[first], counts_[first + 1], head);
    shares_[first] = {0, zero};
    shares_[first + 1] = {zero, (1U << kRansBits) - zero};
  }
}

bool StripeEncoder::assemble(std::size_t raw_bytes) noexcept {
  std::uint8_t* const body = out_.data() + kStripeOverhead;
  BitWriter head({body, out_.size() - kStripeOverhead});
  write_tables(head);
  const std::size_t head_bytes = head.finish();
  RansWriter w(rans_);
  for (std::size_t i = recorded_; i-- > 0;) w.put(shares_[records_[i]]);
  const std::size_t rans_bytes = w.finish();
  if (w.full() || head.full() || head_bytes > 0xffff || raw_bytes > 0xffffff) return false;
  size_ = kStripeOverhead + head_bytes + raw_bytes + rans_bytes;
  if (size_ > out_.size()) return false;
  std::memcpy(body + head_bytes, raw_.data(), raw_bytes);
  std::memcpy(body + head_bytes + raw_bytes, rans_.data() + rans_.size() - rans_bytes, rans_bytes);
  const std::size_t sizes = head_bytes | raw_bytes << 16U;
  out_[0] = 1;
  for (unsigned i = 0; i < 5; ++i) out_[1 + i] = static_cast<std::uint8_t>(sizes >> (8 * i));
  return true;
}

void StripeEncoder::plain(const StripeShape& shape, const std::uint16_t* points) noexcept {
  std::uint8_t* to = out_.data();
  *to++ = 0;
  for (int y = 0; y < shape.used_rows; ++y) {
    for (int x = 0; x < shape.used_width; ++x) {
      const std::uint16_t v = points[y * shape.width + x];
      *to++ = static_cast<std::uint8_t>(v);
      *to++ = static_cast<std::uint8_t>(v >> 8U);
    }
  }
  size_ = shape.plain_bytes();
}

}  // namespace drivers::codec
