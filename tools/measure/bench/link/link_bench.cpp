#include "tools/measure/bench/link/link_bench.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "drivers/codec/colour_stream.hpp"
#include "rt/quantile.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/host_admission.hpp"
#include "tools/host/script_goal.hpp"
#include "tools/measure/bench/link/link_depth.hpp"
#include "tools/measure/bench/link/link_rig.hpp"
#include "tools/measure/tun_road/tun_device.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

namespace {

using Words = std::vector<std::string>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kRate_Mbit_per_s = 10;
constexpr double kPath_ms = 95, kStall_ms = 400;
// Of the road's clock, which begins a few seconds before the boxes do.
constexpr double kThin_at_s = 18, kWide_at_s = 30, kFirstStall_at_s = 12, kStallEvery_s = 4;
// The lens counts as moving from so fast on; stretches shorter than this tell of no rate.
constexpr double kMoves_m_per_s = 0.05, kLeastMoving_s = 1;
constexpr double kLeastMovingAll_s = 8;
constexpr double kPairedRun_s = 12;
constexpr const char* kPairs = "pairs";
// Simulated, of each scene: the default mark is driven to in 6.
constexpr double kMeasured_s = 12;
// After the road fell silent: what left before still arrives (kPath_ms), and until the first that
// was held up arrives.
constexpr double kUntil_ms = kStall_ms + 75;
// A new goal is made each 100 ms, and up to 20 ms of jitter are on the way: longer without one, and
// one was held up.
constexpr double kGap_ms = 150;

Words road_keys(const Words& more = {}) {
  Words keys{"rate_Mbit_per_s=10", "queue_kB=200", "delay_ms=75", "jitter_ms=20", "seed=1"};
  keys.insert(keys.end(), more.begin(), more.end());
  return keys;
}

const Words& stall_keys() {
  static const Words keys = road_keys({"stall=[{at_s=12, for_ms=400, every_s=4}]"});
  return keys;
}

// The road is real: no shape, no emulator.
Words scene_keys(const std::string& depth, const Words& more = {}) {
  Words keys{
      "link.shape.delay_ms=0", "link.shape.jitter_ms=0", "link.shape.rate_Mbit_per_s=0",
      "link.depth_codec=\"" + depth + "\"",
      std::string("link.colour_codec=") + (drivers::h264_built_in() ? "\"h264\"" : "\"jpeg\"")};
  keys.insert(keys.end(), more.begin(), more.end());
  return keys;
}

const std::string kNobodyEngages = "operator.engage_after_s=3600";
// Once it was followed: an engagement that is lost stays lost, and the mark is not reached.
const std::string kEngagedOnce = "operator.re_engage_after_s=0";

RigRun at_rest(const std::string& name, double s, const Words& road,
               const std::string& depth = "quiet") {
  return {name, "default_room", scene_keys(depth, {kNobodyEngages}), road, s};
}

struct PairedRuns {
  RigRun idle, saturated;
};
PairedRuns paired_runs() {
  return {at_rest("idle", kPairedRun_s, road_keys()),
          at_rest("saturated", kPairedRun_s, road_keys(), "lossless")};
}

std::vector<RigRun> runs_of(const LinkBenchOptions& o) {
  const double whole = o.seconds, part = std::max(20.0, o.seconds / 2);
  std::vector<RigRun> all{
      at_rest("rest", whole, road_keys()),
      {"own_clock", "default_room",
       scene_keys("quiet", {kNobodyEngages, "camera.phase_ms=30", "camera.clock_ppm=300"}),
       road_keys(), part},
      {"strict", "rounds", scene_keys("moving"), road_keys(), whole},
      {"lenient", "rounds", scene_keys("moving", {"link.depth_noise=\"lenient\""}), road_keys(),
       whole},
      at_rest("saturated", part, road_keys(), "lossless"),
      at_rest("stall", part, stall_keys()),
      // Moving: at rest the pictures take less than the thin road carries.
      {"rate", "rounds", scene_keys("moving"),
       road_keys({"rate_change=[{at_s=18, rate_Mbit_per_s=4}, {at_s=30, rate_Mbit_per_s=10}]"}),
       45},
      at_rest("loss", part, road_keys({"loss=0.005"})),
      {"drive", "default_room", scene_keys("moving", {kEngagedOnce}), road_keys(), 25},
      {"drive_loss", "default_room", scene_keys("moving", {kEngagedOnce}),
       road_keys({"loss=0.005"}), 30},
      {"drive_stall", "default_room", scene_keys("moving", {kEngagedOnce}), stall_keys(), 30}};
  for (RigRun& run : all)
    run.record = run.name == "rest" || run.name == "strict" || run.name == "lenient";
  return all;
}

bool is(const RigRun& run, const char* name) { return run.name == name; }

void judge_windows(const RigRun& run, const RigResult& r, LinkRow& row) {
  const auto& samples = r.op.link.newest;
  const Span_ns all = settled(samples);
  std::vector<Span_ns> spans{all};
  if (is(run, "strict") || is(run, "lenient")) {
    spans = moving_spans(r.robot.view.truth, kMoves_m_per_s, kLeastMoving_s);
    std::erase_if(spans, [&](const Span_ns& s) { return s.from < all.from; });
  }
  row.window = link_window(samples, spans);
  if ((is(run, "strict") || is(run, "lenient")) && row.window.seconds < kLeastMovingAll_s)
    row.problem = "the base moved for less than 8 s";
  if (row.window.pictures == 0 && row.problem.empty()) row.problem = "no picture arrived";
  if (is(run, "stall"))
    row.over_stall_ms = over_stall_ms(samples, all, kStall_ms, kPath_ms, kRate_Mbit_per_s);
  if (!is(run, "rate")) return;
  const std::int64_t thin = later(r.road_epoch_ns, kThin_at_s),
                     wide = later(r.road_epoch_ns, kWide_at_s);
  const std::array<Span_ns, 1> in_thin{Span_ns{later(thin, kSettled_s), wide}},
      in_wide{Span_ns{later(wide, kSettled_s), all.to}};
  const LinkWindow thin_part = link_window(samples, in_thin),
                   wide_part = link_window(samples, in_wide);
  row.after_rate_p95_ms = std::max(thin_part.age_p95_ms, wide_part.age_p95_ms);
  row.thin_spared = thin_part.spared_share, row.wide_spared = wide_part.spared_share;
}

void judge_felt(const RigResult& r, LinkRow& row) {
  auto all = felt_after_ms(r.op.view.haptic, r.op.view.fusion, r.op.link.newest);
  row.felt = static_cast<int>(all.size());
  if (!all.empty()) row.felt_p95_ms = rt::quantile(all, 0.95);
  std::span<const rt::JobRecord> capture;
  for (const rt::TaskLog& t : r.robot.log.tasks) {
    if (t.id == tasks::index_of(tasks::TaskId::kCapture)) capture = t.jobs;
  }
  row.felt_stages = felt_stages({r.op.view.haptic, r.op.view.fusion, r.op.link.newest, capture});
}

// As the operator's box says it at its end: no mark, no path, not engaged.
std::string missed(const RigRun& run, const RigResult& r) {
  auto keys = run.keys;
  const auto scene = load_scene(find_config("scenes", run.scene), keys);
  DemoOptions options;
  options.seconds = run.seconds;
  return check_goal(*scene, options, r.op, r.robot).missed;
}

void judge_drive(const RigRun& run, const RigResult& r, LinkRow& row) {
  const OperatorView& v = r.op.view;
  row.drive.arrived = v.arrivals > 0 && !v.paths.empty();
  row.drive.time_s =
      row.drive.arrived ? rt::seconds(v.first_arrival - v.paths.front().mark_stamp) : kNaN;
  if (!row.drive.arrived) row.drive.missed = missed(run, r);
  row.drive.gaps = after_gaps(r.robot.view.robot, kGap_ms);
  if (!is(run, "drive_stall")) return;
  std::vector<std::int64_t> silences;
  for (double at = kFirstStall_at_s; at < run.seconds + 20; at += kStallEvery_s)
    silences.push_back(later(r.road_epoch_ns, at));
  row.drive.silence = after_silences(r.robot.view.robot, silences, kUntil_ms);
}

void judge_depth(const RigRun& run, const RigResult& r, LinkRow& row) {
  auto keys = run.keys;
  const auto scene = load_scene(find_config("scenes", run.scene), keys);
  LinkDepthOptions options;
  options.recording = r.folder + "/operator/raw/operator.inputs";
  const LinkDepth d = link_depth(*scene, r.robot, options);
  row.depth_over_sensor = d.over_sensor;
  row.depth_problem = d.problem;
}

void judge_cpu(const RigRun& run, const RigResult& r, LinkRow& row) {
  auto keys = run.keys;
  row.link_declared = declared_link_share(*load_scene(find_config("scenes", run.scene), keys),
                                          run.calibration.value());
  row.link_cpu = 0;
  for (const auto* o : {&r.op.ordinary, &r.robot.ordinary})
    row.link_cpu +=
        o->span_ns > 0 ? static_cast<double>(o->link_ns) / static_cast<double>(o->span_ns) : kNaN;
}

LinkRow judge(const RigRun& run, const RigResult& r) {
  LinkRow row;
  row.problem = r.problem;
  row.others_cores = r.others_cores;
  row.busy = disturbed(r.others_cores);
  row.road_busy_Mbit_per_s = r.road_busy_Mbit_per_s;
  row.road_late_p95_us = r.road_late_p95_us;
  row.robot_congestion = r.robot_congestion;
  row.operator_congestion = r.operator_congestion;
  row.depth_over_sensor = row.over_stall_ms = row.after_rate_p95_ms = row.felt_p95_ms = kNaN;
  judge_windows(run, r, row);
  judge_cpu(run, r, row);
  if (run.name.rfind("drive", 0) == 0) judge_drive(run, r, row);
  if (is(run, "rest")) judge_felt(r, row);
  if (run.record) judge_depth(run, r, row);
  return row;
}

// Both boxes are admitted with what the link was measured to take here, as on a host that has
// calibrated itself. What tasks and the camera's twin cost is the reference's, so that each host
// runs the same variants.
class LinkCosts {
 public:
  [[nodiscard]] tasks::Calibration of(const RigRun& run) {
    auto& known = known_[{run.scene, run.keys}];
    if (!known) {
      auto keys = run.keys;
      const auto scene = load_scene(find_config("scenes", run.scene), keys);
      known = with_link(startup_.token(), *scene, kMeasured_s, reference_calibration());
    }
    return *known;
  }

 private:
  rt::Startup startup_;
  std::map<std::pair<std::string, Words>, std::optional<tasks::Calibration>> known_;
};

}  // namespace

const std::vector<std::string>& link_run_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const RigRun& run : runs_of({})) all.push_back(run.name);
    all.emplace_back(kPairs);
    return all;
  }();
  return names;
}

LinkBenchResult bench_link(std::ostream& progress, const LinkBenchOptions& options) {
  LinkBenchResult out;
  out.host = tasks::host_id();
  out.refusal = link_rig_refusal();
  if (!out.refusal.empty()) return out;
  out.congestion = settable_congestion({"bbr", "cubic"});
  const LinkRig rig;
  const auto& only = options.only;
  const auto wanted = [&](const std::string& name) {
    return only.empty() || std::find(only.begin(), only.end(), name) != only.end();
  };
  LinkCosts costs;
  std::vector<RigRun> runs = runs_of(options);
  for (RigRun& run : runs) {
    if (!wanted(run.name)) continue;
    run.calibration = costs.of(run);
    progress << run.name << ": " << run.seconds << " s\n" << std::flush;
    const LinkRow& row = out.rows[run.name] = judge(run, rig.run(run));
    if (!row.problem.empty()) progress << "  " << row.problem << "\n" << std::flush;
  }
  if (wanted(kPairs)) {
    auto [idle, saturated] = paired_runs();
    idle.calibration = costs.of(idle), saturated.calibration = costs.of(saturated);
    out.pairs = measure_pairs(progress, rig, idle, saturated);
  }
  return out;
}

}  // namespace teletact
