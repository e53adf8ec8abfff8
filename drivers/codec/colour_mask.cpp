#include "drivers/codec/colour_mask.hpp"

#include <algorithm>
#include <array>

#include "perception/geometry/no_colour.hpp"

namespace drivers {

using perception::ImageView;
using perception::kNoColour;
using perception::Rgb;

namespace {

constexpr std::array<std::uint8_t, 4> kTag{'T', 'N', 'C', '1'};
constexpr std::size_t kHead = 9;  // marker, length, tag, form
constexpr std::uint8_t kRuns = 1, kBits = 2;

std::size_t pixels_of(int width, int height) noexcept {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

// odd(n): pixel n is not as expected.
template <class Odd>
std::size_t write_runs(std::size_t pixels, const Odd& odd, std::span<std::uint8_t> out) noexcept {
  std::size_t at = 0;
  bool now = false;
  for (std::size_t n = 0; n < pixels; now = !now) {
    const std::size_t first = n;
    while (n < pixels && odd(n) == now) ++n;
    std::size_t run = n - first;
    do {
      if (at == out.size()) return 0;
      out[at++] = static_cast<std::uint8_t>((run & 0x7fU) | (run > 0x7fU ? 0x80U : 0U));
      run >>= 7U;
    } while (run > 0);
  }
  return at;
}

// mark(first, end) for each run that is not as expected.
template <class Mark>
bool read_runs(std::span<const std::uint8_t> in, std::size_t pixels, const Mark& mark) noexcept {
  std::size_t n = 0, at = 0;
  for (bool odd = false; n < pixels; odd = !odd) {
    std::size_t run = 0;
    for (unsigned shift = 0;; shift += 7) {
      if (at == in.size() || shift > 21) return false;
      run |= std::size_t{in[at] & 0x7fU} << shift;
      if ((in[at++] & 0x80U) == 0) break;
    }
    if (run > pixels - n || (run == 0 && n > 0)) return false;
    if (odd) mark(n, n + run);
    n += run;
  }
  return at == in.size();
}

// The segment's bytes from its form on; empty: there is none.
std::span<const std::uint8_t> find_mask(std::span<const std::uint8_t> jpeg) noexcept {
  std::size_t at = 2;
  while (at + 4 <= jpeg.size() && jpeg[at] == 0xff && jpeg[at + 1] != 0xda) {
    const std::size_t length = static_cast<std::size_t>(jpeg[at + 2] << 8U | jpeg[at + 3]);
    if (length < 2 || at + 2 + length > jpeg.size()) return {};
    const auto body = jpeg.subspan(at + 4, length - 2);
    if (jpeg[at + 1] == 0xfe && body.size() > kTag.size() &&
        std::equal(kTag.begin(), kTag.end(), body.begin()))
      return body.subspan(kTag.size());
    at += 2 + length;
  }
  return {};
}

}  // namespace

std::size_t write_colour_mask(ImageView<const Rgb> image, std::span<const std::uint16_t> depth_mm,
                              std::span<std::uint8_t, kMostColourMaskBytes> out) noexcept {
  bool lacks = false;
  for (int v = 0; v < image.height && !lacks; ++v) {
    const Rgb* row = image.row(v);
    lacks = perception::may_lack_colour(row, image.width) &&
            std::find(row, row + image.width, kNoColour) != row + image.width;
  }
  if (!lacks) return 0;
  const std::size_t pixels = pixels_of(image.width, image.height);
  const auto width = static_cast<std::size_t>(image.width);
  const auto odd = [&](std::size_t n) {
    const bool reading = depth_mm.empty() || depth_mm[n] != 0;
    return perception::has_colour(image.row(static_cast<int>(n / width))[n % width]) != reading;
  };
  const std::size_t as_bits = (pixels + 7) / 8;
  std::size_t size = write_runs(pixels, odd, out.subspan(kHead, as_bits));
  out[8] = kRuns;
  if (size == 0) {
    out[8] = kBits;
    size = as_bits;
    std::fill_n(out.begin() + kHead, size, std::uint8_t{0});
    for (std::size_t n = 0; n < pixels; ++n)
      if (odd(n)) out[kHead + n / 8] |= static_cast<std::uint8_t>(1U << (n % 8));
  }
  size += kHead;
  out[0] = 0xff, out[1] = 0xfe;
  out[2] = static_cast<std::uint8_t>((size - 2) >> 8U);
  out[3] = static_cast<std::uint8_t>(size - 2);
  std::copy(kTag.begin(), kTag.end(), out.begin() + 4);
  return size;
}

bool apply_colour_mask(std::span<const std::uint8_t> jpeg, std::span<const std::uint16_t> depth_mm,
                       ImageView<Rgb> image) noexcept {
  const std::span<const std::uint8_t> mask = find_mask(jpeg);
  if (mask.empty()) return true;
  const std::size_t pixels = pixels_of(image.width, image.height);
  const auto width = static_cast<std::size_t>(image.width);
  const auto body = mask.subspan(1);
  const auto reading = [&](std::size_t n) { return depth_mm.empty() || depth_mm[n] != 0; };
  const auto at = [&](std::size_t n) -> Rgb& {
    return image.row(static_cast<int>(n / width))[n % width];
  };
  if (mask[0] == kRuns) {
    std::size_t done = 0;  // up to here pixels are as they are to be
    const auto settle = [&](std::size_t end, bool odd) {
      for (; done < end; ++done)
        if (reading(done) == odd) at(done) = kNoColour;
    };
    const bool good = read_runs(body, pixels, [&](std::size_t first, std::size_t end) {
      settle(first, false);
      settle(end, true);
    });
    if (good) settle(pixels, false);
    return good;
  }
  if (mask[0] != kBits || body.size() != (pixels + 7) / 8) return false;
  if (pixels % 8 != 0 && (body.back() >> (pixels % 8)) != 0) return false;
  for (std::size_t n = 0; n < pixels; ++n)
    if (reading(n) == (((body[n / 8] >> (n % 8)) & 1U) != 0)) at(n) = kNoColour;
  return true;
}

}  // namespace drivers
