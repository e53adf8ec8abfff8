// The tables of table1 as text, and its figures by name.
#include <cmath>
#include <cstdio>

#include "tools/measure/bench/table1.hpp"

namespace teletact {

const std::array<const char*, Table1Row::kStages> Table1Row::kStageNames{
    "filter+pyramid", "ICP",    "fuse: ready", "fuse: allocate", "fuse: update", "fuse: carve",
    "ray cast",       "ground", "cost map",    "patch",          "rest"};

namespace {

using Rows = std::vector<const Table1Row*>;

// The paper's fusion column is segmentation and fusion together: ours with an object stands beside
// it.
void print_table(std::ostream& out, const Rows& rows) {
  char line[320];
  out << "                           |      paper      | ours: seg+fusion     | fusion             "
         " "
         " |\n"
         "sequence     N^3  voxel    isa | total seg+fus |    p50    p95    max |    p50    p95    "
         "max | claimed  ATE mm | blocks   MiB keyframes   RSS\n";
  for (const auto* row : rows) {
    const auto& r = *row;
    const Table1Paper* paper = table1_paper(r.edge);
    char both[64] = "     -      -      -", ate[16] = "-";
    if (r.followed > 0) {
      std::snprintf(both, sizeof both, "%6.2f %6.2f %6.2f", r.with_object.p50, r.with_object.p95,
                    r.with_object.max);
    }
    if (std::isfinite(r.ate_mm)) std::snprintf(ate, sizeof ate, "%.1f", r.ate_mm);
    std::snprintf(line, sizeof line,
                  "%-10s %5d %4.0f mm %6s | %5.1f %7.1f | %s | %6.2f %6.2f %6.2f | %3d/%3d %7s | "
                  "%6d %5.1f %9.1f %5.0f%s\n",
                  r.sequence.c_str(), r.edge, r.voxel_mm(), r.isa.c_str(),
                  paper != nullptr ? paper->total_ms : 0, paper != nullptr ? paper->fusion_ms : 0,
                  both, r.frame.p50, r.frame.p95, r.frame.max, r.claimed, r.frames, ate, r.blocks,
                  r.memory_MiB, r.keyframes_MiB, r.rss_MiB,
                  r.measured() ? "" : "  (not measured: others' load)");
    out << line;
    if (!r.measured()) {
      std::snprintf(line, sizeof line, "           others used %.2f of a core, %.2f is allowed\n",
                    r.other_load, kOtherLoadLimit);
      out << line;
    }
  }
}

void print_objects(std::ostream& out, const Rows& rows) {
  char line[256];
  out << "\nof seg+fusion the object, ms a frame; more: than the same frames without\n";
  for (const auto* r : rows) {
    if (r->followed == 0) continue;
    std::snprintf(line, sizeof line,
                  "%-10s %5d %6s | %5.2f p95 %5.2f max %5.2f | more %5.2f p95 %5.2f | %d frames, "
                  "%d touches\n",
                  r->sequence.c_str(), r->edge, r->isa.c_str(), r->object.p50, r->object.p95,
                  r->object.max, r->object_more.p50, r->object_more.p95, r->followed, r->touches);
    out << line;
  }
}

// p50 (p95) of the first `count` stages.
void print_stages(std::ostream& out, const std::array<Table1Row::Figures, Table1Row::kStages>& all,
                  std::size_t count) {
  char line[128];
  for (std::size_t s = 0; s < count; ++s) {
    std::snprintf(line, sizeof line, "%s %s %.2f (%.2f)", s == 0 ? "" : ",",
                  Table1Row::kStageNames[s], all[s].p50, all[s].p95);
    out << line;
  }
  out << "\n";
}

void print_two_threads(std::ostream& out, const Rows& rows) {
  char line[256];
  out << "\ntwo threads, ms a frame: wall = CPU of the longer thread of every stage + fork and "
         "join; real "
         "wall holds the machine's other work: an upper bound\n"
         "sequence     N^3 | paper fusion | wall p50    p95    max | with object | real p50    p95 "
         "| own "
         "CPU  worker | forks x us\n";
  for (const auto* row : rows) {
    const auto& r = *row;
    if (r.two.forks <= 0) continue;
    const Table1Paper* paper = table1_paper(r.edge);
    std::snprintf(line, sizeof line,
                  "%-10s %5d | %12.1f | %8.2f %6.2f %6.2f | %11.2f | %8.2f %6.2f | %7.2f %7.2f | "
                  "%.0f x %.1f%s\n",
                  r.sequence.c_str(), r.edge, paper != nullptr ? paper->fusion_ms : 0,
                  r.two.wall.p50, r.two.wall.p95, r.two.wall.max, r.two.wall_with_object.p50,
                  r.two.real_wall.p50, r.two.real_wall.p95, r.two.own_cpu.p50, r.two.worker_cpu.p50,
                  r.two.forks, r.two.fork_us,
                  r.two.real_time ? "" : " (no real-time priority permitted: may hold waits)");
    out << line;
  }
  out << "stages with two threads, the way through without fork and join, p50 (p95) ms\n";
  for (const auto* r : rows) {
    if (r->two.forks <= 0) continue;
    out << r->sequence << " " << r->edge << "^3:";
    print_stages(out, r->two.stages, Table1Row::kStages - 1);
  }
}

void print_all(std::ostream& out, const Rows& rows) {
  print_table(out, rows);
  print_objects(out, rows);
  print_two_threads(out, rows);
  out << "\nstages, p50 (p95) ms\n";
  for (const auto* r : rows) {
    out << r->sequence << " " << r->edge << "^3 " << r->isa << ":";
    print_stages(out, r->stages, Table1Row::kStages);
  }
}

void add_metrics(const Table1Row& r, std::vector<BenchMetric>& m) {
  const std::string row = std::string("table1.") + (r.fixed_voxel ? "fixed." : "") +
                          (r.sequence == "recording" ? "" : r.sequence + ".") +
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
  if (r.two.forks > 0) {
    m.push_back({row + ".wall2_ms", r.two.wall.p50, "ms"});
    m.push_back({row + ".wall2_p95_ms", r.two.wall.p95, "ms"});
    m.push_back({row + ".wall2_real_ms", r.two.real_wall.p50, "ms"});
    m.push_back({row + ".cpu2_own_ms", r.two.own_cpu.p50, "ms"});
    m.push_back({row + ".cpu2_worker_ms", r.two.worker_cpu.p50, "ms"});
    m.push_back({row + ".fork_us", r.two.fork_us, "us"});
    if (r.followed > 0) m.push_back({row + ".seg_wall2_ms", r.two.wall_with_object.p50, "ms"});
  }
  m.push_back({row + ".claimed", static_cast<double>(r.claimed), "1"});
  m.push_back({row + ".blocks_refused", static_cast<double>(r.refused), "1"});
  m.push_back({row + ".memory_MiB", r.memory_MiB, "MiB"});
  m.push_back({row + ".keyframes_MiB", r.keyframes_MiB, "MiB"});
  m.push_back({row + ".rss_MiB", r.rss_MiB, "MiB"});
  m.push_back({row + ".other_load_cores", r.other_load, "1"});
  if (std::isfinite(r.ate_mm)) m.push_back({row + ".ate_mm", r.ate_mm, "mm"});
}

}  // namespace

void Table1Result::print(std::ostream& out) const {
  Rows cube, fixed;
  for (const auto& r : rows) (r.fixed_voxel ? fixed : cube).push_back(&r);
  out << "Table 1: ms a frame, cube of 5.12 m; CPU of our frame, one thread; the paper's GTX 670 "
         "beside\n";
  print_all(out, cube);
  if (!fixed.empty()) {
    out << "\nFor information: voxels of 10 mm, nothing kept outside of a cube of N x 10 mm in "
           "front "
           "of the first camera\n";
    print_all(out, fixed);
  }
  print_limits(out);
}

std::vector<BenchMetric> Table1Result::metrics() const {
  std::vector<BenchMetric> m;
  for (const auto& r : rows) add_metrics(r, m);
  using State = Limit::State;
  m.push_back({"table1.limits_met", static_cast<double>(count(State::kMet)), "1"});
  m.push_back({"table1.limits_missed", static_cast<double>(missed()), "1"});
  m.push_back({"table1.limits_not_measured", static_cast<double>(count(State::kNotMeasured)), "1"});
  return m;
}

}  // namespace teletact
