#include "rt/quantile.hpp"
#include "tools/measure/bench/table1.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>

#include "perception/simd/isa.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/measure/bench/bench_pool.hpp"
#include "tools/measure/bench/other_load.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

namespace {

// Of this process.
double resident_bytes() {
  std::ifstream statm("/proc/self/statm");
  double size = 0, resident = 0;
  statm >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

Table1Row::Figures figures(const std::vector<double>& v) {
  return {rt::quantile_or_nan(v, 0.5), rt::quantile_or_nan(v, 0.95), rt::quantile_or_nan(v, 1.0)};
}

// What one row is made of.
struct Cube {
  int edge;
  bool fixed_voxel;
};

tasks::FusionConfig config_of(const Cube& cube, bool recording) {
  tasks::FusionConfig config;
  // A cube of 5.12 m at 10 mm is 8^3 chunks; the room of the synthetic sequence holds more surface.
  config.tsdf.max_blocks = recording ? 10240 : 12288;
  config.tsdf.max_chunks = 768;
  config.tsdf.far_store_kib = 0;  // nothing of the cube is far
  config.tsdf.voxel_size_m = 5.12 / cube.edge;
  config.tsdf.truncation_m = 0.05;  // the map raises it to 2.1 voxels
  config.view_period_frames = 0;
  if (cube.fixed_voxel) {
    config.tsdf.voxel_size_m = Table1Row::kFixedVoxel_m;
    config.tsdf.volume_m = Table1Row::kFixedVoxel_m * cube.edge;
    // What lies behind the cube is no reading, or all of it would count against the tracking.
    const double depth_m = std::min(config.tsdf.max_depth_m, config.tsdf.volume_m);
    config.tsdf.max_depth_m = config.tracker.preprocess.depth_max_m = depth_m;
    // No more than the cube can hold; chunks need not lie along its faces.
    const int blocks = cube.edge / 8 + 1, chunks = cube.edge / 64 + 1;
    config.tsdf.max_blocks = std::min(config.tsdf.max_blocks, blocks * blocks * blocks);
    config.tsdf.max_chunks = std::min(config.tsdf.max_chunks, chunks * chunks * chunks);
  }
  return config;
}

// Names an object: marks the surface at a place of the image whenever no object was seen for half a
// second. What is there may be what things stand on, or nothing: then the next place is tried in
// the next frame.
class Toucher {
 public:
  void before(const tasks::FusionTask& task, const perception::RgbdFrame& frame, int i,
              tasks::FusionTask::In& in) {
    if (i >= 5 && i - seen_ >= 15 && i - touched_ >= 15) {
      if (const auto p_C = next_reading(frame)) {
        // The pose of the frame before: a few millimetres off, as a hand's touch is.
        point_W_ = task.camera() * *p_C;
        touched_ = i;
        ++touches;
      }
    }
    in.hand.mark_seq = static_cast<std::uint64_t>(touches);
    in.hand.p_mark_W = point_W_;
  }
  // Whether a mask was made.
  bool after(const tasks::FusionTask::Out& out, int i) {
    const auto answer = out.segmentation.answer;
    if (answer != perception::TouchAnswer::kNone && answer != perception::TouchAnswer::kObject) {
      ++place_;
      touched_ = -100;
    }
    if (out.segmentation.mask_pixels == 0) return false;
    seen_ = i;
    return true;
  }
  int touches = 0;

 private:
  // From the middle of the image outwards, as shares of its size.
  static constexpr std::array<std::array<double, 2>, 17> kPlaces{{{0.50, 0.50},
                                                                  {0.50, 0.38},
                                                                  {0.38, 0.50},
                                                                  {0.62, 0.50},
                                                                  {0.50, 0.62},
                                                                  {0.38, 0.38},
                                                                  {0.62, 0.38},
                                                                  {0.38, 0.62},
                                                                  {0.62, 0.62},
                                                                  {0.25, 0.50},
                                                                  {0.75, 0.50},
                                                                  {0.50, 0.25},
                                                                  {0.50, 0.75},
                                                                  {0.25, 0.30},
                                                                  {0.75, 0.30},
                                                                  {0.25, 0.70},
                                                                  {0.75, 0.70}}};
  std::optional<perception::Vec3> next_reading(const perception::RgbdFrame& frame) {
    const auto& k = frame.intrinsics;
    for (std::size_t n = 0; n < kPlaces.size(); ++n, ++place_) {
      const auto& at = kPlaces[place_ % kPlaces.size()];
      const int u = static_cast<int>(at[0] * k.width), v = static_cast<int>(at[1] * k.height);
      const std::uint16_t mm = frame.depth().at(u, v);
      if (mm != 0 && mm != 65535) return k.unproject(u, v, 1e-3 * mm);
    }
    return std::nullopt;
  }

  int seen_ = -100, touched_ = -100;
  std::size_t place_ = 0;
  perception::Vec3 point_W_ = perception::Vec3::Zero();
};

// Times of one frame, ms.
struct FrameTimes {
  double own_cpu = 0, way_through = 0, worker_cpu = 0, real_wall = 0, forks = 0;
};

// Runs one step; with a crew the way through is longer than this thread's CPU where the worker took
// longer, and by each fork.
template <class Step>
FrameTimes timed(BenchPool* crew, Step&& step) {
  const std::int64_t beyond = crew != nullptr ? crew->pool().beyond_ns() : 0;
  const std::uint64_t forks = crew != nullptr ? crew->pool().forks() : 0;
  if (crew != nullptr) crew->pool().begin_job();
  const std::int64_t wall = rt::monotonic_ns(), cpu = rt::thread_cpu_ns();
  step();
  FrameTimes t;
  t.own_cpu = 1e-6 * static_cast<double>(rt::thread_cpu_ns() - cpu);
  t.real_wall = 1e-6 * static_cast<double>(rt::monotonic_ns() - wall);
  t.way_through = t.own_cpu;
  if (crew == nullptr) return t;
  t.forks = static_cast<double>(crew->pool().forks() - forks);
  t.worker_cpu = 1e-6 * static_cast<double>(crew->workers_cpu_ns());
  t.way_through += 1e-6 * (static_cast<double>(crew->pool().beyond_ns() - beyond) +
                           t.forks * static_cast<double>(crew->round_trip_ns()));
  return t;
}

// Of one pass, from its first frame that counts.
struct PerFrame {
  std::vector<double> total_ms;
  std::vector<bool> followed;
};

// What the frames of a pass took, ms each.
struct PassTimes {
  std::vector<double> whole, followed, object;
  std::vector<double> real_wall, own_cpu, worker_cpu, forks;
  std::array<std::vector<double>, Table1Row::kStages> stages;

  void add(const tasks::FusionTask::Profile& p, const FrameTimes& times, bool segmented) {
    const auto& f = p.integrate_parts;
    const double total = times.way_through;
    std::array<double, Table1Row::kStages> ms{};
    const std::int64_t ns[] = {p.prepare, p.track,   f.ready,  f.allocate, f.update,
                               f.carve,   p.raycast, p.ground, p.cost_map, p.patch};
    double sum = 0;
    for (std::size_t s = 0; s < std::size(ns); ++s)
      sum += ms[s] = 1e-6 * static_cast<double>(ns[s]);
    ms.back() = total - sum;
    whole.push_back(total);
    real_wall.push_back(times.real_wall);
    own_cpu.push_back(times.own_cpu);
    worker_cpu.push_back(times.worker_cpu);
    forks.push_back(times.forks);
    if (segmented) {
      followed.push_back(total);
      object.push_back(1e-6 * static_cast<double>(p.objects));
    }
    for (std::size_t s = 0; s < ms.size(); ++s) stages[s].push_back(ms[s]);
  }
  void fill(Table1Row& row) const {
    row.frame = figures(whole);
    row.with_object = figures(followed);
    row.object = figures(object);
    row.followed = static_cast<int>(followed.size());
    for (std::size_t s = 0; s < stages.size(); ++s) row.stages[s] = figures(stages[s]);
    row.two.real_wall = figures(real_wall);
    row.two.own_cpu = figures(own_cpu);
    row.two.worker_cpu = figures(worker_cpu);
    row.two.forks = rt::quantile_or_nan(forks, 0.5);
  }
};

void fill_memory(const tasks::FusionTask& task, const FusionSequence& sequence, Table1Row& row) {
  constexpr double kMiB = 1.0 / 1048576.0;
  row.keyframes_MiB = kMiB * static_cast<double>(task.keyframes().memory_bytes());
  row.memory_MiB =
      row.keyframes_MiB +
      kMiB * static_cast<double>(task.map().memory_bytes() + 4 * sizeof(perception::SurfacePatch));
  row.rss_MiB = kMiB * (resident_bytes() - static_cast<double>(sequence.bytes()));
  row.blocks = task.map().block_count();
}

// One pass over the sequence; with a crew in `two` instead of in the figures of one thread.
Table1Row pass(const FusionSequence& sequence, const Cube& cube, int first_frame, bool with_object,
               BenchPool* crew = nullptr, PerFrame* frames = nullptr) {
  rt::Startup startup;
  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics;
  tasks::FusionConfig config = config_of(cube, sequence.name == "recording");
  config.objects.enabled = with_object;
  tasks::FusionTask task(startup.token(), config, setup);
  Toucher toucher;
  task.profile(true);
  if (crew != nullptr) task.use(crew->pool());
  FusionFeed feed(task);
  feed.in.hand.seq = 1;
  feed.in.hand.p_WH = perception::Vec3(0, 0, 1.5);  // in front of the first camera
  ClaimedError error;
  Table1Row row;
  row.sequence = sequence.name;
  row.isa = perception::simd::name_of(perception::simd::chosen());
  row.edge = cube.edge;
  row.fixed_voxel = cube.fixed_voxel;
  row.frames = sequence.size();
  PassTimes took;
  OtherLoad others;
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, feed.frame());
    if (with_object) toucher.before(task, feed.frame(), i, feed.in);
    const FrameTimes times = timed(crew, [&] { feed.step(); });
    const tasks::FusionTask::Out& out = feed.out();
    row.refused += out.integration.blocks_refused;
    if (out.camera_written && out.camera.claimed) {
      ++row.claimed;
      if (const perception::Pose* truth = sequence.truth(i)) error.add(out.camera.X_WC, *truth);
    }
    const bool segmented = with_object && toucher.after(out, i);
    if (i < first_frame) continue;
    took.add(task.last_profile(), times, segmented);
    if (frames == nullptr) continue;
    frames->total_ms.push_back(times.way_through);
    frames->followed.push_back(segmented);
  }
  row.other_load = others.cores();
  took.fill(row);
  row.touches = toucher.touches;
  row.ate_mm = row.claimed >= Table1Row::kClaimedShare * row.frames
                   ? error.ate_mm()
                   : std::numeric_limits<double>::quiet_NaN();
  fill_memory(task, sequence, row);
  return row;
}

Table1Row::Figures median_of(const std::vector<Table1Row::Figures>& runs) {
  Table1Row::Figures out;
  for (double Table1Row::Figures::*member :
       {&Table1Row::Figures::p50, &Table1Row::Figures::p95, &Table1Row::Figures::max}) {
    std::vector<double> v;
    for (const auto& f : runs) v.push_back(f.*member);
    out.*member = rt::quantile_or_nan(v, 0.5);
  }
  return out;
}

template <class Get>
Table1Row::Figures over(const std::vector<Table1Row>& passes, Get&& get) {
  std::vector<Table1Row::Figures> f;
  for (const auto& r : passes) f.push_back(get(r));
  return median_of(f);
}

// The passes with a worker beside.
void add_two_threads(const FusionSequence& sequence, const Table1Options& options, Table1Row& row) {
  const Cube cube{row.edge, row.fixed_voxel};
  BenchPool crew(1);
  std::vector<Table1Row> plain, touched;
  for (int n = 0; n < options.runs; ++n) {
    plain.push_back(pass(sequence, cube, options.first_frame, false, &crew));
    if (sequence.has_colour)
      touched.push_back(pass(sequence, cube, options.first_frame, true, &crew));
  }
  row.two = plain.back().two;
  row.two.fork_us = 1e-3 * static_cast<double>(crew.round_trip_ns());
  row.two.real_time = crew.real_time();
  row.two.wall = over(plain, [](const Table1Row& r) { return r.frame; });
  row.two.real_wall = over(plain, [](const Table1Row& r) { return r.two.real_wall; });
  row.two.own_cpu = over(plain, [](const Table1Row& r) { return r.two.own_cpu; });
  row.two.worker_cpu = over(plain, [](const Table1Row& r) { return r.two.worker_cpu; });
  if (!touched.empty())
    row.two.wall_with_object = over(touched, [](const Table1Row& r) { return r.with_object; });
  for (std::size_t s = 0; s < row.stages.size(); ++s)
    row.two.stages[s] = over(plain, [s](const Table1Row& r) { return r.stages[s]; });
  for (const auto& r : plain) row.other_load = std::max(row.other_load, r.other_load);
}

// What each frame with an object took more than the same frame without.
std::vector<double> differences(const PerFrame& with, const PerFrame& without) {
  std::vector<double> more;
  for (std::size_t i = 0; i < with.total_ms.size(); ++i)
    if (with.followed[i]) more.push_back(with.total_ms[i] - without.total_ms[i]);
  return more;
}

Table1Row row_of(const FusionSequence& sequence, const Cube& cube, const Table1Options& options) {
  std::vector<Table1Row> runs, touched;
  std::vector<Table1Row::Figures> more;
  for (int n = 0; n < options.runs; ++n) {
    PerFrame without, with;
    runs.push_back(pass(sequence, cube, options.first_frame, false, nullptr, &without));
    if (!sequence.has_colour) continue;
    touched.push_back(pass(sequence, cube, options.first_frame, true, nullptr, &with));
    more.push_back(figures(differences(with, without)));
  }
  Table1Row row = runs.back();
  const auto over_runs = [&](auto get) { return over(runs, get); };
  row.frame = over_runs([](const Table1Row& r) { return r.frame; });
  if (!touched.empty()) {
    row.with_object = over(touched, [](const Table1Row& r) { return r.with_object; });
    row.object = over(touched, [](const Table1Row& r) { return r.object; });
    row.object_more = median_of(more);
    row.followed = touched.back().followed;
    row.touches = touched.back().touches;
    for (const auto& r : touched) row.other_load = std::max(row.other_load, r.other_load);
  }
  for (std::size_t s = 0; s < row.stages.size(); ++s) {
    row.stages[s] = over_runs([s](const Table1Row& r) { return r.stages[s]; });
  }
  for (const auto& r : runs) row.other_load = std::max(row.other_load, r.other_load);
  if (options.two_threads) add_two_threads(sequence, options, row);
  return row;
}

}  // namespace

Table1Result bench_table1(std::ostream& progress, const Table1Options& options) {
  if (options.isas.empty() || !perception::simd::choose(options.isas.front())) {
    throw std::runtime_error("--isa " + (options.isas.empty() ? "" : options.isas.front()) +
                             ": must be auto, scalar, sse4, avx2 or avx512, and this machine's");
  }
  std::vector<FusionSequence> sequences;
  if (!options.rgbd.empty()) {
    progress << "reading " << options.rgbd << "\n";
    sequences.push_back(recorded_sequence(
        progress, options.rgbd, {options.frames, options.first_frame + 2, options.pinhole}));
  }
  if (options.synthetic) {
    progress << "rendering the synthetic room\n";
    rt::Startup startup;
    sequences.push_back(synthetic_sequence(startup.token(), furnished_room(), options.frames));
  }
  Table1Result result;
  for (const auto& sequence : sequences) {
    for (const int edge : options.edges) {
      progress << sequence.name << " " << edge << "^3\n";
      result.rows.push_back(row_of(sequence, {edge, false}, options));
    }
    Table1Options once = options;
    once.runs = 1;
    once.two_threads = false;
    for (std::size_t n = 1; n < options.isas.size(); ++n) {
      if (!perception::simd::choose(options.isas[n])) continue;  // not on this machine
      progress << sequence.name << " " << options.edges.back() << "^3 " << options.isas[n] << "\n";
      result.rows.push_back(row_of(sequence, {options.edges.back(), false}, once));
      result.rows.back().beside = true;
    }
    static_cast<void>(perception::simd::choose(options.isas.front()));
    for (const int edge : options.edges) {
      if (!options.fixed_voxel) break;
      progress << sequence.name << " cube of " << edge << " x 10 mm\n";
      result.rows.push_back(row_of(sequence, {edge, true}, options));
    }
  }
  return result;
}

}  // namespace teletact
