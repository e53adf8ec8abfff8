#include "drivers/codec/colour_engine.hpp"

#if TELETACT_H264

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavutil/opt.h>
}

#include <algorithm>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/codec/colour_picture.hpp"

namespace drivers {

using perception::ImageView;
using perception::Rgb;
using perception::RgbdFrame;

namespace {

struct FreeContext {
  void operator()(AVCodecContext* c) const noexcept { avcodec_free_context(&c); }
};
struct FreeFrame {
  void operator()(AVFrame* f) const noexcept { av_frame_free(&f); }
};
struct FreePacket {
  void operator()(AVPacket* p) const noexcept { av_packet_free(&p); }
};
using Context = std::unique_ptr<AVCodecContext, FreeContext>;
using Frame = std::unique_ptr<AVFrame, FreeFrame>;
using Packet = std::unique_ptr<AVPacket, FreePacket>;

[[noreturn]] void fail(const char* what) {
  throw std::runtime_error(std::string("H.264: libavcodec: ") + what);
}

// Damaged bytes would make libav write lines to stderr for whoever sends them. It has one level for
// the process; nothing else here uses libav.
void be_quiet() {
  static std::once_flag once;
  std::call_once(once, [] { av_log_set_level(AV_LOG_QUIET); });
}

Context open(const AVCodec* codec, Context context, AVDictionary* options) {
  const int failed = avcodec_open2(context.get(), codec, &options);
  const AVDictionaryEntry* unknown = av_dict_get(options, "", nullptr, AV_DICT_IGNORE_SUFFIX);
  const std::string left = unknown != nullptr ? unknown->key : "";
  av_dict_free(&options);
  if (failed < 0) fail("the codec can not be opened");
  if (!left.empty()) fail(("has no option " + left).c_str());
  return context;
}

class H264Encoder : public ColourEncodeEngine {
 public:
  H264Encoder(const ColourStreamConfig& config, int width, int height) {
    be_quiet();
    const AVCodec* codec = avcodec_find_encoder_by_name("libx264");
    if (codec == nullptr) fail("has no libx264");
    Context c(avcodec_alloc_context3(codec));
    if (!c) fail("no memory");
    c->width = width + width % 2, c->height = height + height % 2;
    c->pix_fmt = AV_PIX_FMT_YUV420P;
    c->color_range = AVCOL_RANGE_JPEG;
    c->colorspace = AVCOL_SPC_SMPTE170M;
    c->time_base = {1, config.fps};
    c->framerate = {config.fps, 1};
    c->thread_count = 1;
    c->max_b_frames = 0;
    c->gop_size = 1 << 30;  // keys only where one is asked for
    c->qmin = config.finest;
    set_rate(*c, ColourDemand{}.rate_kbit_s);
    AVDictionary* options = nullptr;
    for (const auto& [key, value] : {std::pair{"preset", "superfast"},
                                     {"tune", "zerolatency"},
                                     {"forced-idr", "1"},
                                     {"x264-params", "scenecut=0:threads=1:cpu-independent=1"}})
      av_dict_set(&options, key, value, 0);
    context_ = open(codec, std::move(c), options);
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    if (!frame_ || !packet_) fail("no memory");
    frame_->format = AV_PIX_FMT_YUV420P;
    frame_->color_range = AVCOL_RANGE_JPEG;
    frame_->width = context_->width, frame_->height = context_->height;
    if (av_frame_get_buffer(frame_.get(), 0) < 0) fail("no memory");
  }

  ColourEncoder::Coded encode(ImageView<const Rgb> picture, const ColourDemand& demand,
                              std::span<std::uint8_t> out) noexcept override {
    AVFrame& f = *frame_;
    if (picture.width + picture.width % 2 != f.width ||
        picture.height + picture.height % 2 != f.height)
      return {ColourStatus::kBadSize};
    if (av_frame_make_writable(&f) < 0) return {ColourStatus::kFailed};
    to_yuv420(picture,
              {f.data[0], f.data[1], f.data[2], f.linesize[0], f.linesize[1], f.width, f.height});
    f.pts = next_++;
    f.pict_type = demand.key ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
    set_rate(*context_, demand.rate_kbit_s);  // libx264 takes a changed one with the frame
    if (avcodec_send_frame(context_.get(), &f) < 0 ||
        avcodec_receive_packet(context_.get(), packet_.get()) < 0)
      return {ColourStatus::kFailed};
    const auto size = static_cast<std::size_t>(packet_->size);
    ColourEncoder::Coded coded{ColourStatus::kOk, size, (packet_->flags & AV_PKT_FLAG_KEY) != 0};
    if (size <= out.size())
      std::copy_n(packet_->data, size, out.data());
    else
      coded = {ColourStatus::kNoRoom};
    av_packet_unref(packet_.get());
    return coded;
  }

 private:
  // The buffer of the rate control holds a tenth of a second: no picture, key or not, is longer.
  static void set_rate(AVCodecContext& c, int rate_kbit_s) noexcept {
    c.bit_rate = c.rc_max_rate = rate_kbit_s * 1000LL;
    c.rc_buffer_size = rate_kbit_s * 100;
  }
  Context context_;
  Frame frame_;
  Packet packet_;
  std::int64_t next_ = 0;
};

class H264Decoder : public ColourDecodeEngine {
 public:
  H264Decoder() : bytes_(kMostColourBytes + AV_INPUT_BUFFER_PADDING_SIZE) {
    be_quiet();
    context_ = fresh();
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    if (!frame_ || !packet_) fail("no memory");
  }

  bool decode(std::span<const std::uint8_t> payload, bool key,
              ImageView<Rgb> picture) noexcept override {
    if (payload.empty() || payload.size() > kMostColourBytes) return false;
    // A new one for each key: a damaged sequence header leaves marks that flushing keeps.
    if (key && !renew()) return false;
    std::copy(payload.begin(), payload.end(), bytes_.begin());
    std::memset(bytes_.data() + payload.size(), 0, AV_INPUT_BUFFER_PADDING_SIZE);
    packet_->data = bytes_.data();
    packet_->size = static_cast<int>(payload.size());
    if (avcodec_send_packet(context_.get(), packet_.get()) < 0 ||
        avcodec_receive_frame(context_.get(), frame_.get()) < 0)
      return false;
    const AVFrame& f = *frame_;
    const bool good = f.width == picture.width + picture.width % 2 &&
                      f.height == picture.height + picture.height % 2 &&
                      (f.format == AV_PIX_FMT_YUV420P || f.format == AV_PIX_FMT_YUVJ420P) &&
                      f.decode_error_flags == 0 && (f.flags & AV_FRAME_FLAG_CORRUPT) == 0;
    if (good)
      from_yuv420(
          {f.data[0], f.data[1], f.data[2], f.linesize[0], f.linesize[1], f.width, f.height},
          picture);
    av_frame_unref(frame_.get());
    return good;
  }

 private:
  [[nodiscard]] static Context fresh() {
    const AVCodec* codec = avcodec_find_decoder(AV_CODEC_ID_H264);
    if (codec == nullptr) fail("has no H.264");
    Context c(avcodec_alloc_context3(codec));
    if (!c) fail("no memory");
    c->thread_count = 1;
    c->flags |= AV_CODEC_FLAG_LOW_DELAY;
    c->err_recognition = AV_EF_BITSTREAM | AV_EF_BUFFER | AV_EF_EXPLODE;
    c->error_concealment = 0;
    // A sequence header can not ask for more than our largest picture takes.
    c->max_pixels = std::int64_t{(RgbdFrame::kMaxWidth + 32) * (RgbdFrame::kMaxHeight + 32)};
    return open(codec, std::move(c), nullptr);
  }
  [[nodiscard]] bool renew() noexcept {
    try {
      context_ = fresh();
      return true;
    } catch (...) {
      return false;
    }
  }
  Context context_;
  Frame frame_;
  Packet packet_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace

bool h264_built_in() noexcept { return true; }
std::unique_ptr<ColourEncodeEngine> make_h264_encoder(const ColourStreamConfig& config, int width,
                                                      int height) {
  return std::make_unique<H264Encoder>(config, width, height);
}
std::unique_ptr<ColourDecodeEngine> make_h264_decoder() { return std::make_unique<H264Decoder>(); }

}  // namespace drivers

#else

namespace drivers {

bool h264_built_in() noexcept { return false; }
std::unique_ptr<ColourEncodeEngine> make_h264_encoder(const ColourStreamConfig&, int, int) {
  return nullptr;
}
std::unique_ptr<ColourDecodeEngine> make_h264_decoder() { return nullptr; }

}  // namespace drivers

#endif
