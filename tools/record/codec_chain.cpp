#include "tools/record/codec_chain.hpp"

#include <algorithm>
#include <stdexcept>

#include "drivers/link/depth_codec.hpp"
#include "rt/clock/box_time.hpp"

namespace teletact {

using drivers::ColourStatus;
using drivers::DepthMode;
using drivers::DepthStatus;

namespace {

class Stopwatch {
 public:
  double lap_ms() noexcept {
    const std::int64_t now = rt::thread_cpu_ns(), before = last_;
    last_ = now;
    return 1e-6 * static_cast<double>(now - before);
  }

 private:
  std::int64_t last_ = rt::thread_cpu_ns();
};

drivers::DepthStreamConfig depth_config(const CodecChoice& c, int width, int height) {
  return {width, height, c.law};
}

int first_step(const CodecChoice& c) {
  return c.step >= 0 && c.step < drivers::kDepthSteps ? c.step
                                                      : drivers::default_depth_step(c.mode, c.law);
}

// With a rate a mode may go as coarse as it must; without one it stays.
int coarsest_step(const CodecChoice& c) {
  return c.rate_mbit_s > 0 && c.mode != DepthMode::kLossless ? drivers::kDepthSteps - 1
                                                             : first_step(c);
}

[[noreturn]] void refuse_codec(const char* what, const char* status) {
  throw std::runtime_error(std::string(what) + ": " + status);
}

}  // namespace

CodecChain::CodecChain(rt::NonRealtime& nrt, const CodecChoice& choice, int width, int height)
    : choice_(choice),
      depth_encoder_(nrt, depth_config(choice, width, height)),
      depth_decoder_(nrt, depth_config(choice, width, height)),
      motion_(nrt, depth_config(choice, width, height)),
      colour_decoder_(nrt),
      first_step_(first_step(choice)),
      steps_(first_step_, first_step_, coarsest_step(choice)),
      depth_out_(drivers::max_depth_frame_bytes(static_cast<std::size_t>(width) *
                                                static_cast<std::size_t>(height))),
      colour_out_(drivers::kMostColourBytes),
      depth_in_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  if (choice.with_colour) colour_encoder_ = make_colour_encoder(nrt, choice.colour, width, height);
}

CodedFrame CodecChain::pass(perception::RgbdFrame& frame, bool key) {
  CodedFrame out;
  std::copy_n(frame.depth_mm.begin(), depth_in_.size(), depth_in_.begin());
  frame.has_colour = frame.has_colour && choice_.with_colour;
  if (frame.has_colour) encode_colour(frame, key, out);
  choice_.mode == DepthMode::kLossless ? pass_lossless(frame, out) : pass_stream(frame, key, out);
  if (frame.has_colour) decode_colour(frame, out);
  steps_.sent(static_cast<std::int64_t>(out.bytes()),
              static_cast<std::int64_t>(choice_.rate_mbit_s * 1e6 / 8 / choice_.fps));
  return out;
}

// As the link does it: each frame alone, at a tenth of the stream's CPU.
void CodecChain::pass_lossless(perception::RgbdFrame& frame, CodedFrame& out) {
  Stopwatch watch;
  const std::size_t bytes = drivers::encode_depth(depth_in_, depth_out_);
  out.depth_encode_ms = watch.lap_ms();
  out.depth.bytes = static_cast<std::uint32_t>(bytes);
  out.depth.seq = seq_++;
  const bool good =
      drivers::decode_depth({depth_out_.data(), bytes}, {frame.depth_mm.data(), depth_in_.size()});
  out.depth_decode_ms = watch.lap_ms();
  if (!good || !std::equal(depth_in_.begin(), depth_in_.end(), frame.depth_mm.begin()))
    refuse_codec("lossless depth", "does not come back");
}

void CodecChain::pass_stream(perception::RgbdFrame& frame, bool key, CodedFrame& out) {
  Stopwatch watch;
  int step = steps_.step();
  if (choice_.by_motion) {
    choice_.mode = motion_.judge(depth_in_);
    // As many steps coarser than its own as the rate asks for.
    step = std::min(first_step(choice_) + step - first_step_, drivers::kDepthSteps - 1);
  }
  const DepthStatus encoded =
      depth_encoder_.encode(depth_in_, {choice_.mode, step, key}, depth_out_, out.depth);
  out.depth_encode_ms = watch.lap_ms();
  if (encoded != DepthStatus::kOk) refuse_codec("depth can not be encoded", to_text(encoded));
  drivers::DepthFrameInfo seen;
  watch.lap_ms();
  const DepthStatus decoded = depth_decoder_.decode(
      {depth_out_.data(), out.depth.bytes}, {frame.depth_mm.data(), depth_in_.size()}, seen);
  out.depth_decode_ms = watch.lap_ms();
  if (decoded != DepthStatus::kOk) refuse_codec("depth can not be decoded", to_text(decoded));
  if (depth_encoder_.state_hash() != depth_decoder_.state_hash())
    refuse_codec("depth", "encoder and decoder hold different images");
}

void CodecChain::encode_colour(const perception::RgbdFrame& frame, bool key, CodedFrame& out) {
  drivers::ColourDemand demand = choice_.colour_demand;
  demand.key = demand.key || key;
  Stopwatch watch;
  const auto coded = colour_encoder_->encode(frame.rgb(), depth_in_, demand, colour_out_);
  out.colour_encode_ms = watch.lap_ms();
  if (coded.status != ColourStatus::kOk)
    refuse_codec("colour can not be encoded", to_text(coded.status));
  out.colour_bytes = coded.bytes, out.colour_key = coded.key;
}

// With the depth that was decoded: its readings are where those of the camera are.
void CodecChain::decode_colour(perception::RgbdFrame& frame, CodedFrame& out) {
  Stopwatch watch;
  const ColourStatus decoded =
      colour_decoder_.decode({colour_out_.data(), out.colour_bytes},
                             {frame.depth_mm.data(), depth_in_.size()}, frame.rgb());
  out.colour_decode_ms = watch.lap_ms();
  if (decoded != ColourStatus::kOk) refuse_codec("colour can not be decoded", to_text(decoded));
}

}  // namespace teletact
