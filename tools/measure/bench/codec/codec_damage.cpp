// Damaged frames of the link's codecs.
#include <algorithm>
#include <cstring>
#include <memory>

#include "drivers/codec/colour_stream.hpp"
#include "drivers/codec/depth_frame.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/hash.hpp"
#include "rt/random.hpp"
#include "tools/measure/bench/codec/codec_bench.hpp"

namespace teletact {

using drivers::ColourStatus;
using drivers::DepthStatus;
using perception::RgbdFrame;
using Bytes = std::vector<std::uint8_t>;

namespace {

// Bits, a number, a part cut out or doubled, an end cut off.
Bytes damaged(const Bytes& good, rt::Random& random) {
  Bytes bad = good;
  const auto at = [&] {
    return static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(bad.size()) - 1));
  };
  for (auto times = random.integer(1, 3); times > 0 && bad.size() > 1; --times) {
    const std::size_t i = at(), j = at(), first = std::min(i, j), last = std::max(i, j);
    const auto offset = [](std::size_t n) { return static_cast<std::ptrdiff_t>(n); };
    switch (random.integer(0, 5)) {
      case 0:
        bad.resize(i);
        break;
      case 1:
        bad.erase(bad.begin() + offset(first), bad.begin() + offset(last));
        break;
      case 2:
        std::copy(bad.begin() + offset(first), bad.begin() + offset(last), bad.begin());
        break;
      case 3:
        bad[i] = static_cast<std::uint8_t>(random());
        break;
      default:
        bad[i] ^= static_cast<std::uint8_t>(1U << random.integer(0, 7));
    }
  }
  return bad;
}

// The check as the encoder would have made it, where the header can be read at all.
void seal_depth(Bytes& frame, std::uint64_t check_before) {
  namespace codec = drivers::codec;
  constexpr std::size_t kCheckAt = drivers::kDepthFrameHeader - 8;
  codec::DepthFrameHeader h;
  if (frame.size() < drivers::kDepthFrameHeader || codec::read_header(frame, h) != DepthStatus::kOk)
    return;
  const std::uint64_t check = codec::check_of(h, check_before, frame);
  for (std::size_t i = 0; i < 8; ++i)
    frame[kCheckAt + i] = static_cast<std::uint8_t>(check >> (8 * i));
}

std::uint64_t hash_of(const void* data, std::size_t bytes) {
  rt::Hash64 hash;
  hash.bytes(data, bytes);
  return hash.digest();
}

// `decode` gives whether the bytes were taken; `good_again` whether a good key decodes as ever.
template <class Seal, class Decode, class GoodAgain>
CodecDamage damage(const char* name, const std::vector<Bytes>& good, int frames, rt::Random random,
                   const Seal& seal, const Decode& decode, const GoodAgain& good_again) {
  CodecDamage result;
  result.name = name;
  for (int n = 0; n < frames; ++n) {
    const Bytes& original = good[static_cast<std::size_t>(n) % good.size()];
    Bytes bad = damaged(original, random);
    if (bad == original) continue;
    const bool sealed = n % 4 >= 2;
    if (sealed) seal(bad);
    if (!good_again()) ++result.wrong;
    const std::int64_t before = rt::thread_cpu_ns();
    const bool taken = decode(bad);
    result.worst_ms =
        std::max(result.worst_ms, 1e-6 * static_cast<double>(rt::thread_cpu_ns() - before));
    ++result.frames;
    ++(taken ? result.decoded : result.refused);
    if (taken && !sealed && bad != original) ++result.wrong;
  }
  if (!good_again()) ++result.wrong;
  return result;
}

// Small images: a damaged one takes no longer to find than a large one.
constexpr int kWidth = 128, kHeight = 104;

std::unique_ptr<RgbdFrame> cut_out(const CodecFilm& film, int i) {
  auto whole = std::make_unique<RgbdFrame>(), part = std::make_unique<RgbdFrame>();
  film.sensor.frame(i, *whole);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const auto n = static_cast<std::size_t>(v * kWidth + u);
      part->depth_mm[n] = whole->depth().at(u + 190, v + 160);
      part->colour[n] = whole->rgb().at(u + 190, v + 160);
    }
  }
  return part;
}

CodecDamage damage_depth(rt::NonRealtime& nrt, const CodecFilm& film, drivers::DepthMode mode,
                         int frames, std::uint64_t seed) {
  constexpr auto kPixels = static_cast<std::size_t>(kWidth * kHeight);
  const drivers::DepthStreamConfig config{kWidth, kHeight, drivers::DepthNoiseLaw::kStrict};
  drivers::DepthEncoder encoder(nrt, config);
  drivers::DepthDecoder decoder(nrt, config);
  std::vector<Bytes> good;
  std::vector<std::uint16_t> image(kPixels);
  drivers::DepthFrameInfo info;
  for (int i = 0; i < 2; ++i) {
    Bytes bytes(drivers::max_depth_frame_bytes(kPixels));
    const auto frame = cut_out(film, i);
    static_cast<void>(
        encoder.encode({frame->depth_mm.data(), kPixels}, {mode, -1, false}, bytes, info));
    bytes.resize(info.bytes);
    good.push_back(bytes);
  }
  std::uint64_t check_before = 0;
  for (std::size_t i = 8; i > 0; --i)
    check_before = check_before << 8U | good[0][drivers::kDepthFrameHeader - 9 + i];
  static_cast<void>(decoder.decode(good[0], image, info));
  const std::uint64_t first = hash_of(image.data(), 2 * kPixels);
  return damage(
      to_text(mode), good, frames, rt::Random(seed, 74),
      [&](Bytes& bad) { seal_depth(bad, check_before); },
      [&](const Bytes& bad) { return decoder.decode(bad, image, info) == DepthStatus::kOk; },
      [&] {
        return decoder.decode(good[0], image, info) == DepthStatus::kOk &&
               hash_of(image.data(), 2 * kPixels) == first;
      });
}

CodecDamage damage_colour(rt::NonRealtime& nrt, const CodecFilm& film, const char* method,
                          int frames, std::uint64_t seed) {
  drivers::ColourStreamConfig config;
  config.method = method;
  const auto encoder = make_colour_encoder(nrt, config, kWidth, kHeight);
  drivers::ColourDecoder decoder(nrt);
  std::vector<Bytes> good;
  auto image = std::make_unique<RgbdFrame>();
  const perception::ImageView<perception::Rgb> view{image->colour.data(), kWidth, kHeight, kWidth};
  for (int i = 0; i < 2; ++i) {
    auto frame = cut_out(film, i);
    Bytes bytes(drivers::kMostColourBytes);
    bytes.resize(
        encoder->encode({frame->colour.data(), kWidth, kHeight, kWidth}, {}, {}, bytes).bytes);
    good.push_back(bytes);
  }
  constexpr std::size_t kBytes = 3 * std::size_t{kWidth} * kHeight;
  static_cast<void>(decoder.decode(good[0], {}, view));
  const std::uint64_t first = hash_of(view.data, kBytes);
  return damage(
      method, good, frames, rt::Random(seed, 75), [](Bytes& bad) { drivers::seal_colour(bad); },
      [&](const Bytes& bad) { return decoder.decode(bad, {}, view) == ColourStatus::kOk; },
      [&] {
        return decoder.decode(good[0], {}, view) == ColourStatus::kOk &&
               hash_of(view.data, kBytes) == first;
      });
}

}  // namespace

std::vector<CodecDamage> damage_codecs(rt::NonRealtime& nrt, const CodecFilm& film, int frames,
                                       std::uint64_t seed) {
  std::vector<CodecDamage> all;
  for (const auto mode : {drivers::DepthMode::kLossless, drivers::DepthMode::kFaithful,
                          drivers::DepthMode::kQuiet, drivers::DepthMode::kMoving})
    all.push_back(damage_depth(nrt, film, mode, frames, seed));
  all.push_back(damage_colour(nrt, film, "jpeg", frames, seed));
  if (drivers::h264_built_in()) all.push_back(damage_colour(nrt, film, "h264", frames, seed));
  return all;
}

}  // namespace teletact
