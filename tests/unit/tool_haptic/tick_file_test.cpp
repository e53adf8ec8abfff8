// Haptic runs on disk: the same again to the last bit, the same hand through other methods, and
// damage.
#include "tools/touch/tick_file.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "rt/random.hpp"
#include "tests/unit/tool_haptic/short_run.hpp"

namespace {

using teletact::HapticRerun;
using teletact::HapticRunReader;

struct Replayed {
  int ticks = 0, equal = 0, contact = 0;
  double apart_N = 0;
};

Replayed replayed(const std::string& bytes, const std::string& method) {
  auto file = tests::reading(bytes);
  auto reader = HapticRunReader::open(file.get(), "run");
  EXPECT_TRUE(reader) << reader.error();
  tasks::HapticConfig config = reader.value()->header().config;
  if (!method.empty()) config.method = method;
  rt::Startup startup;
  HapticRerun replay(startup.token(), *reader.value(), config);
  Replayed r;
  while (replay.next()) {
    ++r.ticks;
    r.equal += replay.equal() ? 1 : 0;
    r.contact += replay.out().telemetry.in_contact ? 1 : 0;
    r.apart_N = std::max(r.apart_N, (replay.out().force.f_H_D - replay.recorded().f_D).norm());
  }
  return r;
}

TEST(HapticRun, ReplaysToTheLastBitThroughEveryMethod) {
  for (const char* method : {"constrained", "nearest", "nearest10"}) {
    const std::string run = tests::short_run(700, method);
    const Replayed again = replayed(run, "");
    EXPECT_EQ(again.ticks, 700);
    EXPECT_EQ(again.equal, 700) << method;
    EXPECT_GT(again.contact, 400) << method;
    EXPECT_EQ(replayed(run, method).equal, 700);
  }
}

TEST(HapticRun, AnotherMethodGetsTheSameHandAndSurface) {
  const std::string run = tests::short_run(700);
  const Replayed other = replayed(run, "nearest");
  EXPECT_EQ(other.ticks, 700);
  EXPECT_LT(other.equal, 700);
  EXPECT_GT(other.contact, 400);
  EXPECT_GT(other.apart_N, 0.1);
  // What the other method answers is the same each time.
  EXPECT_EQ(other.apart_N, replayed(run, "nearest").apart_N);
}

TEST(HapticRun, HeaderComesBackExactly) {
  const std::string run = tests::short_run(10);
  auto file = tests::reading(run);
  auto reader = HapticRunReader::open(file.get(), "run");
  ASSERT_TRUE(reader);
  const auto& h = reader.value()->header();
  EXPECT_EQ(h.config.friction_static, 0.3);
  EXPECT_EQ(h.config.friction_dynamic, 0.8 * 0.3);
  EXPECT_EQ(h.config.blend_s, 1.0 / 30.0);
  EXPECT_EQ(h.device.damping_N_s_per_m, 20);
  EXPECT_EQ(h.period_s, 1e-3);
}

// Reads everything; the message of what was wrong, or "".
std::string read_all(const std::string& bytes) {
  auto file = tests::reading(bytes);
  auto reader = HapticRunReader::open(file.get(), "run");
  if (!reader) return reader.error();
  auto window = std::make_unique<perception::SurfacePatch>();
  tasks::SurfacePoints surface;
  teletact::HapticRunTick tick;
  for (;;) {
    auto kind = reader.value()->next(*window, surface, tick);
    if (!kind) return kind.error();
    if (kind.value() == HapticRunReader::Kind::kEnd) return "";
  }
}

TEST(HapticRun, CutOffAnywhereIsOneLine) {
  const std::string run = tests::short_run(40);
  EXPECT_EQ(read_all(run), "");
  for (std::size_t n = 0; n < run.size(); n += n < 2000 ? 1 : 97) {
    const std::string said = read_all(run.substr(0, n));
    ASSERT_NE(said, "") << n;
    ASSERT_EQ(said.rfind("run: ", 0), 0U) << said;
    ASSERT_EQ(said.find('\n'), std::string::npos);
  }
}

// The run with another value of a number of [haptic]: length and text of the key, the type, the
// value.
std::string with_number(std::string run, const std::string& key, double value) {
  const std::size_t at = run.find(std::string(1, static_cast<char>(key.size())) + '\0' + key);
  EXPECT_NE(at, std::string::npos) << key;
  std::memcpy(&run[at + 2 + key.size() + 1], &value, sizeof value);
  return run;
}

TEST(HapticRun, NumbersOutOfRangeAreNamed) {
  const std::string run = tests::short_run(10);
  struct Case {
    const char* key;
    double value;
    const char* says;
  };
  for (const Case& c : std::initializer_list<Case>{
           {"scale", 0, "haptic.scale = 0: allowed are 0.01 to 100"},
           {"texture_amplitude_m", 1, "haptic.texture_amplitude_m = 1: allowed are 0 to 0.002"},
           {"slew_N_per_s", -5, "haptic.slew_N_per_s = -5"},
           {"ramp_s", 0, "haptic.ramp_s = 0"},
           {"mark_rate_hz", 0, "haptic.mark_rate_hz = 0"},
           {"force_limit_N", 1e9, "allowed are 0.01 to 1000"},
           {"blend_s", -1, "haptic.blend_s = -1"},
           {"stiffness_N_per_m", 0, "allowed are 1 to 100000"},
           {"stiffness_N_per_m", -1000, "allowed are 1 to 100000"},
           {"stiffness_N_per_m", std::nan(""), "haptic.stiffness_N_per_m = nan"},
           {"tip_radius_m", 2, "haptic.tip_radius_m = 2"}}) {
    const std::string said = read_all(with_number(run, c.key, c.value));
    EXPECT_EQ(said.rfind("run: ", 0), 0U) << c.key << ": " << said;
    EXPECT_NE(said.find(c.says), std::string::npos) << c.key << ": " << said;
  }
  // What teletact touch allows beyond a scene of the demo.
  EXPECT_EQ(read_all(with_number(run, "stiffness_N_per_m", 1e5)), "");
  EXPECT_EQ(read_all(with_number(run, "force_limit_N", 1000)), "");
  EXPECT_EQ(read_all(with_number(run, "tip_radius_m", 0.8)), "");
}

TEST(HapticRun, NothingFollowsTheEnd) {
  const std::string said = read_all(tests::short_run(10) + std::string(16, '\0'));
  EXPECT_EQ(said, "run: more bytes after its end");
}

TEST(HapticRun, SurvivesDamage) {
  constexpr std::uint64_t kSeed = 20260131;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  const std::string good = tests::short_run(40);
  int refused = 0;
  for (int i = 0; i < 1500; ++i) {
    std::string bytes = good;
    for (auto edits = random.integer(1, 4); edits > 0; --edits) {
      const auto at = static_cast<std::size_t>(
          random.integer(0, static_cast<std::int64_t>(i % 2 == 0 ? 900 : bytes.size() - 1)));
      if (random.integer(0, 5) == 0) {
        bytes.erase(at, static_cast<std::size_t>(random.integer(1, 9)));
      } else {
        bytes[at] = static_cast<char>(random.integer(0, 255));
      }
    }
    const std::string said = read_all(bytes);
    ASSERT_EQ(said.find('\n'), std::string::npos);
    refused += said.empty() ? 0 : 1;
  }
  EXPECT_GT(refused, 300);
}

}  // namespace
