// What the page costs: nothing with nobody there, and what one viewer does to the tasks.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <thread>

#include "rt/clock/box_time.hpp"
#include "tools/measure/bench/callgrind.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/console/demo_child.hpp"
#include "tools/measure/bench/console/page_client.hpp"
#include "tools/measure/bench/lateness.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using std::chrono::milliseconds;
using Words = std::vector<std::string>;

constexpr int kPairs = 10, kLeastPairs = 2;
constexpr milliseconds kWindow{6000}, kBetween{1500};  // between: what opening costs is of neither
constexpr double kPair_s = 15;
constexpr int kHammered = 180;  // intents a second: below the server's limit of 200
const char* const kCounted_s = "2";

// The scene that a page is shown (tools/teletact/console_words.cpp) but for the mesh, and nobody in
// it: neither the script's hand nor its engage.
// Later words win, so these stand with a page too.
Words nobody(const std::string& report, const std::string& json) {
  Words words{"demo",    "--clock",  "virtual", "--seconds", kCounted_s,
              "--quiet", "--report", report,    "--json",    json};
  for (const char* key :
       {"haptic.border_m=0.065", "haptic.border_rate_per_s=20", "fusion.objects.enabled=true",
        "operator.engage_after_s=3600", "hand.start_after_s=3600"})
    words.insert(words.end(), {"--set", key});
  return words;
}

struct Hashes {
  std::string sched, log;
};
Hashes hashes_of(const std::string& file) {
  std::ifstream in(file);
  const auto all = nlohmann::json::parse(in, nullptr, false);
  Hashes out;
  if (!all.is_object()) return out;
  for (const auto& m : all["metrics"]) {
    if (m["name"] == "run.sched_hash") out.sched = m["value"].dump();
    if (m["name"] == "run.log_hash") out.log = m["value"].dump();
  }
  return out;
}

// One virtual run under callgrind: instructions of fusion's steps.
double counted(const std::string& folder, bool page, Hashes& hashes) {
  const std::string name = folder + (page ? "/with" : "/without"), json = name + ".json";
  Words words = nobody(name, json);
  if (page) words.emplace_back("--console");
  const double n =
      callgrind_count(own_folder() + "/teletact", words, "tasks::FusionTask::*_step*", folder);
  hashes = hashes_of(json);
  return n;
}

void count_nobody(std::ostream& progress, const std::string& folder, CostPart& out) {
  if (!have_valgrind()) {
    out.not_counted = "valgrind is not installed";
    return;
  }
  Hashes without, with;
  progress << "cost: callgrind, without a page\n" << std::flush;
  out.without = counted(folder, false, without);
  progress << "cost: callgrind, with a page that nobody looks at\n" << std::flush;
  out.with = counted(folder, true, with);
  out.sched_without = without.sched, out.log_without = without.log;
  out.sched_with = with.sched, out.log_with = with.log;
  if (!(out.without > 1e6)) out.not_counted = "callgrind counted nothing of fusion";
}

struct Window {
  std::int64_t from = 0, to = 0;
};

double fusion_ms(const rt::RunLog& log, const Window& w) {
  const auto jobs = released_in(task_of(log, "fusion"), w.from, w.to).jobs;
  double sum = 0;
  for (const auto& j : jobs) sum += 1e-6 * static_cast<double>(j.cpu_ns);
  return jobs.empty() ? kNaN : sum / static_cast<double>(jobs.size());
}

Window rest(const std::function<void()>& meanwhile) {
  Window w;
  w.from = rt::monotonic_ns();
  meanwhile();
  w.to = rt::monotonic_ns();
  return w;
}

}  // namespace

void measure_cost(std::ostream& progress, const ConsoleBenchOptions& options, CostPart& out) {
  const BenchFolder folder;
  count_nobody(progress, folder.path(), out);
  const int pairs = options.seconds > 0 ? std::clamp(static_cast<int>(options.seconds / kPair_s),
                                                     kLeastPairs, kPairs)
                                        : kPairs;
  progress << "cost: " << pairs << " pairs, page closed and open\n" << std::flush;
  PagedDemo demo(folder.path() + "/cost", {});
  PageClient page(demo.url());
  page.leave();
  std::this_thread::sleep_for(std::chrono::seconds{8});  // lead, and a map of the room
  std::vector<Window> open, closed;
  for (int i = 0; i < pairs; ++i) {
    closed.push_back(rest([] { std::this_thread::sleep_for(kWindow); }));
    page.come_back();
    page.run(kBetween);
    open.push_back(rest([&] { page.hammer(kWindow, kHammered); }));
    page.leave();
    page.answers.clear();
    std::this_thread::sleep_for(kBetween);
  }
  out.views = page.views;
  out.megabytes = 1e-6 * static_cast<double>(page.bytes);
  demo.end();
  out.problem = demo.problem;
  for (std::size_t i = 0; i < open.size(); ++i) {
    out.fusion_open_ms.push_back(fusion_ms(demo.op.log, open[i]));
    out.fusion_closed_ms.push_back(fusion_ms(demo.op.log, closed[i]));
    out.late_open_us.push_back(late_p99_us(demo.op.log, "haptic", open[i].from, open[i].to));
    out.late_closed_us.push_back(late_p99_us(demo.op.log, "haptic", closed[i].from, closed[i].to));
  }
  out.own_misses = own_misses(demo.op.log) + own_misses(demo.robot.log);
  out.server_share =
      demo.figures.is_object() ? demo.figures.value("console.server_share", kNaN) : kNaN;
}

}  // namespace teletact
