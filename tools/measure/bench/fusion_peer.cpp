#include "tools/measure/bench/fusion_peer.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>

#include "rt/memory/non_realtime.hpp"
#include "rt/quantile.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/measure/bench/other_load.hpp"
#include "tools/measure/bench/peer_process.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {
namespace {

constexpr double kVoxel_m = 0.01;
constexpr int kEdge = 512;
constexpr const char* kUnfiltered = "teletact, no filter";

// One mapper over one sequence.
class Run {
 public:
  Run(std::string name, bool filter) : name_(std::move(name)), filter_(filter) {}
  virtual ~Run() = default;
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;

  void frame(const FusionSequence& sequence, int i, int first) {
    if (!absent_.empty()) return;
    PeerProcess::Reply r;
    if (!step(sequence, i, r)) {
      absent_ = i == 0 ? missing() : ending() + " at frame " + std::to_string(i);
      return;
    }
    if (i >= first) ms_.push_back(r.cpu_ms);
    if (!r.tracked) return;
    if (const perception::Pose* truth = sequence.truth(i)) error_.add(r.X_WC, *truth);
    ++tracked_;
  }
  [[nodiscard]] FusionPeerRow row(const FusionSequence& sequence) const {
    FusionPeerRow row;
    row.sequence = sequence.name;
    row.name = name_;
    row.filter = filter_;
    row.absent = absent_;
    row.p50_ms = rt::quantile_or_nan(ms_, 0.5), row.p95_ms = rt::quantile_or_nan(ms_, 0.95),
    row.max_ms = rt::quantile_or_nan(ms_, 1.0);
    row.tracked = tracked_, row.frames = sequence.size();
    row.ate_mm = error_.ate_mm();
    return row;
  }

 protected:
  virtual bool step(const FusionSequence& sequence, int i, PeerProcess::Reply& r) = 0;
  // Why there is no answer: to the first frame, to a later one.
  [[nodiscard]] virtual std::string missing() const { return "did not start"; }
  [[nodiscard]] virtual std::string ending() { return "ended"; }

 private:
  std::string name_;
  bool filter_;
  std::string absent_;
  std::vector<double> ms_;
  int tracked_ = 0;
  ClaimedError error_;
};

class OurRun : public Run {
 public:
  OurRun(const FusionSequence& sequence, bool filter)
      : Run(filter ? "teletact" : kUnfiltered, filter) {
    rt::Startup startup;
    tasks::FusionConfig config;
    config.tsdf.voxel_size_m = kVoxel_m;
    config.view_period_frames = 0;
    if (!filter) config.tracker.preprocess.bilateral_radius_px = 0;
    tasks::FusionSetup setup;
    setup.camera = sequence.intrinsics;
    task_ = std::make_unique<tasks::FusionTask>(startup.token(), config, setup);
    feed_ = std::make_unique<FusionFeed>(*task_);
    feed_->in.hand.seq = 1;
    feed_->in.hand.p_WH = perception::Vec3(0, 0, 1.5);
  }

 protected:
  bool step(const FusionSequence& sequence, int i, PeerProcess::Reply& r) override {
    sequence.frame(i, feed_->frame());
    feed_->frame().has_colour = false;  // the peers fuse none
    const auto& out = feed_->step();
    r.cpu_ms = feed_->cpu_ms();
    r.tracked = out.camera_written && out.camera.claimed;
    r.X_WC = out.camera.X_WC;
    return true;
  }

 private:
  std::unique_ptr<tasks::FusionTask> task_;
  std::unique_ptr<FusionFeed> feed_;
};

class TheirRun : public Run {
 public:
  TheirRun(std::string name, bool filter, std::string package,
           const std::vector<std::string>& command)
      : Run(std::move(name), filter), package_(std::move(package)), process_(command) {}

 protected:
  bool step(const FusionSequence&, int i, PeerProcess::Reply& r) override {
    return process_.ask(i, r);
  }
  [[nodiscard]] std::string missing() const override {
    return "is not installed (Debian: " + package_ + ")";
  }
  [[nodiscard]] std::string ending() override { return process_.ending(); }

 private:
  std::string package_;
  PeerProcess process_;
};

std::string beside_us(const char* program) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? std::string(program) : (self.parent_path() / program).string();
}

std::vector<FusionPeerRow> rows_of(std::ostream& progress, const FusionSequence& sequence,
                                   const FusionPeerOptions& options) {
  const PeerFrames frames(sequence);
  const std::string voxel = std::to_string(kVoxel_m), edge = std::to_string(kEdge);
  const std::string opencv = beside_us("teletact_peer_opencv");
  std::vector<std::unique_ptr<Run>> runs;
  runs.push_back(std::make_unique<OurRun>(sequence, true));
  runs.push_back(std::make_unique<OurRun>(sequence, false));
  for (const char* kind : {"tsdf", "hashtsdf"}) {
    if (!options.peers) break;
    runs.push_back(std::make_unique<TheirRun>(
        std::string("opencv ") + kind, true, "libopencv-contrib-dev, then build again",
        std::vector<std::string>{opencv, frames.path(), kind, voxel, edge}));
  }
  if (options.peers)
    runs.push_back(
        std::make_unique<TheirRun>("open3d", false, "python3-open3d",
                                   std::vector<std::string>{open3d_peer(), frames.path(), voxel}));
  for (int begin = 0; begin < sequence.size(); begin += options.slice) {
    progress << sequence.name << ": frames " << begin << " .. "
             << std::min(begin + options.slice, sequence.size()) - 1 << " of " << sequence.size()
             << std::endl;
    for (const auto& run : runs)
      for (int i = begin; i < std::min(begin + options.slice, sequence.size()); ++i)
        run->frame(sequence, i, options.first_frame);
  }
  std::vector<FusionPeerRow> rows;
  for (const auto& run : runs) rows.push_back(run->row(sequence));
  for (FusionPeerRow& row : rows) {
    if (!row.absent.empty()) continue;
    const FusionPeerRow& ours = rows[row.filter ? 0 : 1];
    row.ratio = row.p50_ms / ours.p50_ms;
    row.ours_ate_mm =
        ours.tracked >= 0.98 * ours.frames ? ours.ate_mm : std::numeric_limits<double>::quiet_NaN();
  }
  return rows;
}

}  // namespace

FusionPeerResult bench_fusion_peer(std::ostream& progress, const FusionPeerOptions& options) {
  std::vector<FusionSequence> sequences;
  if (!options.rgbd.empty())
    sequences.push_back(recorded_sequence(
        progress, options.rgbd, {options.frames, options.first_frame + 2, options.pinhole}));
  if (options.synthetic) {
    rt::Startup startup;
    sequences.push_back(synthetic_sequence(startup.token(), furnished_room(), options.frames));
  }
  FusionPeerResult result;
  OtherLoad others;
  for (const FusionSequence& sequence : sequences)
    for (FusionPeerRow& row : rows_of(progress, sequence, options))
      result.rows.push_back(std::move(row));
  result.other_load = others.cores();
  return result;
}

double FusionPeerRow::least_ratio() const {
  return name.rfind("opencv", 0) == 0 ? 30 : name.rfind("open3d", 0) == 0 ? 9 : 0;
}

// A peer that tracked nothing has no error to be compared with.
std::vector<Limit> FusionPeerResult::limits() const {
  Limits all;
  for (const FusionPeerRow& r : rows) {
    if (!(r.least_ratio() > 0)) continue;
    const std::string name = r.sequence + " " + r.name + ", ";
    all.add(name + "CPU to ours", r.ratio, ">=", r.least_ratio(),
            r.absent.empty() ? disturbed(other_load) : r.absent);
    const bool no_truth = !std::isfinite(r.ate_mm);
    all.add(name + "our ATE to its, mm", r.ours_ate_mm, "<=", r.ate_mm,
            !r.absent.empty() ? r.absent
            : no_truth        ? "no truth, or it tracked nothing"
                              : "");
  }
  return all.all();
}

void FusionPeerResult::print(std::ostream& out) const {
  char line[256];
  out << "the same frames at 10 mm over 5.12 m, one thread, CPU ms a frame\n"
         "sequence   who                  filter |    p50     p95     max | tracked  ATE mm | CPU "
         "to ours | target\n";
  for (const FusionPeerRow& r : rows) {
    if (!r.absent.empty()) {
      out << r.sequence << " " << r.name << ": " << r.absent << "\n";
      continue;
    }
    std::snprintf(line, sizeof line,
                  "%-10s %-20s %-6s | %6.1f  %6.1f  %6.1f | %3d/%3d  %6.1f | %11.1f |",
                  r.sequence.c_str(), r.name.c_str(), r.filter ? "on" : "off", r.p50_ms, r.p95_ms,
                  r.max_ms, r.tracked, r.frames, r.ate_mm, r.ratio);
    out << line;
    if (r.least_ratio() > 0) {
      std::snprintf(line, sizeof line, " >= %.0f, our ATE %.1f <= its", r.least_ratio(),
                    r.ours_ate_mm);
      out << line;
    }
    out << "\n";
  }
  std::snprintf(line, sizeof line, "others used %.2f of a core%s\n", other_load,
                measured() ? "" : "; 0.05 is allowed: not measured, upper bounds");
  out << line;
  teletact::print(out, limits());
}

std::vector<BenchMetric> FusionPeerResult::metrics() const {
  std::vector<BenchMetric> m;
  for (const std::string sequence : {"recording", "synthetic"}) {
    const std::string base = sequence == "recording" ? "fusion.peer." : "fusion.peer.synthetic.";
    for (const std::string who : {"teletact", "opencv", "open3d"}) {
      const FusionPeerRow* best = nullptr;  // the faster one of a peer's two volumes
      for (const FusionPeerRow& r : rows)
        if (r.sequence == sequence && r.absent.empty() && r.name.rfind(who, 0) == 0 &&
            (best == nullptr || (who != "teletact" && r.p50_ms < best->p50_ms)))
          best = &r;
      if (best == nullptr) continue;
      m.push_back({base + who + ".cpu_ms", best->p50_ms, "ms"});
      if (who != "teletact") m.push_back({base + who + ".cpu_ratio", best->ratio, "1"});
      m.push_back({base + who + ".tracked", static_cast<double>(best->tracked), "1"});
      if (std::isfinite(best->ate_mm)) m.push_back({base + who + ".ate_mm", best->ate_mm, "mm"});
    }
    for (const FusionPeerRow& r : rows) {
      if (r.sequence != sequence || r.name != kUnfiltered) continue;
      m.push_back({base + "teletact_unfiltered.cpu_ms", r.p50_ms, "ms"});
      if (std::isfinite(r.ate_mm))
        m.push_back({base + "teletact_unfiltered.ate_mm", r.ate_mm, "mm"});
    }
  }
  m.push_back({"fusion.peer.other_load_cores", other_load, "1"});
  return m;
}

}  // namespace teletact
