// Fusion with and without pool workers: the same bytes, whatever the number of threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <thread>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "perception/simd/isa.hpp"
#include "rt/hash.hpp"
#include "rt/sched/worker_pool.hpp"
#include "tests/support/tsan_libraries.hpp"
#include "tests/unit/tasks_fusion/hall.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"

namespace tasks {
namespace {

using tests::AnalyticScene;
using tests::kDt;

// A pool with its threads; 0 workers: none.
class Crew {
 public:
  explicit Crew(int workers) : pool(startup_.token(), workers) {
    for (int w = 0; w < workers; ++w) threads_.emplace_back([this, w] { pool.serve(w); });
  }
  ~Crew() {
    pool.stop();
    for (auto& t : threads_) t.join();
  }

 private:
  rt::Startup startup_;

 public:
  rt::WorkerPool pool;

 private:
  std::vector<std::thread> threads_;
};

// Everything that a frame leaves behind.
void add_frame(rt::Hash64& h, const FusionTask& task, const FusionTask::Out& out) {
  const auto& t = out.tracking;
  h.bytes(out.camera.X_WC.data(), 16 * sizeof(double));
  h.bytes(&t.residual_m, sizeof t.residual_m);
  h.bytes(&t.condition, sizeof t.condition);
  h.bytes(t.degenerate_W.data(), 36 * sizeof(double));
  h.word(static_cast<std::uint64_t>(t.inliers));
  h.word(static_cast<std::uint64_t>(t.state));
  h.word(out.camera.claimed ? 1 : 0);
  h.word(task.map().checksum());
  h.word(out.patch->checksum);
  if (out.view_written) {
    h.bytes(out.view->colour.data(), out.view->colour.size() * sizeof out.view->colour[0]);
    h.bytes(out.view->points.data(), out.view->points.size() * sizeof out.view->points[0]);
    h.bytes(out.view->object.data(), out.view->object.size());
  }
  const auto& s = out.integration;
  for (const std::int64_t n :
       {std::int64_t{s.pixels}, std::int64_t{s.rays}, std::int64_t{s.blocks_new},
        std::int64_t{s.blocks_refused}, std::int64_t{s.chunks_refused},
        std::int64_t{s.blocks_updated}, s.voxels_fused, s.voxels_carved, s.free_tests,
        std::int64_t{s.blocks_fetched}, std::int64_t{out.paging.put_away},
        std::int64_t{out.paging.brought_back}})
    h.word(static_cast<std::uint64_t>(n));
  h.word(out.work);
}

struct Drive {
  std::vector<std::uint64_t> frames;  // hash after each
  std::uint64_t forks = 0, most_forks = 0;
  int claimed = 0;
};

// Camera, motion, noise and furniture by the seed; a leap in the midst (lost, then looked for), a
// bare frame.
Drive random_drive(std::uint64_t seed, int workers, int frames, FusionConfig config) {
  rt::Random random(seed);
  AnalyticScene scene = tests::test_room();
  for (int n = 0; n < 3; ++n) {
    Pose X = Pose::Identity();
    X.linear() = Eigen::AngleAxisd(3 * random.uniform(), Vec3::UnitZ()).toRotationMatrix();
    X.translation() =
        Vec3(random.uniform(0.8, 1.6), random.uniform(-0.8, 0.8), random.uniform(0, 0.6));
    scene.boxes.push_back({X, Vec3(0.1, 0.15, 0.1)});
  }
  const Vec3 v(random.uniform(-0.008, 0.008), random.uniform(-0.008, 0.008), 0.002);
  const auto at = [&](int i) {
    const Vec3 eye = Vec3(-0.2, 0.1, 0.9) + i * v;
    return tests::look_at(eye, Vec3(1.8, -0.05 + 0.01 * i, 0.3));
  };
  Crew crew(workers);
  tests::Rig rig(config, at(0));
  rig.random = rt::Random(seed + 1);
  rig.task->use(crew.pool);
  Drive d;
  rt::Hash64 h;
  for (int i = 0; i < frames; ++i) {
    const std::uint64_t before = crew.pool.forks();
    const bool dark = i == frames / 2, away = i >= frames - 3;
    rig.see(dark ? AnalyticScene{} : scene, at(away ? i + 150 : i), 0.002, i % 5 == 4 ? 1 : 0);
    d.most_forks = std::max(d.most_forks, crew.pool.forks() - before);
    d.claimed += rig.out.camera.claimed ? 1 : 0;
    add_frame(h, *rig.task, rig.out);
    d.frames.push_back(h.digest());
  }
  d.forks = crew.pool.forks();
  return d;
}

TEST(FusionPool, RandomFramesGiveTheSameBytes) {
  for (const std::uint64_t seed : {31U, 32U, 33U}) {
    FusionConfig config = tests::coarse();
    if (seed == 32) config.tsdf.max_blocks = 900;  // the pool fills up
    if (seed == 33) config.tsdf.voxel_size_m = 0.01;
    const Drive alone = random_drive(seed, 0, 12, config);
    EXPECT_EQ(alone.forks, 0U);
    if (seed != 32) {
      EXPECT_GE(alone.claimed, 6);
    }
    for (const int workers : {1, 2, 4}) {
      const Drive shared = random_drive(seed, workers, 12, config);
      EXPECT_EQ(shared.frames, alone.frames) << "seed " << seed << ", " << workers << " workers";
      EXPECT_GT(shared.forks, 0U);
      EXPECT_LE(shared.most_forks, 30U) << "admission reserves for kForksPerImage";
      std::printf("  seed %u, %d workers: %d of 12 claimed, at most %u forks a frame\n",
                  static_cast<unsigned>(seed), workers, shared.claimed,
                  static_cast<unsigned>(shared.most_forks));
    }
  }
}

// The scalar reference too: other loops under the same cut.
TEST(FusionPool, ScalarReferenceGivesTheSameBytes) {
  ASSERT_TRUE(perception::simd::choose("scalar"));
  const Drive alone = random_drive(41, 0, 5, tests::coarse());
  const Drive shared = random_drive(41, 1, 5, tests::coarse());
  ASSERT_TRUE(perception::simd::choose("auto"));
  EXPECT_EQ(shared.frames, alone.frames);
}

// Through a passage until its beginning is put away; a dark image, then it is there again: what a
// keyframe shows has to come back from the far store before it can be found.
struct Passage {
  std::vector<std::uint64_t> frames;  // hash after each
  int put_away = 0, found_after = 0;  // chunks; frames
  int claimed = 0;                    // of the drive's 90 frames, which begins at full speed
  int far_blocks = 0, fetched = 0;    // before the search; of them brought back by it
  double off_m = 0;
  std::uint64_t forks = 0;
};

Passage passage(int workers) {
  const AnalyticScene s = tests::passage(8);
  const auto way = [](double x) {
    return tests::look_at(Vec3(x, 0.1 * std::sin(x), 0.9), Vec3(x + 1.5, 0, 0.2));
  };
  FusionConfig config = tests::coarse();
  config.tsdf.max_depth_m = config.tracker.preprocess.depth_max_m = 2.0;
  config.tsdf.far_m = 3.0;
  config.tsdf.far_store_kib = 4096;
  config.tsdf.decay_half_life_s = 20;
  Crew crew(workers);
  tests::Rig rig(config, way(0));
  rig.task->use(crew.pool);
  Passage p;
  rt::Hash64 h;
  const auto see = [&](const AnalyticScene& scene, const Pose& X_WC) {
    rig.see(scene, X_WC, 0.001);
    p.put_away += rig.out.paging.put_away;
    p.claimed += rig.out.camera.claimed && p.frames.size() < 90 ? 1 : 0;
    add_frame(h, *rig.task, rig.out);
    p.frames.push_back(h.digest());
  };
  for (int i = 0; i < 90; ++i) see(s, way(0.06 * i));
  for (int i = 0; i <= config.blank_frames; ++i) see(AnalyticScene{}, way(0));
  p.far_blocks = rig.task->map().far_block_count();
  do {
    ++p.found_after;
    p.fetched = p.far_blocks - rig.task->map().far_block_count();
    see(s, way(0.07));
  } while (!rig.out.camera.claimed && p.found_after < 30);
  for (int i = 0; i < 3; ++i) see(s, way(0.07));
  p.off_m = (rig.task->camera().translation() - way(0.07).translation()).norm();
  p.forks = crew.pool.forks();
  return p;
}

TEST(FusionPool, FarBlocksThatComeBackForALostCameraGiveTheSameBytes) {
  const Passage alone = passage(0);
  std::printf(
      "  %d chunks put away; %d of %d blocks brought back; found after %d frames, %.1f mm off\n",
      alone.put_away, alone.fetched, alone.far_blocks, alone.found_after, 1e3 * alone.off_m);
  EXPECT_GE(alone.claimed, 89) << "from the first frame on";
  EXPECT_GT(alone.put_away, 0);
  EXPECT_GT(alone.fetched, 0) << "before the frame that claims";
  EXPECT_LT(alone.found_after, 30);
  EXPECT_LT(alone.off_m, tests::kWrong_m);
  const Passage shared = passage(1);
  EXPECT_EQ(shared.frames, alone.frames);
  EXPECT_GT(shared.forks, 0U);
}

std::vector<std::uint64_t> recorded(int workers, int frames) {
  rt::Startup startup;
  drivers::TumOptions options;
  options.to_512x424 = true;
  auto opened = drivers::TumSequence::open(tests::recording_folder(), options);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error());
  FusionSetup setup;
  setup.camera = opened.value().intrinsics();
  FusionConfig config;
  config.tsdf.max_blocks = 8192;
  config.tsdf.max_chunks = 768;
  Crew crew(workers);
  FusionTask task(startup.token(), config, setup);
  task.use(crew.pool);
  auto frame = std::make_unique<perception::RgbdFrame>();
  auto patch = std::make_unique<perception::SurfacePatch>();
  auto view = std::make_unique<SceneView>();
  std::vector<std::uint64_t> hashes;
  rt::Hash64 h;
  for (int i = 0; i < frames; ++i) {
    EXPECT_TRUE(opened.value().read(3 * i, *frame));
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(i);
    tick.start = tick.release = frame->exposure;
    FusionTask::In in;
    in.frame = frame.get();
    in.frame_fresh = true;
    FusionTask::Out out;
    out.patch = patch.get();
    out.view = view.get();
    static_cast<void>(task.step(tick, in, out));
    EXPECT_TRUE(out.camera.claimed) << i;
    add_frame(h, task, out);
    hashes.push_back(h.digest());
  }
  return hashes;
}

TEST(FusionPool, RecordedFramesGiveTheSameBytes) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording beside the repository";
  const auto alone = recorded(0, 10);
  EXPECT_EQ(recorded(1, 10), alone);
  EXPECT_EQ(recorded(3, 10), alone);
}

}  // namespace
}  // namespace tasks
