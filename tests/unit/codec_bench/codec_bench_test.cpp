#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "tools/measure/bench/codec/codec_bench.hpp"

namespace {

using namespace teletact;  // NOLINT
using drivers::DepthNoiseLaw;

rt::Startup startup;

// Every limit met by a wide margin, nothing else on the machine.
CodecBenchResult good() {
  CodecBenchResult r;
  for (const CodecBenchCase& c : codec_cases()) {
    CodecBenchRow row;
    row.what = &c;
    row.depth_mbit_s = 3, row.colour_mbit_s = 1, row.encode_ms = 4, row.decode_ms = 2;
    row.ffv1_encode_ms = row.ffv1_decode_ms = 6;
    row.error_sigma = 0.8, row.sensor_sigma = 1;
    r.rows.push_back(row);
  }
  r.damage.push_back({"depth", 10, 9, 1, 0, 1});
  r.states = 10;
  return r;
}

TEST(CodecBench, EachLimitCanBeMissed) {
  EXPECT_EQ(good().missed(), 0);
  const auto missed = [](auto change) {
    CodecBenchResult r = good();
    change(r);
    return r.missed();
  };
  EXPECT_GT(missed([](auto& r) { r.rows[2].encode_ms = 5.6; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[2].decode_ms = 3.3; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[2].colour_mbit_s = 2.6; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[2].error_sigma = 1; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[2].error_sigma = std::nan(""); }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[4].depth_mbit_s = 7.9; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[5].depth_mbit_s = 7.9; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[0].flying = 0.1; }), 0);
  EXPECT_GT(missed([](auto& r) { r.damage[0].wrong = 1; }), 0);
  EXPECT_GT(missed([](auto& r) { r.damage[0].worst_ms = 51; }), 0);
  EXPECT_GT(missed([](auto& r) { r.states_differ = 1; }), 0);
  // Beside others' work times count for nothing, the rest does.
  EXPECT_EQ(missed([](auto& r) { r.rows[2].encode_ms = 50, r.other_load = 1; }), 0);
  EXPECT_GT(missed([](auto& r) { r.rows[2].flying = 1, r.other_load = 1; }), 0);
}

TEST(CodecBench, NamesItsFigures) {
  std::string all;
  for (const BenchMetric& m : good().metrics()) all += m.name + "\n";
  for (const char* mode : {"lossless", "faithful", "quiet", "moving"})
    for (const char* figure : {"encode_ms", "decode_ms", "mbit_s", "err_over_sensor"})
      EXPECT_NE(all.find(std::string("codec.") + mode + "." + figure + "\n"), std::string::npos);
  std::stringstream text;
  good().print(text);
  EXPECT_NE(text.str().find("0 MISSED"), std::string::npos) << text.str();
}

// The noise that the film puts on is the law's, and nowhere else than along the axis.
TEST(CodecFilm, NoiseIsTheLaws) {
  for (const DepthNoiseLaw law : {DepthNoiseLaw::kStrict, DepthNoiseLaw::kLenient}) {
    const CodecFilm film = film_codec(startup.token(), {false, law, 3, 2, true});
    const auto& k = film.sensor.intrinsics;
    ASSERT_EQ(k.width, 512);
    double squares = 0, sum = 0;
    int count = 0;
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const auto n = static_cast<std::size_t>(v * k.width + u);
        const int x = film.sensor.depth_mm(0, u, v), truth = film.truth_mm[n];
        if (film.inner[n] == 0 || x == 0) continue;
        const double off = (x - truth) / noise_mm(law, 1e-3 * truth);
        squares += off * off, sum += off, ++count;
      }
    }
    EXPECT_GT(count, 100000);
    EXPECT_NEAR(sum / count, 0, 0.02);
    EXPECT_NEAR(std::sqrt(squares / count), 1, 0.05);
  }
}

TEST(CodecBench, DamageAndStatesAreSound) {
  const CodecFilm film = film_codec(startup.token(), {true, DepthNoiseLaw::kStrict, 2, 4, true}),
                  rest = film_codec(startup.token(), {false, DepthNoiseLaw::kStrict, 2, 4, true});
  for (const CodecDamage& d : damage_codecs(startup.token(), film, 80, 5)) {
    EXPECT_EQ(d.wrong, 0) << d.name;
    EXPECT_EQ(d.refused + d.decoded, d.frames) << d.name;
    EXPECT_GE(d.refused, 35) << d.name;
  }
  EXPECT_EQ(compare_codec_states(startup.token(), film, 24, 6), 0);
  for (const CodecBenchCase& c : codec_cases()) {
    const CodecBenchRow row = run_codec_case(startup.token(), c, c.moving ? film : rest);
    EXPECT_EQ(row.flying, 0) << c.name;
    EXPECT_GT(row.depth_mbit_s, 0) << c.name;
    EXPECT_LT(row.depth_mbit_s, row.what->mode == drivers::DepthMode::kLossless ? 70 : 25)
        << c.name;
  }
}

}  // namespace
