// An encoder and a decoder side by side, and images for them.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <span>
#include <string>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "rt/random.hpp"
#include "tests/support/depth_scene.hpp"

namespace depth_stream_test {

using drivers::DepthDemand;
using drivers::DepthFrameInfo;
using drivers::DepthFrameKind;
using drivers::DepthMode;
using drivers::DepthNoiseLaw;
using drivers::DepthStatus;
using Image = std::vector<std::uint16_t>;
using Bytes = std::vector<std::uint8_t>;

inline rt::Startup startup;

struct Streams {
  explicit Streams(int width, int height, DepthNoiseLaw law = DepthNoiseLaw::kStrict)
      : encoder(startup.token(), {width, height, law}),
        decoder(startup.token(), {width, height, law}),
        shown(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
        law_(law) {}

  [[nodiscard]] Bytes encode(const Image& image, const DepthDemand& demand,
                             rt::ForkJoin& team = rt::serial()) {
    Bytes out(drivers::max_depth_frame_bytes(image.size()));
    EXPECT_EQ(encoder.encode(image, demand, out, info, team), DepthStatus::kOk);
    EXPECT_LE(info.bytes, out.size());
    out.resize(info.bytes);
    return out;
  }
  // Into `shown`.
  [[nodiscard]] DepthStatus decode(const Bytes& frame, rt::ForkJoin& team = rt::serial()) {
    return decoder.decode(frame, shown, decoded, team);
  }
  // Through both; false: a pixel is not what the mode promises, or the states differ.
  [[nodiscard]] bool pass(const Image& image, const DepthDemand& demand) {
    const DepthStatus s = decode(encode(image, demand));
    if (s != DepthStatus::kOk) {
      ADD_FAILURE() << drivers::to_text(s);
      return false;
    }
    if (encoder.state_hash() != decoder.state_hash()) {
      ADD_FAILURE() << "states differ after frame " << decoded.seq;
      return false;
    }
    for (std::size_t i = 0; i < image.size(); ++i) {
      const int off = std::abs(int{shown[i]} - int{image[i]});
      const int bound = bound_mm(demand.mode, decoded.step, image[i]);
      if ((shown[i] == 0) != (image[i] == 0) || off > bound) {
        ADD_FAILURE() << "pixel " << i << " of frame " << decoded.seq << ", "
                      << drivers::to_text(demand.mode) << ": " << image[i] << " shown as "
                      << shown[i] << ", allowed " << bound;
        return false;
      }
    }
    return true;
  }

  drivers::DepthEncoder encoder;
  drivers::DepthDecoder decoder;
  DepthFrameInfo info, decoded;

  Image shown;

 private:
  // Asked once a depth: it is not cheap.
  [[nodiscard]] int bound_mm(DepthMode mode, int step, std::uint16_t depth_mm) {
    using Steps = std::array<std::vector<int>, drivers::kDepthSteps>;
    static std::array<std::array<Steps, drivers::kDepthModes>, 2> bounds;
    auto& known = bounds[static_cast<std::size_t>(law_)][static_cast<std::size_t>(mode)]
                        [static_cast<std::size_t>(step)];
    if (known.empty()) known.assign(65536, -1);
    int& bound = known[depth_mm];
    if (bound < 0) bound = drivers::depth_error_bound_mm(law_, mode, step, depth_mm);
    return bound;
  }
  DepthNoiseLaw law_;
};

// Anything: smooth parts, noise of any size, holes, extremes.
inline Image wild_image(std::size_t pixels, rt::Random& random) {
  Image d(pixels);
  const double holes = random.uniform(), jumps = random.uniform(0, 0.3);
  const double spread = random.uniform() < 0.2 ? 30000 : random.uniform(0, 20);
  double z = random.uniform(1, 65535);
  for (auto& p : d) {
    if (random.uniform() < jumps) z = random.uniform(1, 65535);
    p = random.uniform() < holes * holes
            ? std::uint16_t{0}
            : static_cast<std::uint16_t>(std::clamp(z + spread * random.normal(), 1.0, 65535.0));
  }
  return d;
}

inline constexpr DepthMode kModes[] = {DepthMode::kLossless, DepthMode::kFaithful,
                                       DepthMode::kQuiet, DepthMode::kMoving};

}  // namespace depth_stream_test
