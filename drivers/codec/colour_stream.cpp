#include "drivers/codec/colour_stream.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <vector>

#include "drivers/codec/colour_engine.hpp"
#include "drivers/codec/colour_mask.hpp"
#include "drivers/codec/colour_picture.hpp"
#include "perception/geometry/no_colour.hpp"
#include "rt/hash.hpp"

namespace drivers {

using perception::ImageView;
using perception::Rgb;
using perception::RgbdFrame;

void ColourStreamConfig::describe(config::Section& s) {
  s.text("method", method, {"jpeg", "h264"}, "how colour is coded");
  s.flag("half", half, "half the width and height");
  s.integer("fps", fps, 1, 120, "of h264: frames a second that its rate is spread over");
  s.integer("finest", finest, 0, 51, "of h264: least quantizer, 0: no limit");
}

const char* to_text(ColourStatus s) noexcept {
  constexpr std::array kTexts{"ok", "bad size", "no room", "failed", "damaged", "needs a key"};
  const auto at = static_cast<std::size_t>(s);
  return at < kTexts.size() ? kTexts[at] : "?";
}

namespace {

constexpr std::uint8_t kKey = 1, kHalf = 2;
constexpr std::size_t kCheckAt = 16;
// A mask segment is looked for behind the marker that begins a JPEG.
constexpr std::array<std::uint8_t, 2> kBegin{0xff, 0xd8};

template <class T>
void put(std::uint8_t* at, T value) noexcept {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    at[i] = static_cast<std::uint8_t>(std::uint64_t{value} >> (8 * i));
}
template <class T>
T get(const std::uint8_t* at) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{at[i]} << (8 * i);
  return static_cast<T>(value);
}

std::uint64_t check_of(std::span<const std::uint8_t> picture) noexcept {
  rt::Hash64 hash;
  hash.bytes(picture.data(), kCheckAt);
  hash.bytes(picture.data() + kColourHeader, picture.size() - kColourHeader);
  return hash.digest();
}

bool fits(int width, int height) noexcept {
  return width >= 1 && height >= 1 && width <= RgbdFrame::kMaxWidth &&
         height <= RgbdFrame::kMaxHeight;
}

ImageView<Rgb> of_size(std::vector<Rgb>& pixels, int width, int height) noexcept {
  return {pixels.data(), width, height, width};
}

class FramedEncoder : public ColourEncoder {
 public:
  FramedEncoder(const ColourStreamConfig& config, int width, int height)
      : method_(config.method == "h264" ? ColourMethod::kH264 : ColourMethod::kJpeg),
        half_(config.half),
        picture_(RgbdFrame::kMaxPixels) {
    if (!fits(width, height))
      throw std::runtime_error("colour codec: images of " + std::to_string(width) + " x " +
                               std::to_string(height) + ": must be 1 x 1 to 640 x 480");
    engine_ = method_ == ColourMethod::kJpeg
                  ? make_jpeg_encoder()
                  : make_h264_encoder(config, scaled(width), scaled(height));
    if (!engine_)
      throw std::runtime_error("codec.colour.method = \"h264\": not built in (TELETACT_H264)");
  }

  Coded encode(ImageView<const Rgb> image, std::span<const std::uint16_t> depth_mm,
               const ColourDemand& demand, std::span<std::uint8_t> out) noexcept override {
    if (!fits(image.width, image.height)) return {ColourStatus::kBadSize};
    const std::size_t mask = write_colour_mask(image, depth_mm, mask_);
    if (out.size() < kColourHeader + mask) return {ColourStatus::kNoRoom};
    const auto picture = of_size(picture_, scaled(image.width), scaled(image.height));
    half_ ? halve_colour(image, picture) : fill_colour(image, picture);
    const ColourDemand within{std::clamp(demand.quality, 1, 100),
                              std::clamp(demand.rate_kbit_s, 100, 20000),
                              demand.key || chain_broken_};
    const auto room = out.first(std::min(out.size(), kMostColourBytes));
    Coded coded = engine_->encode(picture, within, room.subspan(kColourHeader + mask));
    chain_broken_ = coded.status != ColourStatus::kOk;
    if (chain_broken_) return {coded.status};
    step_ = coded.key ? 0 : static_cast<std::uint8_t>(step_ + 1);
    std::uint8_t* at = out.data();
    at[0] = 'C', at[1] = static_cast<std::uint8_t>(method_);
    at[2] = static_cast<std::uint8_t>((coded.key ? kKey : 0) | (half_ ? kHalf : 0));
    at[3] = step_;
    put(at + 4, static_cast<std::uint16_t>(image.width));
    put(at + 6, static_cast<std::uint16_t>(image.height));
    put(at + 8, static_cast<std::uint32_t>(mask));
    put(at + 12, static_cast<std::uint32_t>(coded.bytes));
    std::copy_n(mask_.begin(), mask, at + kColourHeader);
    coded.bytes += kColourHeader + mask;
    seal_colour(out.first(coded.bytes));
    return coded;
  }

 private:
  [[nodiscard]] int scaled(int pixels) const noexcept { return half_ ? (pixels + 1) / 2 : pixels; }
  ColourMethod method_;
  bool half_, chain_broken_ = false;
  std::uint8_t step_ = 0;
  std::unique_ptr<ColourEncodeEngine> engine_;
  std::vector<Rgb> picture_;
  std::array<std::uint8_t, kMostColourMaskBytes> mask_;
};

}  // namespace

void seal_colour(std::span<std::uint8_t> picture) noexcept {
  if (picture.size() >= kColourHeader) put(picture.data() + kCheckAt, check_of(picture));
}

std::unique_ptr<ColourEncoder> make_colour_encoder(rt::NonRealtime&,
                                                   const ColourStreamConfig& config, int width,
                                                   int height) {
  return std::make_unique<FramedEncoder>(config, width, height);
}

struct ColourDecoder::State {
  std::unique_ptr<ColourDecodeEngine> jpeg = make_jpeg_decoder(), h264;
  std::vector<Rgb> small = std::vector<Rgb>(RgbdFrame::kMaxPixels);
  std::vector<std::uint8_t> mask;
  bool whole = false;  // nothing is missing since the last key
  std::uint8_t step = 0;

  explicit State(bool with_h264) {
    if (with_h264) h264 = make_h264_decoder();
    mask.reserve(kBegin.size() + kMostColourMaskBytes);
  }
  [[nodiscard]] ColourStatus payload(std::span<const std::uint8_t> in, std::size_t mask_bytes,
                                     ImageView<Rgb> image) noexcept;
};

ColourDecoder::ColourDecoder(rt::NonRealtime&, bool with_h264)
    : state_(std::make_unique<State>(with_h264)) {}
ColourDecoder::~ColourDecoder() = default;

ColourStatus ColourDecoder::State::payload(std::span<const std::uint8_t> in, std::size_t mask_bytes,
                                           ImageView<Rgb> image) noexcept {
  const bool key = (in[2] & kKey) != 0, half = (in[2] & kHalf) != 0;
  const bool chained = in[1] == static_cast<std::uint8_t>(ColourMethod::kH264);
  ColourDecodeEngine* engine = chained ? h264.get() : jpeg.get();
  if (engine == nullptr) return ColourStatus::kFailed;
  if (chained && !key && (!whole || in[3] != static_cast<std::uint8_t>(step + 1))) {
    whole = false;
    return ColourStatus::kNeedsKey;
  }
  const auto picture = half ? of_size(small, (image.width + 1) / 2, (image.height + 1) / 2) : image;
  const bool good = engine->decode(in.subspan(kColourHeader + mask_bytes), key, picture);
  if (chained) whole = good, step = in[3];
  if (!good) return ColourStatus::kDamaged;
  if (half) grow_colour(picture, image);
  return ColourStatus::kOk;
}

ColourStatus ColourDecoder::decode(std::span<const std::uint8_t> in,
                                   std::span<const std::uint16_t> depth_mm,
                                   ImageView<Rgb> image) noexcept {
  State& s = *state_;
  const auto damaged = [&] {
    s.whole = false;  // it may have been any picture
    return ColourStatus::kDamaged;
  };
  if (!fits(image.width, image.height) ||
      (!depth_mm.empty() && depth_mm.size() != static_cast<std::size_t>(image.width) *
                                                   static_cast<std::size_t>(image.height)))
    return ColourStatus::kBadSize;
  if (in.size() < kColourHeader || in.size() > kMostColourBytes || in[0] != 'C' ||
      (in[1] != 1 && in[1] != 2) || in[2] > (kKey | kHalf))
    return damaged();
  const auto mask_bytes = get<std::uint32_t>(in.data() + 8),
             payload_bytes = get<std::uint32_t>(in.data() + 12);
  if (std::uint64_t{mask_bytes} + payload_bytes + kColourHeader != in.size() ||
      mask_bytes > kMostColourMaskBytes || get<std::uint64_t>(in.data() + kCheckAt) != check_of(in))
    return damaged();
  if (get<std::uint16_t>(in.data() + 4) != image.width ||
      get<std::uint16_t>(in.data() + 6) != image.height) {
    s.whole = false;
    return ColourStatus::kBadSize;
  }
  const ColourStatus status = s.payload(in, mask_bytes, image);
  if (status != ColourStatus::kOk) return status;
  for (int v = 0; v < image.height; ++v)
    if (perception::may_lack_colour(image.row(v), image.width))
      perception::lift_black({image.row(v), image.width, 1, image.width});
  if (mask_bytes == 0) return ColourStatus::kOk;
  s.mask.assign(kBegin.begin(), kBegin.end());
  s.mask.insert(s.mask.end(), in.begin() + kColourHeader, in.begin() + kColourHeader + mask_bytes);
  return apply_colour_mask(s.mask, depth_mm, image) ? ColourStatus::kOk : ColourStatus::kDamaged;
}

}  // namespace drivers
