// Readers of depth that crosses the road: frames of the stream after a sound one, lossless ones.
#include <memory>
#include <stdexcept>

#include "drivers/codec/depth_frame.hpp"
#include "drivers/codec/depth_stream.hpp"
#include "drivers/link/depth_codec.hpp"
#include "rt/random.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

using drivers::DepthMode;
using drivers::DepthStatus;

constexpr int kWidth = 32, kHeight = 24;

// Two surfaces with an edge, holes and noise.
std::vector<std::uint16_t> depth_image(std::uint64_t frame) {
  rt::Random random(7, frame);
  std::vector<std::uint16_t> d(std::size_t{kWidth} * kHeight);
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double z = (i % kWidth < 14 ? 900 : 1300) + 2.0 * static_cast<double>(i / kWidth);
    d[i] = random.uniform() < 0.05 ? std::uint16_t{0}
                                   : static_cast<std::uint16_t>(z + 1.3 * random.normal());
  }
  return d;
}

std::span<const std::uint8_t> view(const std::string& bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

std::string coded(drivers::DepthEncoder& encoder, std::uint64_t frame,
                  const drivers::DepthDemand& demand) {
  const auto image = depth_image(frame);
  std::string out(drivers::max_depth_frame_bytes(image.size()), '\0');
  drivers::DepthFrameInfo info;
  if (encoder.encode(image, demand, {reinterpret_cast<std::uint8_t*>(out.data()), out.size()},
                     info) != DepthStatus::kOk) {
    throw std::runtime_error("a depth image could not be encoded");
  }
  out.resize(info.bytes);
  return out;
}

}  // namespace

void FuzzReaders::add_depth_stream() {
  struct Held {
    rt::Startup startup;
    drivers::DepthDecoder decoder{startup.token(), {kWidth, kHeight}};
    std::vector<std::uint16_t> shown = depth_image(0);
    std::string first;  // a sound key; what is read comes after it
    std::uint64_t check = 0;
  };
  const auto held = std::make_shared<Held>();
  std::vector<std::string> seeds;
  for (const DepthMode mode : {DepthMode::kFaithful, DepthMode::kQuiet, DepthMode::kMoving}) {
    drivers::DepthEncoder encoder(held->startup.token(), {kWidth, kHeight});
    held->first = coded(encoder, 0, {DepthMode::kFaithful, -1, true});
    seeds.push_back(coded(encoder, 1, {mode, -1, false}));
    seeds.push_back(coded(encoder, 2, {mode, -1, true}));
  }
  drivers::DepthEncoder encoder(held->startup.token(), {kWidth, kHeight});
  seeds.push_back(coded(encoder, 3, {DepthMode::kLossless, -1, true}));
  drivers::codec::DepthFrameHeader h;
  if (drivers::codec::read_header(view(held->first), h) != DepthStatus::kOk)
    throw std::runtime_error("a depth frame has no header");
  held->check = h.check;
  const auto read = [held](const std::string& b) -> rt::Result<bool> {
    drivers::DepthFrameInfo info;
    if (held->decoder.decode(view(held->first), held->shown, info) != DepthStatus::kOk)
      return rt::Error{"no line\nfor a sound key was refused"};
    const DepthStatus s = held->decoder.decode(view(b), held->shown, info);
    if (s == DepthStatus::kOk) return true;
    return rt::Error{std::string("depth frame: ") + drivers::to_text(s)};
  };
  const auto seal = [held](std::string& b) {
    drivers::codec::DepthFrameHeader damaged;
    if (b.size() < drivers::kDepthFrameHeader) return;
    for (std::size_t i = 0; i < 4; ++i)
      b[20 + i] = static_cast<char>((b.size() - drivers::kDepthFrameHeader) >> (8 * i));
    if (drivers::codec::read_header(view(b), damaged) != DepthStatus::kOk) return;
    drivers::codec::write_header(damaged, held->check,
                                 {reinterpret_cast<std::uint8_t*>(b.data()), b.size()});
  };
  readers_.push_back({"depth_stream", std::move(seeds), read, seal, false});
}

// What is taken comes back when it is coded again.
void FuzzReaders::add_depth_lossless() {
  constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  const auto bytes_of = [](std::span<const std::uint16_t> depth) {
    std::string out(drivers::max_depth_bytes(depth.size()), '\0');
    out.resize(
        drivers::encode_depth(depth, {reinterpret_cast<std::uint8_t*>(out.data()), out.size()}));
    return out;
  };
  std::vector<std::uint16_t> noise(kPixels);
  rt::Random random(7);
  for (auto& d : noise) d = static_cast<std::uint16_t>(65535 * random.uniform());
  std::vector<std::string> seeds{bytes_of(depth_image(0)), bytes_of(depth_image(1)),
                                 bytes_of(std::vector<std::uint16_t>(kPixels)), bytes_of(noise)};
  const auto read = [bytes_of](const std::string& b) -> rt::Result<bool> {
    std::vector<std::uint16_t> depth(kPixels), again(kPixels);
    if (!drivers::decode_depth(view(b), depth)) return rt::Error{"depth: not of this size"};
    if (!drivers::decode_depth(view(bytes_of(depth)), again) || again != depth)
      return rt::Error{"no line\nfor what was taken and did not come back"};
    return true;
  };
  readers_.push_back({"depth_lossless", std::move(seeds), read, {}, false});
}

}  // namespace teletact
