#include "tools/bench/table1.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <stdexcept>

#include "perception/simd/isa.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/bench/fusion_sequence.hpp"
#include "tools/bench/other_load.hpp"

namespace teletact {

const std::array<const char*, Table1Row::kStages> Table1Row::kStageNames{
    "filter+pyramid", "ICP",    "fuse: ready", "fuse: allocate", "fuse: update", "fuse: carve",
    "ray cast",       "ground", "cost map",    "patch",          "rest"};

namespace {

// Paper, Table 1: total and, of it, segmentation with fusion, ms a frame on a GTX 670.
struct Paper {
  int edge;
  double total_ms, fusion_ms;
};
constexpr Paper kPaper[] = {
    {64, 16.4, 11.8}, {128, 20.3, 14.3}, {256, 22.2, 15.5}, {384, 31.9, 22.5}, {512, 38.8, 27.3}};

double quantile(std::vector<double> v, double q) {
  if (v.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())))];
}

Table1Row::Figures figures(const std::vector<double>& v) {
  return {quantile(v, 0.5), quantile(v, 0.95), quantile(v, 1.0)};
}

tasks::FusionConfig config_of(int edge, bool recording) {
  tasks::FusionConfig config;
  // A cube of 5.12 m at 10 mm is 8^3 chunks; the room of the synthetic sequence holds more surface.
  config.tsdf.max_blocks = recording ? 10240 : 12288;
  config.tsdf.max_chunks = 768;
  config.tsdf.far_store_kib = 0;  // nothing of the cube is far
  config.tsdf.voxel_size_m = 5.12 / edge;
  config.tsdf.truncation_m = 0.05;  // the map raises it to 2.1 voxels
  config.view_period_frames = 0;
  return config;
}

// Marks the surface in the middle of the image whenever no object was seen for half a second.
class Toucher {
 public:
  void before(const tasks::FusionTask& task, const perception::RgbdFrame& frame, int i,
              tasks::FusionTask::In& in) {
    if (i >= 5 && i - seen_ >= 15 && i - touched_ >= 15) {
      const auto& k = frame.intrinsics;
      const int centre_u = k.width / 2, centre_v = k.height / 2;
      const std::uint16_t mm = frame.depth().at(centre_u, centre_v);
      if (mm != 0 && mm != 65535) {
        // The pose of the frame before: a few millimetres off, as a hand's touch is.
        point_W_ = task.camera() * k.unproject(centre_u, centre_v, 1e-3 * mm);
        touched_ = i;
        ++touches;
      }
    }
    in.hand.mark_seq = static_cast<std::uint64_t>(touches);
    in.hand.p_mark_W = point_W_;
  }
  // Whether a mask was made.
  bool after(const tasks::FusionTask::Out& out, int i) {
    if (out.segmentation.mask_pixels == 0) return false;
    seen_ = i;
    return true;
  }
  int touches = 0;

 private:
  int seen_ = -100, touched_ = -100;
  perception::Vec3 point_W_ = perception::Vec3::Zero();
};

// One pass over the sequence.
Table1Row pass(const FusionSequence& sequence, int edge, int first_frame, bool with_object) {
  rt::Startup startup;
  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics;
  tasks::FusionConfig config = config_of(edge, sequence.name == "recording");
  config.objects.enabled = with_object;
  tasks::FusionTask task(startup.token(), config, setup);
  Toucher toucher;
  std::vector<double> followed, object;
  task.profile(true);
  auto frame = std::make_unique<perception::RgbdFrame>();
  auto patch = std::make_unique<perception::SurfacePatch>();
  auto cost_map = std::make_unique<perception::CostMap>();
  Table1Row row;
  row.sequence = sequence.name;
  row.isa = perception::simd::name_of(perception::simd::chosen());
  row.edge = edge;
  row.frames = sequence.size();
  std::vector<double> whole;
  std::array<std::vector<double>, Table1Row::kStages> stages;
  perception::Pose X_WT = perception::Pose::Identity();
  double squares = 0;
  OtherLoad others;
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, *frame);
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(i);
    tick.release = tick.start = frame->exposure;
    tasks::FusionTask::In in;
    in.frame = frame.get();
    in.frame_fresh = true;
    in.hand.seq = 1;
    in.hand.p_WH = perception::Vec3(0, 0, 1.5);  // in front of the first camera
    if (with_object) toucher.before(task, *frame, i, in);
    tasks::FusionTask::Out out;
    out.patch = patch.get();
    out.cost_map = cost_map.get();
    timespec before{}, after{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &before);
    static_cast<void>(task.step(tick, in, out));
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &after);
    row.refused += out.integration.blocks_refused;
    if (out.camera_written && out.camera.claimed) {
      const auto at = static_cast<std::size_t>(i);
      if (!sequence.truth_WC.empty()) {
        if (row.claimed == 0) X_WT = sequence.truth_WC[at] * out.camera.X_WC.inverse();
        squares += ((X_WT * out.camera.X_WC).translation() - sequence.truth_WC[at].translation())
                       .squaredNorm();
      }
      ++row.claimed;
    }
    const bool segmented = with_object && toucher.after(out, i);
    if (i < first_frame) continue;
    const auto& p = task.last_profile();
    const auto& f = p.integrate_parts;
    const double total = 1e3 * static_cast<double>(after.tv_sec - before.tv_sec) +
                         1e-6 * static_cast<double>(after.tv_nsec - before.tv_nsec);
    std::array<double, Table1Row::kStages> ms{};
    const std::int64_t ns[] = {p.prepare, p.track,   f.ready,  f.allocate, f.update,
                               f.carve,   p.raycast, p.ground, p.cost_map, p.patch};
    double sum = 0;
    for (std::size_t s = 0; s < std::size(ns); ++s)
      sum += ms[s] = 1e-6 * static_cast<double>(ns[s]);
    ms.back() = total - sum;
    whole.push_back(total);
    if (segmented) {
      followed.push_back(total);
      object.push_back(1e-6 * static_cast<double>(p.objects));
    }
    for (std::size_t s = 0; s < ms.size(); ++s) stages[s].push_back(ms[s]);
  }
  row.other_load = others.cores();
  row.frame = figures(whole);
  row.with_object = figures(followed);
  row.object = figures(object);
  row.followed = static_cast<int>(followed.size());
  row.touches = toucher.touches;
  for (std::size_t s = 0; s < stages.size(); ++s) row.stages[s] = figures(stages[s]);
  row.ate_mm = sequence.truth_WC.empty() || row.claimed == 0
                   ? std::numeric_limits<double>::quiet_NaN()
                   : 1e3 * std::sqrt(squares / row.claimed);
  constexpr double kMiB = 1.0 / 1048576.0;
  row.memory_MiB =
      kMiB * static_cast<double>(task.map().memory_bytes() + 4 * sizeof(perception::SurfacePatch));
  row.blocks = task.map().block_count();
  return row;
}

Table1Row::Figures median_of(const std::vector<Table1Row::Figures>& runs) {
  Table1Row::Figures out;
  for (double Table1Row::Figures::*member :
       {&Table1Row::Figures::p50, &Table1Row::Figures::p95, &Table1Row::Figures::max}) {
    std::vector<double> v;
    for (const auto& f : runs) v.push_back(f.*member);
    out.*member = quantile(v, 0.5);
  }
  return out;
}

Table1Row row_of(const FusionSequence& sequence, int edge, const Table1Options& options) {
  std::vector<Table1Row> runs;
  for (int n = 0; n < options.runs; ++n)
    runs.push_back(pass(sequence, edge, options.first_frame, false));
  Table1Row row = runs.back();
  std::vector<Table1Row> touched;
  for (int n = 0; n < options.runs && sequence.has_colour; ++n)
    touched.push_back(pass(sequence, edge, options.first_frame, true));
  const auto over = [](const std::vector<Table1Row>& passes, auto get) {
    std::vector<Table1Row::Figures> f;
    for (const auto& r : passes) f.push_back(get(r));
    return median_of(f);
  };
  const auto over_runs = [&](auto get) { return over(runs, get); };
  row.frame = over_runs([](const Table1Row& r) { return r.frame; });
  if (!touched.empty()) {
    row.with_object = over(touched, [](const Table1Row& r) { return r.with_object; });
    row.object = over(touched, [](const Table1Row& r) { return r.object; });
    row.followed = touched.back().followed;
    row.touches = touched.back().touches;
    for (const auto& r : touched) row.other_load = std::max(row.other_load, r.other_load);
  }
  for (std::size_t s = 0; s < row.stages.size(); ++s) {
    row.stages[s] = over_runs([s](const Table1Row& r) { return r.stages[s]; });
  }
  for (const auto& r : runs) row.other_load = std::max(row.other_load, r.other_load);
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
    sequences.push_back(recorded_sequence(options.rgbd, options.frames));
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
      result.rows.push_back(row_of(sequence, edge, options));
    }
    Table1Options once = options;
    once.runs = 1;
    for (std::size_t n = 1; n < options.isas.size(); ++n) {
      if (!perception::simd::choose(options.isas[n])) continue;  // not on this machine
      progress << sequence.name << " " << options.edges.back() << "^3 " << options.isas[n] << "\n";
      result.rows.push_back(row_of(sequence, options.edges.back(), once));
      result.rows.back().beside = true;
    }
    static_cast<void>(perception::simd::choose(options.isas.front()));
  }
  return result;
}

void Table1Result::print(std::ostream& out) const {
  char line[256];
  out << "Table 1: ms a frame, cube of 5.12 m; CPU of our frame, one thread; the paper's GTX 670 "
         "beside\n"
         "sequence     N^3  voxel    isa | paper total  fusion | ours p50    p95    max | claimed  "
         "ATE mm "
         "| "
         "blocks  MiB\n";
  for (const auto& r : rows) {
    const auto* paper = std::find_if(std::begin(kPaper), std::end(kPaper),
                                     [&](const Paper& p) { return p.edge == r.edge; });
    const bool known = paper != std::end(kPaper);
    std::snprintf(
        line, sizeof line,
        "%-10s %5d %4.0f mm %6s | %11.1f %7.1f | %8.2f %6.2f %6.2f | %3d/%3d %7.1f | %6d %5.1f%s\n",
        r.sequence.c_str(), r.edge, 5120.0 / r.edge, r.isa.c_str(), known ? paper->total_ms : 0,
        known ? paper->fusion_ms : 0, r.frame.p50, r.frame.p95, r.frame.max, r.claimed, r.frames,
        r.ate_mm, r.blocks, r.memory_MiB, r.measured() ? "" : "  (not measured: others' load)");
    out << line;
    if (!r.measured()) {
      std::snprintf(line, sizeof line, "           others used %.2f of a core, 0.05 is allowed\n",
                    r.other_load);
      out << line;
    }
  }
  out << "\nwith one object segmented and followed, ms a frame\n";
  for (const auto& r : rows) {
    if (r.followed == 0) continue;
    std::snprintf(line, sizeof line,
                  "%-10s %5d %6s | frame %6.2f p95 %6.2f max %6.2f | of it the object %5.2f p95 "
                  "%5.2f max %5.2f | %d frames, %d touches\n",
                  r.sequence.c_str(), r.edge, r.isa.c_str(), r.with_object.p50, r.with_object.p95,
                  r.with_object.max, r.object.p50, r.object.p95, r.object.max, r.followed,
                  r.touches);
    out << line;
  }
  out << "\nstages, p50 (p95) ms\n";
  for (const auto& r : rows) {
    std::snprintf(line, sizeof line, "%s %d^3 %s:", r.sequence.c_str(), r.edge, r.isa.c_str());
    out << line;
    for (std::size_t s = 0; s < r.stages.size(); ++s) {
      std::snprintf(line, sizeof line, "%s %s %.2f (%.2f)", s == 0 ? "" : ",",
                    Table1Row::kStageNames[s], r.stages[s].p50, r.stages[s].p95);
      out << line;
    }
    out << "\n";
  }
}

std::vector<BenchMetric> Table1Result::metrics() const {
  std::vector<BenchMetric> m;
  for (const auto& r : rows) {
    const std::string row = "table1." + (r.sequence == "recording" ? "" : r.sequence + ".") +
                            (r.beside ? r.isa + "." : "") + std::to_string(r.edge);
    m.push_back({row + ".fusion_cpu_ms", r.frame.p50, "ms"});
    m.push_back({row + ".fusion_cpu_p95_ms", r.frame.p95, "ms"});
    m.push_back({row + ".fusion_cpu_max_ms", r.frame.max, "ms"});
    if (r.followed > 0) {
      m.push_back({row + ".seg_fusion_cpu_ms", r.with_object.p50, "ms"});
      m.push_back({row + ".seg_fusion_cpu_p95_ms", r.with_object.p95, "ms"});
      m.push_back({row + ".seg_fusion_cpu_max_ms", r.with_object.max, "ms"});
      m.push_back({row + ".object_cpu_ms", r.object.p50, "ms"});
      m.push_back({row + ".object_frames", static_cast<double>(r.followed), "1"});
    }
    m.push_back({row + ".claimed", static_cast<double>(r.claimed), "1"});
    m.push_back({row + ".blocks_refused", static_cast<double>(r.refused), "1"});
    m.push_back({row + ".memory_MiB", r.memory_MiB, "MiB"});
    m.push_back({row + ".other_load_cores", r.other_load, "1"});
    if (std::isfinite(r.ate_mm)) m.push_back({row + ".ate_mm", r.ate_mm, "mm"});
  }
  return m;
}

}  // namespace teletact
