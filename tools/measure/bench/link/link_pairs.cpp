#include "tools/measure/bench/link/link_pairs.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>

#include "rt/quantile.hpp"
#include "tools/measure/bench/callgrind.hpp"
#include "tools/measure/bench/lateness.hpp"
#include "tools/measure/bench/limit.hpp"
#include "tools/measure/bench/link/link_window.hpp"

namespace teletact {

namespace {

constexpr const char* kCounted_s = "2";
constexpr std::size_t kLeastTicks = 1000;

void take(const RigResult& r, PairedSide& side) {
  const Span_ns span = settled(r.op.link.newest);
  side.late_us[0].push_back(late_p99_us(r.op.log, kPairedTasks[0], span.from, span.to));
  side.late_us[1].push_back(late_p99_us(r.robot.log, kPairedTasks[1], span.from, span.to));
  const LinkWindow w = link_window(r.op.link.newest, std::array<Span_ns, 1>{span});
  side.fps.push_back(w.fps);
  side.mbit_s.push_back(w.mbit_s);
  side.own_misses += own_misses(r.op.log) + own_misses(r.robot.log);
}

// A virtual run under callgrind. The hand stands in free air: a tick's work depends on what it
// touches, and the two roads show it other pictures.
double median_tick(const std::string& scratch, const std::vector<std::string>& link_keys) {
  std::vector<std::string> words{"demo",     "--clock",
                                 "virtual",  "--seconds",
                                 kCounted_s, "--quiet",
                                 "--report", scratch + "/counted",
                                 "--set",    "operator.engage_after_s=3600",
                                 "--set",    "hand.start_after_s=3600"};
  for (const auto& key : link_keys) words.insert(words.end(), {"--set", key});
  const auto ticks = callgrind_rounds(own_folder() + "/teletact", words, "tasks::HapticTask::step*",
                                      "tasks::HapticNode::latch*", scratch);
  if (ticks.size() < kLeastTicks) throw std::runtime_error("callgrind: ticks are not told apart");
  return rt::quantile(ticks, 0.5);
}

void count_ticks(std::ostream& progress, LinkPairs& out) {
  if (!have_valgrind()) {
    out.not_counted = "valgrind is not installed";
    return;
  }
  progress << "pairs: callgrind, both roads\n" << std::flush;
  std::string scratch = (std::filesystem::temp_directory_path() / "teletact_pairs_XXXXXX").string();
  if (::mkdtemp(scratch.data()) == nullptr) throw std::runtime_error(scratch + ": can not be made");
  try {
    out.idle.tick_instructions = median_tick(scratch, {"link.depth_codec=\"quiet\""});
    out.saturated.tick_instructions =
        median_tick(scratch, {"link.depth_codec=\"lossless\"", "link.shape.rate_Mbit_per_s=10"});
  } catch (const std::runtime_error& e) {
    out.not_counted = e.what();
  }
  std::error_code ignored;
  std::filesystem::remove_all(scratch, ignored);
}

}  // namespace

LinkPairs measure_pairs(std::ostream& progress, const LinkRig& rig, RigRun idle, RigRun saturated,
                        int pairs) {
  LinkPairs out;
  idle.name = "pairs_idle", saturated.name = "pairs_saturated";
  for (int i = 0; i < pairs && out.problem.empty(); ++i) {
    progress << "pairs: " << i + 1 << " of " << pairs << "\n" << std::flush;
    // In either order as often: what drifts falls out of the median.
    const bool idle_first = i % 2 == 0;
    for (const bool now_idle : {idle_first, !idle_first}) {
      const RigResult r = rig.run(now_idle ? idle : saturated);
      out.others_cores = std::max(out.others_cores, r.others_cores);
      if (!r.problem.empty()) {
        out.problem = r.problem;
        break;
      }
      take(r, now_idle ? out.idle : out.saturated);
    }
  }
  out.busy = disturbed(out.others_cores);
  count_ticks(progress, out);
  return out;
}

}  // namespace teletact
