#include "drivers/codec/depth_stripe.hpp"

namespace drivers::codec {

class StripeDecoder::Io {
 public:
  Io(const StripeDecoder& from, const StepScale& scale, RansReader& rans, BitReader& raw) noexcept
      : from_(from), scale_(scale), rans_(rans), raw_(raw) {}

  [[nodiscard]] unsigned kind(int context, int) noexcept { return rans_.get(table(context)); }
  [[nodiscard]] bool valid(int context, int) noexcept {
    return rans_.bit(from_.zero_[static_cast<std::size_t>(context)]);
  }
  [[nodiscard]] Coded spatial(int context, int, int prediction) noexcept {
    const unsigned s = rans_.get(table(context));
    bad_ |= s == kSwitch;
    return value(s, prediction);
  }
  template <class InSpace>
  [[nodiscard]] Coded temporal(int context, int pixel, int before,
                               const InSpace& in_space) noexcept {
    const unsigned s = rans_.get(table(context));
    if (s == kSwitch) return spatial(kAloneContext, pixel, in_space());
    return value(s, before);
  }
  [[nodiscard]] bool bad() const noexcept { return bad_; }

 private:
  [[nodiscard]] const RansDecodeTable& table(int context) const noexcept {
    return from_.tables_[static_cast<std::size_t>(context)];
  }
  [[nodiscard]] Coded value(unsigned s, int prediction) noexcept {
    std::uint32_t v = s;
    if (s >= kDirect) {
      const unsigned length = 2 * (s - kDirect) + raw_.get(1);
      v = (1U << length) + raw_.get(length) - 1 + kDirect;
    }
    const int r = static_cast<int>(v >> 1U) ^ -static_cast<int>(v & 1U);
    return {scale_.value(prediction, r), std::min(std::abs(r), kMostSize)};
  }

  const StripeDecoder& from_;
  StepScale scale_;
  RansReader& rans_;
  BitReader& raw_;
  bool bad_ = false;
};

StripeDecoder::StripeDecoder(const StripeShape& most) : rows_(most.width), tables_(kContexts) {}

bool StripeDecoder::read_tables(BitReader& in) noexcept {
  static constexpr RansCounts kUnused{1};
  for (RansDecodeTable& t : tables_) {
    RansCounts counts = kUnused;
    if (in.get(1) != 0 && !read_counts(counts, in)) return false;
    t.build(counts);
  }
  for (std::uint32_t& z : zero_) z = in.get(1) != 0 ? read_bit_model(in) : 1;
  return in.at_end();
}

bool StripeDecoder::decode(const StripeShape& shape, const StepScale& scale,
                           std::span<const std::uint8_t> in, std::uint16_t* points,
                           const std::uint8_t* history) noexcept {
  if (in.empty()) return false;
  if (in[0] == 0) {
    if (in.size() != shape.plain_bytes()) return false;
    const std::uint8_t* from = in.data() + 1;
    bool good = true;
    for (int y = 0; y < shape.used_rows; ++y) {
      for (int x = 0; x < shape.used_width; ++x, from += 2) {
        std::uint16_t& v = points[y * shape.width + x];
        v = static_cast<std::uint16_t>(from[0] | from[1] << 8U);
        good &= v <= scale.top;
      }
    }
    return good;
  }
  if (in[0] != 1 || in.size() < kStripeOverhead) return false;
  const std::size_t head = in[1] | static_cast<std::size_t>(in[2]) << 8U,
                    raw_bytes = in[3] | static_cast<std::size_t>(in[4]) << 8U |
                                static_cast<std::size_t>(in[5]) << 16U;
  in = in.subspan(kStripeOverhead);
  if (head + raw_bytes > in.size()) return false;
  BitReader tables(in.first(head)), raw(in.subspan(head, raw_bytes));
  RansReader rans;
  if (!read_tables(tables) || !rans.begin(in.subspan(head + raw_bytes))) return false;
  Io io(*this, scale, rans, raw);
  Walk<Io> walk(shape, rows_, io, points, history);
  return walk.run() && rans.at_end() && raw.at_end();
}

}  // namespace drivers::codec
