#include <algorithm>
#include <stdexcept>
#include <vector>

#include <turbojpeg.h>

#include "drivers/codec/colour_engine.hpp"

namespace drivers {

using perception::ImageView;
using perception::Rgb;

namespace {

struct Handle {
  tjhandle handle;
  explicit Handle(tjhandle h) : handle(h) {
    if (handle == nullptr) throw std::runtime_error("libturbojpeg can not be set up");
  }
  ~Handle() { tjDestroy(handle); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
};

class JpegEncoder : public ColourEncodeEngine {
 public:
  JpegEncoder()
      : buffer_(tjBufSize(perception::RgbdFrame::kMaxWidth, perception::RgbdFrame::kMaxHeight,
                          TJSAMP_420)) {}

  ColourEncoder::Coded encode(ImageView<const Rgb> picture, const ColourDemand& demand,
                              std::span<std::uint8_t> out) noexcept override {
    unsigned char* to = buffer_.data();
    unsigned long size = buffer_.size();
    if (tjCompress2(library_.handle, &picture.data->r, picture.width, 3 * picture.stride,
                    picture.height, TJPF_RGB, &to, &size, TJSAMP_420, demand.quality,
                    TJFLAG_NOREALLOC | TJFLAG_ACCURATEDCT) != 0)
      return {ColourStatus::kFailed};
    if (size > out.size()) return {ColourStatus::kNoRoom};
    std::copy_n(to, size, out.data());
    return {ColourStatus::kOk, size, true};
  }

 private:
  Handle library_{tjInitCompress()};
  std::vector<unsigned char> buffer_;
};

class JpegDecoder : public ColourDecodeEngine {
 public:
  JpegDecoder() : library_(std::make_unique<Handle>(tjInitDecompress())) {}

  bool decode(std::span<const std::uint8_t> payload, bool key,
              ImageView<Rgb> picture) noexcept override {
    if (!library_) renew();
    const bool good = library_ && key && !payload.empty() && try_decode(payload, picture);
    // What a damaged picture leaves behind in the library can spoil the next good one.
    if (!good) renew();
    return good;
  }

 private:
  [[nodiscard]] bool try_decode(std::span<const std::uint8_t> payload,
                                ImageView<Rgb> picture) noexcept {
    // Its own size is looked at before anything is allocated for it.
    int width = 0, height = 0, sampling = 0, space = 0;
    if (tjDecompressHeader3(library_->handle, payload.data(), payload.size(), &width, &height,
                            &sampling, &space) != 0 ||
        width != picture.width || height != picture.height ||
        (space != TJCS_YCbCr && space != TJCS_GRAY))
      return false;
    return tjDecompress2(library_->handle, payload.data(), payload.size(), &picture.data->r, width,
                         3 * picture.stride, height, TJPF_RGB,
                         TJFLAG_ACCURATEDCT | TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS) == 0;
  }
  void renew() noexcept {
    library_.reset();
    try {
      library_ = std::make_unique<Handle>(tjInitDecompress());
    } catch (...) {  // no memory: pictures are refused until there is some
    }
  }
  std::unique_ptr<Handle> library_;
};

}  // namespace

std::unique_ptr<ColourEncodeEngine> make_jpeg_encoder() { return std::make_unique<JpegEncoder>(); }
std::unique_ptr<ColourDecodeEngine> make_jpeg_decoder() { return std::make_unique<JpegDecoder>(); }

}  // namespace drivers
