// 50 stops with a thousand intents a second before each.
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "rt/clock/box_time.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/console/demo_child.hpp"
#include "tools/measure/bench/console/page_client.hpp"

namespace teletact {

namespace {

using std::chrono::milliseconds;

constexpr double kOneWay_ms = 20;
constexpr double kSpeed_m_per_s = 0.3;
constexpr int kStops = 50, kLeast = 4;
constexpr int kNotesPerSecond = 1000;
constexpr milliseconds kFlood{1000};  // below 2 s of it: the server would close
constexpr double kCycle_s = 3;
// Longer than a second without too much at once: the server begins to count anew.
constexpr milliseconds kAfter{1100}, kFree{300}, kDriven{400};

nlohmann::json drive(double vx) { return {{"act", "drive"}, {"vx", vx}, {"vy", 0.0}, {"wz", 0.0}}; }

void wait_until_up(PageClient& page) {
  for (int i = 0; page.mode != "hold"; ++i) {
    if (i > 400) throw std::runtime_error("the box did not come to hold");
    page.run(milliseconds{100});
  }
  page.run(milliseconds{1500});  // first pictures: a place to drive from
}

void engage(PageClient& page) {
  page.holds = {"engage"};
  for (int i = 0; i < 4; ++i) {
    const auto id = page.say({{"act", "engage"}});
    if (page.answered(id, milliseconds{2500}) && page.answers[id].value("ok", false)) return;
    page.holds.clear();
    page.run(milliseconds{500});
    page.holds = {"engage"};
  }
  throw std::runtime_error("supervision did not engage");
}

// One stop; instant of the press, ms of this machine's clock.
double one_stop(PageClient& page, int k) {
  page.holds.clear();
  page.run(kFree);
  engage(page);
  page.holds = {"engage", "drive"};
  page.driven = drive(k % 2 == 0 ? kSpeed_m_per_s : -kSpeed_m_per_s);
  page.run(kDriven);
  page.hammer(kFlood, kNotesPerSecond);
  const double press_ms = 1e-6 * static_cast<double>(rt::monotonic_ns());
  // As the page does it; each way alone, for one of them might not come through.
  if (k / 2 % 2 == 0)
    page.say({{"act", "stop"}});
  else if (!page.post_stop())
    throw std::runtime_error("a stop was not taken");
  page.driven = nullptr;
  page.holds.clear();
  page.run(kAfter);
  page.answers.clear();
  return press_ms;
}

std::vector<SpeedAt> speeds_of(const RobotHalf& robot) {
  std::vector<SpeedAt> out;
  out.reserve(robot.view.robot.size());
  for (const auto& s : robot.view.robot)
    out.push_back({1e-6 * static_cast<double>(kRobotClock.to_host(s.stamp)),
                   static_cast<double>(s.speed_m_per_s)});
  return out;
}

}  // namespace

void measure_stop(std::ostream& progress, const ConsoleBenchOptions& options, StopPart& out) {
  const int stops = options.seconds > 0
                        ? std::clamp(static_cast<int>(options.seconds / kCycle_s), kLeast, kStops)
                        : kStops;
  progress << "stop: " << stops << " stops\n" << std::flush;
  const BenchFolder folder;
  out.one_way_ms = kOneWay_ms;
  PagedDemo demo(folder.path() + "/stop",
                 {"--set", "link.shape.delay_ms=20", "--set", "link.shape.jitter_ms=0"});
  std::vector<double> presses;
  {
    PageClient page(demo.url());
    wait_until_up(page);
    for (int k = 0; k < stops; ++k) presses.push_back(one_stop(page, k));
    out.notes = page.said;
    out.refused = page.refused;
  }
  demo.end();
  out.problem = demo.problem;
  out.notes_per_s = static_cast<double>(out.notes) / (1e-3 * static_cast<double>(kFlood.count())) /
                    static_cast<double>(stops);
  const auto speeds = speeds_of(demo.robot);
  for (const double press : presses) out.stops.push_back(stop_seen(speeds, press));
}

}  // namespace teletact
