// What a tick costs, in instructions: a time says as much of the machine as of the tick. Times:
// `teletact bench haptic`.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <string>

#include "rt/quantile.hpp"
#include "tests/support/paths.hpp"
#include "tools/measure/bench/callgrind.hpp"
#include "tools/measure/haptic/bench_haptic.hpp"
#include "tools/measure/stability/gates.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_score.hpp"
#include "tools/measure/support/haptic_solids.hpp"
#include "tools/touch/tick_file.hpp"

namespace {

TEST(HapticTick, CountsAreWithinTheirLimits) {
  teletact::HapticBenchOptions options;
  options.passes = 1;
  options.programs = tests::in_build();
  const auto r = teletact::bench_haptic(std::cout, options);
  r.print(std::cout);
  ASSERT_EQ(r.not_counted, "");
  EXPECT_GT(r.methods.front().contact, 3000U) << "the hand misses the table";
  EXPECT_GT(r.blocks_512, 4 * r.blocks_64) << "the small map is not small";
  // Everything but times: the size of a tick and of its slow ones, the same on both maps, effects
  // that nobody asked for cost nothing.
  int counted = 0;
  for (const teletact::Limit& l : r.limits()) {
    if (l.what.find(", us") != std::string::npos) continue;
    ++counted;
    EXPECT_EQ(l.state, teletact::Limit::State::kMet) << l.what << " " << l.value;
  }
  EXPECT_EQ(counted, 6);
  // Those asked for cost something.
  for (const auto& [name, more] : r.effects) EXPECT_GT(more, 8) << name;
  EXPECT_TRUE(r.guarded);
}

// A run of the rig as a file: what the task was given in each tick. The work of each tick on the
// side.
struct Recorded {
  std::string path;
  std::vector<std::uint32_t> work;
  std::vector<bool> contact;
};

class RigRun {
 public:
  RigRun(const std::string& path, rig::Scene scene) : rig_(std::move(scene)) {
    out_.path = path;
    file_ = std::fopen(path.c_str(), "wbe");
    if (file_ == nullptr) throw std::runtime_error(path + ": can not be written");
    teletact::HapticRunHeader header;
    header.config = rig_.setup().config;
    header.device = rig_.setup().device;
    writer_ = std::make_unique<teletact::HapticRunWriter>(file_, header);
  }
  ~RigRun() { std::fclose(file_); }
  RigRun(const RigRun&) = delete;
  RigRun& operator=(const RigRun&) = delete;
  void go(const rig::Hand& hand, double seconds) {
    for (int i = 0; i < 1000 * seconds; ++i) {
      const rig::Row row = rig_.tick(hand(1e-3 * i));
      const perception::SurfacePatch* window = rig_.in().patch_newest;
      if (window != nullptr && window->seq != seen_) {
        seen_ = window->seq;
        writer_->window(*window);
      }
      rt::Tick tick;
      tick.k = out_.work.size();
      tick.release = tick.start = rig_.in().stylus.taken;
      tick.period = rt::Nanos{1000000};
      writer_->tick(teletact::run_tick(tick, rig_.in(), rig_.out()));
      out_.work.push_back(row.telemetry.work);
      out_.contact.push_back(row.telemetry.in_contact);
    }
  }
  Recorded finish() {
    writer_->finish();
    std::fflush(file_);
    return out_;
  }

 private:
  rig::Rig rig_;
  std::FILE* file_ = nullptr;
  std::unique_ptr<teletact::HapticRunWriter> writer_;
  std::uint64_t seen_ = 0;
  Recorded out_;
};

// A fused table is smooth; the corner of a room is what costs most: three faces, the window
// blended, in and out.
Recorded corner_of_a_room(const std::string& path, bool noise) {
  rig::Scene s;
  s.solid = [](const rig::Vec3& p, double) { return solids::room_corner(p); };
  s.nodes = 64;
  if (noise) {
    s.extra = [](int x, int y, int z, int frame) {
      const auto seed = static_cast<std::uint64_t>(((frame * 512 + x) * 512 + y) * 512 + z);
      return rt::Random(seed).uniform(-0.003, 0.003);
    };
  }
  RigRun run(path, std::move(s));
  const rig::Path way({{-0.04, -0.04, 0.01},
                       {-0.04, -0.04, -0.006},
                       {0.006, 0.006, -0.006},
                       {0.006, 0.006, 0.03},
                       {-0.01, -0.01, 0.03},
                       {0.006, 0.006, -0.006}},
                      0.1);
  run.go(way, way.duration());
  return run.finish();
}

// No tick there costs more than the samples that it takes are worth, so their number bounds its
// instructions: what the gates of the hard cases count with (tools/measure/stability/gates.hpp).
TEST(HapticTick, SamplesBoundTheInstructionsOfATick) {
  ASSERT_TRUE(teletact::have_valgrind());
  const auto folder = std::filesystem::temp_directory_path() /
                      ("teletact_haptic_tick_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  for (const bool noise : {false, true}) {
    const Recorded run = corner_of_a_room((folder / "corner.run").string(), noise);
    const auto each = teletact::tick_instructions(
        tests::in_build(), run.path, static_cast<long>(run.work.size()), folder.string());
    ASSERT_EQ(each.size(), run.work.size());
    std::vector<double> contact;
    double of_bound = 0, of_sample = 0;
    for (std::size_t i = 0; i < each.size(); ++i) {
      if (!run.contact[i]) continue;
      contact.push_back(each[i]);
      of_sample = std::max(of_sample, each[i] / run.work[i]);
      of_bound = std::max(of_bound, each[i] / stability::instructions_of(run.work[i]));
      EXPECT_LE(each[i], stability::instructions_of(run.work[i])) << "tick " << i;
    }
    std::printf(
        "corner%s: %zu ticks in contact, instructions p50 %.0f p99 %.0f max %.0f; a sample at most "
        "%.0f, of the bound at most %.2f\n",
        noise ? ", 3 mm of noise" : "", contact.size(), rt::quantile(contact, 0.5),
        rt::quantile(contact, 0.99), rt::quantile(contact, 1), of_sample, of_bound);
    ASSERT_GT(contact.size(), 500U);
    EXPECT_LE(rt::quantile(contact, 0.99), stability::kStepInstructions);
    EXPECT_GE(of_bound, 0.5) << "a bound that nothing comes near catches nothing";
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
