// Rest and motion told from depth alone, on films that did not choose the thresholds. Seeds are
// printed.
#include "drivers/codec/depth_motion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <vector>

#include "tools/measure/bench/codec/codec_film.hpp"

namespace {

using drivers::DepthMode;
using drivers::DepthMotion;
using drivers::DepthNoiseLaw;

rt::Startup startup;

teletact::CodecFilm film(bool moving, DepthNoiseLaw noise, std::uint64_t seed, int frames) {
  teletact::CodecFilmOptions o;
  o.moving = moving, o.noise = noise, o.seed = seed, o.frames = frames, o.lateral_px = 0.3;
  return film_codec(startup.token(), o);
}

// Frames judged moving, those behind the first kBack; and the largest and least share that moved.
struct Judged {
  int moving = 0, frames = 0, least = 1000, most = 0;
};
Judged judge(DepthMotion& motion, const teletact::CodecFilm& f) {
  Judged out;
  auto frame = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < f.sensor.size(); ++i) {
    f.sensor.frame(i, *frame);
    const auto& k = frame->intrinsics;
    const std::span<const std::uint16_t> depth{
        frame->depth_mm.data(),
        static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height)};
    const DepthMode mode = motion.judge(depth);
    if (i < DepthMotion::kBack) continue;
    ++out.frames;
    out.moving += mode == DepthMode::kMoving ? 1 : 0;
    out.least = std::min(out.least, motion.moved_permille());
    out.most = std::max(out.most, motion.moved_permille());
  }
  return out;
}

TEST(DepthMotion, RestIsQuietAndMotionIsMoving) {
  for (const auto noise : {DepthNoiseLaw::kStrict, DepthNoiseLaw::kLenient}) {
    for (const std::uint64_t seed : {22U, 23U}) {
      const auto rest = film(false, noise, seed, 30), moving = film(true, noise, seed, 60);
      const auto& k = rest.sensor.intrinsics;
      DepthMotion motion(startup.token(), {k.width, k.height, noise});
      for (int turn = 0; turn < 2; ++turn) {
        const Judged still = judge(motion, rest), moves = judge(motion, moving);
        std::printf(
            "  %s, seed %u: at rest %d of %d moving (%d to %d permille), carried %d of %d (%d to "
            "%d)\n",
            to_text(noise), static_cast<unsigned>(seed), still.moving, still.frames, still.least,
            still.most, moves.moving, moves.frames, moves.least, moves.most);
        // Back at rest it takes as many frames again until it is believed.
        EXPECT_LE(still.moving, turn == 0 ? 0 : DepthMotion::kBack + 1);
        // Where it is carried slowly, noise of 1.5 + 2 z^2 mm hides it for a while.
        EXPECT_GE(moves.moving, moves.frames * (noise == DepthNoiseLaw::kStrict ? 9 : 6) / 10);
      }
    }
  }
}

TEST(DepthMotion, NothingToCompareChangesNothing) {
  DepthMotion motion(startup.token(), {64, 48, DepthNoiseLaw::kStrict});
  const std::vector<std::uint16_t> none(64 * 48, 0), near(64 * 48, 900), far(64 * 48, 1500),
      other(7, 900);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(motion.judge(none), DepthMode::kQuiet);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(motion.judge(near), DepthMode::kQuiet);
  EXPECT_EQ(motion.judge(far), DepthMode::kMoving);  // at once
  EXPECT_EQ(motion.judge(other), DepthMode::kMoving);
  EXPECT_EQ(motion.judge(none), DepthMode::kMoving);
  int frames = 0;
  while (motion.judge(far) == DepthMode::kMoving && frames < 100) ++frames;
  EXPECT_GE(frames, DepthMotion::kBack - 1);
  EXPECT_LE(frames, 3 * DepthMotion::kBack);
}

}  // namespace
