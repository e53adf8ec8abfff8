#include "tools/measure/bench/codec/ffv1_peer.hpp"

#include <stdexcept>

#if TELETACT_H264

extern "C" {
#include <libavcodec/avcodec.h>
}

#include <cstring>
#include <string>

#include "rt/clock/box_time.hpp"

namespace teletact {

namespace {

[[noreturn]] void fail(const char* what) { throw std::runtime_error(std::string("FFV1: ") + what); }

// `extra`: what the encoder tells the decoder before the first picture; null: it is the encoder.
AVCodecContext* context(const AVCodec* codec, int width, int height, const AVCodecContext* extra) {
  if (codec == nullptr) fail("libavcodec has none");
  AVCodecContext* c = avcodec_alloc_context3(codec);
  if (c == nullptr) fail("no memory");
  c->width = width, c->height = height;
  c->pix_fmt = AV_PIX_FMT_GRAY16LE;
  c->time_base = {1, 30};
  c->thread_count = 1;
  if (extra != nullptr && extra->extradata_size > 0) {
    const auto size = static_cast<std::size_t>(extra->extradata_size);
    c->extradata = static_cast<std::uint8_t*>(av_mallocz(size + AV_INPUT_BUFFER_PADDING_SIZE));
    if (c->extradata == nullptr) fail("no memory");
    std::memcpy(c->extradata, extra->extradata, size);
    c->extradata_size = extra->extradata_size;
  }
  if (avcodec_open2(c, codec, nullptr) < 0) {
    avcodec_free_context(&c);
    fail("can not be opened");
  }
  return c;
}

double lap_ms(std::int64_t& last) {
  const std::int64_t now = rt::thread_cpu_ns(), before = last;
  last = now;
  return 1e-6 * static_cast<double>(now - before);
}

}  // namespace

struct Ffv1Peer::State {
  int width, height;
  AVCodecContext *encoder = nullptr, *decoder = nullptr;
  AVFrame *in = av_frame_alloc(), *out = av_frame_alloc();
  AVPacket* packet = av_packet_alloc();
  State(int w, int h) : width(w), height(h) {
    encoder = context(avcodec_find_encoder(AV_CODEC_ID_FFV1), w, h, nullptr);
    decoder = context(avcodec_find_decoder(AV_CODEC_ID_FFV1), w, h, encoder);
    in->format = AV_PIX_FMT_GRAY16LE, in->width = w, in->height = h;
    if (av_frame_get_buffer(in, 0) < 0) fail("no memory");
  }
  ~State() {
    avcodec_free_context(&encoder);
    avcodec_free_context(&decoder);
    av_frame_free(&in);
    av_frame_free(&out);
    av_packet_free(&packet);
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
};

Ffv1Peer::Ffv1Peer(int width, int height) : state_(std::make_unique<State>(width, height)) {}
Ffv1Peer::~Ffv1Peer() = default;
bool Ffv1Peer::built_in() noexcept { return true; }

Ffv1Peer::Coded Ffv1Peer::pass(std::span<const std::uint16_t> depth_mm) {
  State& s = *state_;
  const auto row = static_cast<std::size_t>(s.width);
  Coded coded;
  if (av_frame_make_writable(s.in) < 0) fail("no memory");
  for (int v = 0; v < s.height; ++v)
    std::memcpy(s.in->data[0] + static_cast<std::ptrdiff_t>(v) * s.in->linesize[0],
                depth_mm.data() + static_cast<std::size_t>(v) * row, 2 * row);
  std::int64_t last = rt::thread_cpu_ns();
  if (avcodec_send_frame(s.encoder, s.in) < 0 || avcodec_receive_packet(s.encoder, s.packet) < 0)
    fail("a picture can not be encoded");
  coded.encode_ms = lap_ms(last);
  coded.bytes = static_cast<std::size_t>(s.packet->size);
  if (avcodec_send_packet(s.decoder, s.packet) < 0 || avcodec_receive_frame(s.decoder, s.out) < 0)
    fail("a picture can not be decoded");
  coded.decode_ms = lap_ms(last);
  for (int v = 0; v < s.height; ++v)
    if (std::memcmp(s.out->data[0] + static_cast<std::ptrdiff_t>(v) * s.out->linesize[0],
                    depth_mm.data() + static_cast<std::size_t>(v) * row, 2 * row) != 0)
      fail("another picture came back");
  av_packet_unref(s.packet);
  av_frame_unref(s.out);
  return coded;
}

}  // namespace teletact

#else

namespace teletact {

struct Ffv1Peer::State {};
Ffv1Peer::Ffv1Peer(int, int) { throw std::runtime_error("FFV1: libavcodec was not built in"); }
Ffv1Peer::~Ffv1Peer() = default;
bool Ffv1Peer::built_in() noexcept { return false; }
Ffv1Peer::Coded Ffv1Peer::pass(std::span<const std::uint16_t>) { return {}; }

}  // namespace teletact

#endif
