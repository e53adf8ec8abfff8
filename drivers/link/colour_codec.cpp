#include "drivers/link/colour_codec.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "drivers/codec/colour_mask.hpp"
#include "perception/geometry/no_colour.hpp"

namespace drivers {

using perception::ImageView;
using perception::Rgb;
using perception::RgbdFrame;

void ColourCodecConfig::describe(config::Section& s) {
  s.integer("quality", quality, 1, 100, "of the JPEG pictures");
  s.flag("half", half, "half the width and height");
}

struct ColourCodec::State {
  ColourCodecConfig config;
  cv::Mat bgr;  // of the largest image
  cv::Mat decoded;
  std::vector<std::uint8_t> jpeg;
  std::vector<int> params;
  std::array<std::uint8_t, kMostColourMaskBytes> mask;
};

ColourCodec::ColourCodec(rt::NonRealtime&, const ColourCodecConfig& config)
    : state_(std::make_unique<State>()) {
  cv::setNumThreads(0);  // no pool of OpenCV's beside the tasks
  state_->config = config;
  state_->bgr.create(RgbdFrame::kMaxHeight, RgbdFrame::kMaxWidth, CV_8UC3);
  state_->jpeg.reserve(RgbdFrame::kMaxPixels);
  state_->params = {cv::IMWRITE_JPEG_QUALITY,     config.quality,
                    cv::IMWRITE_JPEG_OPTIMIZE,    0,
                    cv::IMWRITE_JPEG_PROGRESSIVE, 0};
  // The first use makes OpenCV set up its list of formats (GDAL among them: locks, milliseconds).
  // Here, not in the first job.
  std::vector<Rgb> small(64);
  std::vector<std::uint8_t> jpeg(4096);
  const std::size_t size = encode({small.data(), 8, 8, 8}, jpeg);
  if (size == 0 || !decode({jpeg.data(), size}, {small.data(), 8, 8, 8})) {
    throw std::runtime_error("colour codec: OpenCV can not code a JPEG picture");
  }
}

ColourCodec::~ColourCodec() = default;

namespace {

// Mean of 2 x 2 pixels; a last odd row or column stands for itself.
void shrink(ImageView<const Rgb> in, cv::Mat& out) noexcept {
  for (int v = 0; v < out.rows; ++v) {
    const Rgb *a = in.row(2 * v), *b = in.row(std::min(2 * v + 1, in.height - 1));
    auto* to = out.ptr<cv::Vec3b>(v);
    for (int u = 0; u < out.cols; ++u) {
      const int l = 2 * u, r = std::min(2 * u + 1, in.width - 1);
      const auto mean = [&](std::uint8_t Rgb::*c) {
        return static_cast<std::uint8_t>((a[l].*c + a[r].*c + b[l].*c + b[r].*c + 2) / 4);
      };
      to[u] = {mean(&Rgb::b), mean(&Rgb::g), mean(&Rgb::r)};
    }
  }
}

// The same where pixels may lack colour: of those that have it; else what was there last.
void shrink_lacking(ImageView<const Rgb> in, cv::Mat& out) noexcept {
  cv::Vec3b last(128, 128, 128);
  for (int v = 0; v < out.rows; ++v) {
    const Rgb *a = in.row(2 * v), *b = in.row(std::min(2 * v + 1, in.height - 1));
    auto* to = out.ptr<cv::Vec3b>(v);
    for (int u = 0; u < out.cols; ++u) {
      const int l = 2 * u, r = std::min(2 * u + 1, in.width - 1);
      int sum[3] = {0, 0, 0}, n = 0;
      for (const Rgb& c : {a[l], a[r], b[l], b[r]}) {
        sum[0] += c.b, sum[1] += c.g, sum[2] += c.r;
        n += perception::has_colour(c) ? 1 : 0;
      }
      for (int c = 0; n > 0 && c < 3; ++c)
        last[c] = static_cast<std::uint8_t>((sum[c] + n / 2) / n);
      to[u] = last;
    }
  }
}

void copy_lacking(ImageView<const Rgb> in, cv::Mat& out) noexcept {
  cv::Vec3b last(128, 128, 128);
  for (int v = 0; v < out.rows; ++v) {
    const Rgb* from = in.row(v);
    auto* to = out.ptr<cv::Vec3b>(v);
    for (int u = 0; u < out.cols; ++u) {
      if (perception::has_colour(from[u])) last = {from[u].b, from[u].g, from[u].r};
      to[u] = last;
    }
  }
}

void copy_in(ImageView<const Rgb> in, cv::Mat& out) noexcept {
  for (int v = 0; v < out.rows; ++v) {
    const Rgb* from = in.row(v);
    auto* to = out.ptr<cv::Vec3b>(v);
    for (int u = 0; u < out.cols; ++u) to[u] = {from[u].b, from[u].g, from[u].r};
  }
}

// Bilinear by two: each pixel is 9/16 of its own cell, 3/16 of two neighbours, 1/16 of the corner. First across the
// rows, then along: sums of whole numbers, so the order changes no byte.
void grow(const cv::Mat& in, ImageView<Rgb> out) noexcept {
  constexpr int kMost = (RgbdFrame::kMaxWidth + 1) / 2;
  std::array<std::uint16_t, static_cast<std::size_t>(3 * (kMost + 2))>
      across;  // a cell beyond each end
  const int cells = in.cols;
  for (int v = 0; v < out.height; ++v) {
    const int y = v / 2, other_y = std::clamp(v % 2 == 0 ? y - 1 : y + 1, 0, in.rows - 1);
    const auto *a = in.ptr<std::uint8_t>(y), *b = in.ptr<std::uint8_t>(other_y);
    std::uint16_t* const mid = across.data() + 3;
    for (int i = 0; i < 3 * cells; ++i) mid[i] = static_cast<std::uint16_t>(3 * a[i] + b[i]);
    for (int c = 0; c < 3; ++c) {
      mid[c - 3] = mid[c];
      mid[3 * cells + c] = mid[3 * (cells - 1) + c];
    }
    const auto blend = [](const std::uint16_t* own, const std::uint16_t* other) {
      const auto of = [&](int c) {
        return static_cast<std::uint8_t>((3 * own[c] + other[c] + 8) / 16);
      };
      return Rgb{of(2), of(1), of(0)};
    };
    Rgb* to = out.row(v);
    for (int x = 0; x < cells; ++x) {
      const std::uint16_t* own = mid + 3 * x;
      to[2 * x] = blend(own, own - 3);
      if (2 * x + 1 < out.width) to[2 * x + 1] = blend(own, own + 3);
    }
  }
}

void copy_out(const cv::Mat& in, ImageView<Rgb> out) noexcept {
  for (int v = 0; v < out.height; ++v) {
    const auto* from = in.ptr<cv::Vec3b>(v);
    Rgb* to = out.row(v);
    for (int u = 0; u < out.width; ++u) to[u] = {from[u][2], from[u][1], from[u][0]};
  }
}

}  // namespace

std::size_t ColourCodec::encode(ImageView<const Rgb> image, std::span<std::uint8_t> out,
                                std::span<const std::uint16_t> depth_mm) noexcept {
  if (image.width < 1 || image.height < 1 || image.width > RgbdFrame::kMaxWidth ||
      image.height > RgbdFrame::kMaxHeight) {
    return 0;
  }
  State& s = *state_;
  const bool half = s.config.half;
  const std::size_t mask = write_colour_mask(image, depth_mm, s.mask);
  try {
    cv::Mat bgr = s.bgr(cv::Rect(0, 0, half ? (image.width + 1) / 2 : image.width,
                                 half ? (image.height + 1) / 2 : image.height));
    if (mask > 0)
      half ? shrink_lacking(image, bgr) : copy_lacking(image, bgr);
    else
      half ? shrink(image, bgr) : copy_in(image, bgr);
    if (!cv::imencode(".jpg", bgr, s.jpeg, s.params) || s.jpeg.size() + mask > out.size()) return 0;
  } catch (...) {  // OpenCV's exceptions, bad_alloc: the frame goes without colour
    return 0;
  }
  // The mask comes first behind the marker that begins every JPEG.
  const auto rest = std::copy_n(s.jpeg.begin(), 2, out.begin());
  std::copy(s.jpeg.begin() + 2, s.jpeg.end(), std::copy_n(s.mask.begin(), mask, rest));
  return s.jpeg.size() + mask;
}

bool ColourCodec::decode(std::span<const std::uint8_t> in, ImageView<Rgb> image,
                         std::span<const std::uint16_t> depth_mm) noexcept {
  const JpegSize size = jpeg_size(in);
  const bool full = size.width == image.width && size.height == image.height;
  const bool half = size.width == (image.width + 1) / 2 && size.height == (image.height + 1) / 2;
  if ((!full && !half) || image.width > RgbdFrame::kMaxWidth) return false;
  try {
    const cv::Mat raw(1, static_cast<int>(in.size()), CV_8U, const_cast<std::uint8_t*>(in.data()));
    cv::Mat& bgr = state_->decoded;
    cv::imdecode(raw, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, &bgr);
    if (bgr.type() != CV_8UC3 || bgr.cols != size.width || bgr.rows != size.height) return false;
    full ? copy_out(bgr, image) : grow(bgr, image);
  } catch (...) {
    return false;
  }
  for (int v = 0; v < image.height; ++v)
    if (perception::may_lack_colour(image.row(v), image.width))
      perception::lift_black({image.row(v), image.width, 1, image.width});
  return apply_colour_mask(in, depth_mm, image);
}

JpegSize jpeg_size(std::span<const std::uint8_t> in) noexcept {
  if (in.size() < 4 || in[0] != 0xff || in[1] != 0xd8) return {};
  JpegSize size;
  std::size_t at = 2;
  while (at + 4 <= in.size()) {
    if (in[at] != 0xff) return {};
    const std::uint8_t marker = in[at + 1];
    const std::size_t length = static_cast<std::size_t>(in[at + 2] << 8U | in[at + 3]);
    if (length < 2 || at + 2 + length > in.size()) return {};
    if (marker == 0xda) return size;  // the scan begins
    const bool table = marker == 0xdb || marker == 0xc4 || marker == 0xdd || marker == 0xfe ||
                       (marker >= 0xe0 && marker <= 0xef);
    if (marker == 0xc0) {  // baseline frame, once, three components or one, 8 bit
      if (size.width != 0 || length < 11 || in[at + 4] != 8) return {};
      size.height = in[at + 5] << 8U | in[at + 6];
      size.width = in[at + 7] << 8U | in[at + 8];
      const int components = in[at + 9];
      if (size.width == 0 || size.height == 0 || (components != 1 && components != 3)) return {};
    } else if (!table) {
      return {};
    }
    at += 2 + length;
  }
  return {};
}

}  // namespace drivers
