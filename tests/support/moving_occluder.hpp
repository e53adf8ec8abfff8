// A slanted surface that swings before a slanted background, seen by a camera at rest with noise
// along its axis: what a depth codec with a memory in time makes of the pixels that see now one
// surface, now the other, and of a surface that comes and goes.
//
// Law of the noise: sigma(z) mm, the codec's own; every draw from the seed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "rt/random.hpp"

namespace test_support {

[[nodiscard]] inline double law_sigma_mm(drivers::DepthNoiseLaw law, double z_mm) {
  const double z = 1e-3 * z_mm;
  return law == drivers::DepthNoiseLaw::kStrict ? std::max(1.2, 1.5 - 0.5 * z + 0.3 * z * z)
                                                : 1.5 + 2 * z * z;
}

// Of lag() below: a filter that takes the motion for noise makes 5.4 and 3.9.
[[nodiscard]] inline double most_lag(drivers::DepthNoiseLaw law) {
  return law == drivers::DepthNoiseLaw::kStrict ? 3.6 : 2.7;
}

class MovingOccluder {
 public:
  static constexpr int kWidth = 96, kHeight = 72;
  static constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  using Image = std::vector<std::uint16_t>;

  MovingOccluder(drivers::DepthNoiseLaw law, std::uint64_t seed)
      : law_(law),
        noise_(seed, 1),
        readings_(kPixels),
        truth_(kPixels),
        before_(kPixels),
        moved_(kPixels) {
    rt::Random random(seed);
    near_mm_ = random.uniform(700, 2200);
    far_mm_ = near_mm_ + random.uniform(60, 1500);
    swing_px_ = random.uniform(5, 30), swing_mm_ = random.uniform(30, 150);
    turn_ = 6.2831853 / random.uniform(40, 120), phase_ = random.uniform(0, 6.28);
    slant_near_ = random.uniform(-4, 4), slant_far_ = random.uniform(-4, 4);
  }

  void film(int frame) {
    const double s = std::sin(turn_ * frame + phase_), c = std::cos(turn_ * frame + phase_);
    const double left = 30 + swing_px_ * s, z = near_mm_ + swing_mm_ * c;
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const auto i = static_cast<std::size_t>(v * kWidth + u);
        const bool near = u >= left && u < left + 25 && v > 8;
        const double mm = near ? z + slant_near_ * (u - left) : far_mm_ + slant_far_ * (u - 48);
        const double noisy = mm + law_sigma_mm(law_, mm) * noise_.normal();
        const bool rim = std::abs(u - left) < 2 || std::abs(u - left - 25) < 2;
        truth_[i] = mm;
        moved_[i] = frame > 0 && std::abs(mm - before_[i]) > 0.1 ? 20 : std::max(0, moved_[i] - 1);
        before_[i] = mm;
        readings_[i] = rim && noise_.uniform() < 0.3
                           ? std::uint16_t{0}
                           : static_cast<std::uint16_t>(std::max(1.0, std::round(noisy)));
      }
    }
  }
  [[nodiscard]] const Image& readings() const { return readings_; }

  // Of one frame as decoded.
  void judge(const Image& shown) {
    for (std::size_t i = 0; i < kPixels; ++i) {
      const double x = readings_[i], y = shown[i], sigma = law_sigma_mm(law_, x);
      const double off = std::min(std::abs(y - x), std::abs(y - truth_[i]));
      flying += (x == 0) != (y == 0) || (x > 0 && off > 30 && off > 5 * sigma) ? 1 : 0;
      if (x == 0 || moved_[i] == 0) continue;
      const double of_truth = law_sigma_mm(law_, truth_[i]);
      shown_ += std::pow((y - truth_[i]) / of_truth, 2);
      read_ += std::pow((x - truth_[i]) / of_truth, 2);
    }
  }
  // Where the surface moved in the last 20 frames: RMS off the truth over the camera's own.
  [[nodiscard]] double lag() const { return std::sqrt(shown_ / read_); }
  long flying = 0;  // pixels of neither surface, or with a reading where there is none

 private:
  drivers::DepthNoiseLaw law_;
  rt::Random noise_;
  double near_mm_, far_mm_, swing_px_, swing_mm_, turn_, phase_, slant_near_, slant_far_;
  Image readings_;
  std::vector<double> truth_, before_;
  std::vector<int> moved_;
  double shown_ = 0, read_ = 0;
};

// So many frames through encoder and decoder.
[[nodiscard]] inline MovingOccluder watch_occluder(rt::NonRealtime& nrt, drivers::DepthNoiseLaw law,
                                                   drivers::DepthMode mode, std::uint64_t seed,
                                                   int frames = 60) {
  const drivers::DepthStreamConfig config{MovingOccluder::kWidth, MovingOccluder::kHeight, law};
  drivers::DepthEncoder encoder(nrt, config);
  drivers::DepthDecoder decoder(nrt, config);
  std::vector<std::uint8_t> bytes(drivers::max_depth_frame_bytes(MovingOccluder::kPixels));
  MovingOccluder::Image shown(MovingOccluder::kPixels);
  drivers::DepthFrameInfo info;
  MovingOccluder scene(law, seed);
  for (int frame = 0; frame < frames; ++frame) {
    scene.film(frame);
    if (encoder.encode(scene.readings(), {mode, -1, false}, bytes, info) !=
            drivers::DepthStatus::kOk ||
        decoder.decode({bytes.data(), info.bytes}, shown, info) != drivers::DepthStatus::kOk) {
      scene.flying += static_cast<long>(MovingOccluder::kPixels);
    }
    scene.judge(shown);
  }
  return scene;
}

}  // namespace test_support
