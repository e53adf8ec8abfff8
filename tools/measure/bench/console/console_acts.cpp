// What a person at the page waits for: from the pointer to the task and to the answer, from fusion
// to the scene. The page runs in Chromium (tools/console/page/test/measure.ts); what it saw and
// what the box recorded are joined here, by the one clock of this machine.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <stdexcept>

#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/console/demo_child.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using nlohmann::json;

constexpr int kRounds = 25, kLeast = 4;
constexpr double kRound_s = 4, kBefore_s = 25;
constexpr double kPatience = 8;  // a machine that is busy takes so many times as long
constexpr double kDrawn_s = 10;
const char* const kPlayed_s = "120";  // ended before: the recording is shorter, and then held
// The hand has begun to go where the page wants it; before the press it was still.
constexpr double kMoved_m = 0.0005, kStill_m = 0.0003, kStill_ms = 30, kLatest_ms = 500;

// Which task takes an act, by docs/desk.md.
struct ActOf {
  const char *act, *task;
};
constexpr ActOf kActs[] = {{"hand", "haptic"},
                           {"draw", "fusion"},
                           {"undo", "fusion"},
                           {"hold", "supervision"},
                           {"go_to", "planning"}};

struct Clocks {
  double page_ms = 0;  // to the machine's clock
  std::int64_t epoch_ns = 0;
  [[nodiscard]] double of_page(double ms) const { return ms + page_ms; }
  [[nodiscard]] double of_box(double s) const {
    return 1e-6 * static_cast<double>(epoch_ns) + 1e3 * s;
  }
};

double moved(const tasks::HapticSample& a, const tasks::HapticSample& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) sum += std::pow(double{a.p_WH[i]} - double{b.p_WH[i]}, 2);
  return std::sqrt(sum);
}

// From a press to the first job of the haptic task that moved the hand, ms; NaN: none, or it was
// not still before.
double hand_after_ms(const std::vector<tasks::HapticSample>& samples, double press_ms) {
  const tasks::HapticSample *still = nullptr, *last = nullptr;
  for (const auto& s : samples) {
    const double t = 1e-6 * static_cast<double>(rt::ns_of(s.stamp)) - press_ms;
    if (t < -kStill_ms) continue;
    if (still == nullptr) still = &s;
    if (t < 0) {
      if (moved(*still, s) > kStill_m) return kNaN;
      last = &s;
      continue;
    }
    if (last == nullptr || t > kLatest_ms) return kNaN;
    if (moved(*last, s) > kMoved_m) return t;
  }
  return kNaN;
}

const json* answer_to(const json& seen, const json& sent) {
  for (const auto& a : seen["answered"])
    if (a["id"] == sent["id"] && a["came"] >= sent["at"]) return &a;
  return nullptr;
}

const std::vector<rt::JobRecord>* jobs_of(const rt::RunLog& log, const std::string& task) {
  for (const auto& t : log.tasks)
    if (t.spec.name == task) return &t.jobs;
  return nullptr;
}

void join_act(const json& seen, const json& sent, const OperatorHalf& op, const Clocks& clocks,
              ActTimes& out) {
  const double pointer_ms = clocks.of_page(sent["pointer"]);
  if (out.act == "hand") {  // answered only where it is refused
    const double ms = hand_after_ms(op.view.haptic, pointer_ms);
    if (std::isnan(ms))
      ++out.lost;
    else
      out.task_ms.push_back(ms);
    return;
  }
  const json* answer = answer_to(seen, sent);
  const auto* jobs = jobs_of(op.log, out.task);
  if (answer == nullptr || !answer->value("ok", false) || jobs == nullptr) {
    ++out.lost;
    return;
  }
  out.answer_ms.push_back(clocks.of_page((*answer)["came"]) - pointer_ms);
  // Answered when it became an input; the next job that starts has latched it.
  const double input_ms = clocks.of_box((*answer)["made"]);
  const auto start = first_start(*jobs, static_cast<std::int64_t>(1e6 * input_ms));
  if (start)
    out.task_ms.push_back(1e-6 * static_cast<double>(*start) - pointer_ms);
  else
    ++out.lost;
}

void join(const json& seen, const OperatorHalf& op, ActsPart& out) {
  const Clocks clocks{seen["clock"]["offset"], op.epoch_ns};
  out.clock_within_ms = seen["clock"]["within"];
  out.renderer = seen["renderer"];
  const json& borders = seen["borders"];
  const double fresh = borders["fresh"], late = borders["late"], frozen = borders["frozen"];
  const double looks = fresh + late + frozen;
  out.live_share = fresh / looks, out.late_share = late / looks;
  for (const ActOf& a : kActs) {
    ActTimes& times = out.acts.emplace_back();
    times.act = a.act, times.task = a.task;
    for (const auto& sent : seen["sent"])
      if (sent["act"] == a.act && sent["pointer"] >= 0) join_act(seen, sent, op, clocks, times);
  }
  for (const auto& m : seen["mesh"]) {
    if (m["came"] < seen["settled"] || m["applied"] < 0) continue;
    const double made_ms = clocks.of_box(m["made"]);
    out.mesh_ms.push_back(clocks.of_page(m["applied"]) - made_ms);
    if (m["drawn"] >= 0) out.pixels_ms.push_back(clocks.of_page(m["drawn"]) - made_ms);
  }
}

double figure(const json& figures, const char* name) {
  return figures.is_object() ? figures.value(name, -1.0) : -1.0;
}

void play_recording(const ConsoleBenchOptions& options, const std::string& folder, ActsPart& out) {
  if (options.recording.empty() || !std::filesystem::exists(options.recording)) {
    out.no_recording = "no recording: " + options.recording + " is not there";
    return;
  }
  PagedDemo demo(folder + "/recording", {"--rgbd", options.recording, "--seconds", kPlayed_s});
  const json drawn =
      run_page_script({"drawn", demo.url(), std::to_string(static_cast<int>(kDrawn_s))}, folder,
                      kPatience * (kDrawn_s + kBefore_s));
  demo.end();
  out.fps = drawn["fps"];
  out.pictures_per_s = figure(demo.figures, "console.fps");
  if (!demo.problem.empty()) out.no_recording = demo.problem;
}

}  // namespace

void measure_acts(std::ostream& progress, const ConsoleBenchOptions& options, ActsPart& out) {
  out.no_browser = no_browser();
  if (!out.no_browser.empty()) return;
  const int rounds = options.seconds > 0
                         ? std::max(kLeast, static_cast<int>(options.seconds / kRound_s))
                         : kRounds;
  progress << "acts: " << rounds << " of each\n" << std::flush;
  const BenchFolder folder;
  {
    PagedDemo demo(folder.path() + "/acts", {});
    const json seen = run_page_script({"acts", demo.url(), std::to_string(rounds)}, folder.path(),
                                      kPatience * (rounds * kRound_s + kBefore_s));
    demo.end();
    out.problem = demo.problem;
    out.intent_p95_ms = figure(demo.figures, "console.intent_p95_ms");
    out.to_server_p95_ms = figure(demo.figures, "console.mesh_p95_ms");
    join(seen, demo.op, out);
  }
  progress << "acts: a recording at 640x360\n" << std::flush;
  try {
    play_recording(options, folder.path(), out);
  } catch (const std::runtime_error& e) {  // what the acts have shown stands
    out.no_recording = e.what();
  }
}

}  // namespace teletact
