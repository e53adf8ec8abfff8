// Memory of server and page over many views, two viewers, many reloads. No box: the server alone,
// with views like those of a run, published as fast as the viewers take them until an hour's worth
// is taken, then at the rate of a run until all reloads are done.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "tools/console/console_server.hpp"
#include "tools/console/view_bytes.hpp"
#include "tools/measure/bench/callgrind.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/console/console_figures.hpp"
#include "tools/measure/bench/console/demo_child.hpp"

namespace teletact {

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::uint64_t kMessages = 108000;  // an hour's worth
constexpr int kReloads = 200;
constexpr std::uint64_t kFewer = 10;  // so many times less without --long
constexpr double kLeast_s = 30;       // memory is looked at every other second
constexpr double kMost_s = 1500;
constexpr milliseconds kFramePeriod{33};
constexpr int kWidth = 160, kHeight = 120;
constexpr float kBlockEdge_m = 0.16F;

double resident_MB() {
  std::ifstream in("/proc/self/statm");
  std::uint64_t all = 0, resident = 0;
  in >> all >> resident;
  return 1e-6 * static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

// A picture of a wall that comes and goes, no colour.
std::vector<std::uint8_t> picture(int n) {
  std::vector<std::uint8_t> out;
  ByteWriter w(out);
  w.u16(kWidth);
  w.u16(kHeight);
  for (const float v : {140.0F, 140.0F, 80.0F, 60.0F}) w.f32(v);
  for (const double v : {0.0, 0.0, 1.0, 0.5, -0.5, 0.5, -0.5}) w.f64(v);
  w.u32(2 * kWidth * kHeight);
  w.u32(0);
  w.u32(0);  // no colour, and padding
  for (int i = 0; i < kWidth * kHeight; ++i)
    w.u16(static_cast<std::uint16_t>(1500 + 10 * (n % 50) + i % 7));
  return out;
}

std::vector<std::uint8_t> pose() { return std::vector<std::uint8_t>(160, 0); }

std::vector<std::uint8_t> cost_map(int n) {
  std::vector<std::uint8_t> out;
  ByteWriter w(out);
  w.u16(80);
  w.u16(80);
  w.f32(0.05F);
  for (const double v : {-2.0, -2.0, 0.0, 1.0, 0.0, 0.0, 0.0}) w.f64(v);
  for (int i = 0; i < 80 * 80; ++i) w.u8(static_cast<std::uint8_t>((i + n) % 255));
  return out;
}

std::string text(int n) {
  nlohmann::json j{{"version", "bench"}, {"mode", "hold"}, {"phase", "idle"}};
  for (int i = 0; i < 100; ++i)
    j["events"].push_back(
        {{"t", n + i}, {"kind", "note"}, {"text", "event " + std::to_string(n + i)}});
  return j.dump();
}

// A patch of a floor of 20 by 20 blocks, cut again and again: a square a block, its height changes.
void floor_patch(int n, perception::MeshDelta& d) {
  constexpr int kSide = 20;
  d.seq = static_cast<std::uint64_t>(n) + 1;
  d.block_count = kSide;
  d.vertex_count = 4 * kSide;
  d.triangle_count = 2 * kSide;
  const float z = 0.02F + 0.001F * static_cast<float>(n % 40);
  for (int i = 0; i < kSide; ++i) {
    const auto at = static_cast<std::size_t>(i);
    auto& block = d.blocks[at];
    block.at = {n % kSide, i, 0};
    block.version = static_cast<std::uint32_t>(n / kSide + 1);
    block.vertices = 4;
    block.triangles = 2;
    for (std::size_t k = 0; k < 4; ++k) {
      auto& v = d.vertices[4 * at + k];
      v.x = kBlockEdge_m * static_cast<float>(n % kSide + static_cast<int>(k % 2));
      v.y = kBlockEdge_m * static_cast<float>(i + static_cast<int>(k / 2));
      v.z = z;
    }
    d.triangles[2 * at] = {0, 1, 2};
    d.triangles[2 * at + 1] = {1, 3, 2};
  }
}

class Views {
 public:
  explicit Views(ConsoleServer& server) : server_(server) {}
  void publish() {
    const ViewStamp at{static_cast<double>(n_) / 30, static_cast<double>(n_) / 30, 0};
    server_.publish(ViewKind::kPose, at, pose());
    if (n_ % 2 == 0) server_.publish(ViewKind::kPicture, at, picture(n_));
    if (n_ % 3 == 0) {
      mesh_->restart = server_.wants_whole_mesh();
      floor_patch(n_ / 3, *mesh_);
      server_.publish_mesh(*mesh_, at, static_cast<double>(kBlockEdge_m));
    }
    if (n_ % 6 == 0) server_.publish(ViewKind::kText, at, text(n_));
    if (n_ % 15 == 0) server_.publish(ViewKind::kCostMap, at, cost_map(n_));
    ++n_;
  }

 private:
  ConsoleServer& server_;
  std::unique_ptr<perception::MeshDelta> mesh_ = std::make_unique<perception::MeshDelta>();
  int n_ = 0;
};

std::uint64_t sent(const ConsoleServer& server) { return server.counts().views_sent; }

// At the rate of a run: what an hour's worth is has been taken, and reloads need the processors.
void publish_at_rate(Views& views, milliseconds how_long) {
  const auto end = Clock::now() + how_long;
  while (Clock::now() < end) {
    views.publish();
    std::this_thread::sleep_for(kFramePeriod);
  }
}

// The next views come when the last have left; a viewer that is slow holds nobody up for long.
void publish_for(ConsoleServer& server, Views& views, milliseconds how_long) {
  constexpr milliseconds kPatience{30};
  const auto end = Clock::now() + how_long;
  while (Clock::now() < end) {
    const auto before = sent(server);
    views.publish();
    const auto give_up = Clock::now() + kPatience;
    while (sent(server) == before && Clock::now() < give_up)
      std::this_thread::sleep_for(milliseconds{1});
  }
}

// What the script has said of the browser so far, a line every other second.
void read_lines(const std::string& said, GrowthPart& out) {
  out.heap_MB.clear();
  out.renderer_MB.clear();
  std::istringstream in(said);
  for (std::string line; std::getline(in, line);) {
    const auto j = nlohmann::json::parse(line, nullptr, false);
    if (!j.is_object() || !j.contains("heap_MB")) continue;
    out.heap_MB.push_back(j["heap_MB"]);
    out.renderer_MB.push_back(j["renderer_MB"]);
    out.reloads = j["reloads"];
  }
}

}  // namespace

void measure_growth(std::ostream& progress, const ConsoleBenchOptions& options, GrowthPart& out) {
  out.no_browser = no_browser();
  if (!out.no_browser.empty()) return;
  const std::uint64_t few = options.long_run ? 1 : kFewer;
  const std::uint64_t messages = kMessages / few;
  const int reloads = kReloads / static_cast<int>(few);
  const double least_s = std::max(kLeast_s, options.seconds);
  progress << "growth: " << messages << " messages, " << reloads << " reloads\n" << std::flush;
  ConsoleOptions server_options;
  server_options.page_folder = own_folder() + "/share/teletact/console";
  auto started = ConsoleServer::start(server_options, {});
  if (!started) throw std::runtime_error(started.error());
  ConsoleServer& server = *started.value();
  const BenchFolder folder;
  ChildProgram script({"node", page_script(), "grow", server.url(), std::to_string(reloads)},
                      folder.path() + "/script.said", true);
  Views views(server);
  const auto begin = Clock::now();
  const auto passed_s = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  // The browser's script tells of its memory every other second at most, more rarely while it
  // reloads.
  while (out.messages < messages || out.reloads < reloads || passed_s() < least_s ||
         out.heap_MB.size() < Growth::kLeast) {
    if (out.messages < messages)
      publish_for(server, views, milliseconds{1000});
    else
      publish_at_rate(views, milliseconds{1000});
    read_lines(script.said(), out);
    out.messages = sent(server);
    if (!out.heap_MB.empty()) out.server_MB.push_back(resident_MB());
    if (!script.runs()) throw std::runtime_error("the page's script ended: " + script.last_line());
    if (passed_s() > kMost_s) throw std::runtime_error("the views were not taken in time");
  }
  out.seconds = passed_s();
  script.end_input();
  publish_for(server, views, milliseconds{500});
  if (script.wait_for(60) != 0)
    throw std::runtime_error("the page's script: " + script.last_line());
}

}  // namespace teletact
