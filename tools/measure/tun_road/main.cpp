// teletact-road: a bad network for real packets between two network namespaces.
//
//   ip netns add road-left; ip netns add road-right
//   teletact-road --set rate_Mbit_per_s=10 --set delay_ms=75 --set jitter_ms=20 --set loss=0.005 &
//   ip netns exec road-right iperf3 -s &
//   ip netns exec road-left iperf3 -c 10.77.0.2
//
// Says "ready" on stderr, ends with SIGINT or SIGTERM, prints what it has counted. Exit code 2: one
// line says why not.
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <stdexcept>

#include "tools/cli/options.hpp"
#include "tools/files/take.hpp"
#include "tools/measure/tun_road/tun_device.hpp"
#include "tools/measure/tun_road/tun_road.hpp"

namespace {

std::atomic<bool> g_stop{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may not wait");
void on_signal(int) { g_stop.store(true); }

int run(int argc, char** argv) {
  CLI::App app{
      "A road of a stated rate, queue, delay, jitter, loss and reordering between two "
      "network namespaces.",
      "teletact-road"};
  teletact::TunRoadOptions options;
  std::string file;
  std::vector<std::string> keys;
  bool congestion = false;
  app.add_option("--left", options.left, "namespace at 10.77.0.1")->capture_default_str();
  app.add_option("--right", options.right, "namespace at 10.77.0.2")->capture_default_str();
  app.add_option("--config", file, "TOML with the keys of [link.network], loss, reorder");
  app.add_option("--set", keys, "one of these keys: key=value");
  app.add_option("--seconds", options.seconds, "0: until SIGINT or SIGTERM")
      ->check(teletact::in_range(0, 864000));
  app.add_flag("--congestion", congestion,
               "only say which of bbr and cubic a socket of this kernel takes");
  if (!teletact::parse_options(app, argc, argv)) return 0;
  if (congestion) {
    for (const auto& name : teletact::settable_congestion({"bbr", "cubic"}))
      std::printf("%s\n", name.c_str());
    return 0;
  }
  config::Section schema;
  options.road.describe(schema);
  if (!file.empty()) (void)teletact::take(config::load_file(file, schema));
  for (const auto& key : keys) (void)teletact::take(config::load_override(key, schema));
  if (const auto wrong = options.road.network.wrong(); !wrong.empty())
    throw std::runtime_error(wrong);
  if (const auto why = teletact::road_refusal(); !why.empty()) throw std::runtime_error(why);
  for (const int s : {SIGINT, SIGTERM}) std::signal(s, on_signal);
  const auto ready = [] { std::fputs("teletact-road: ready\n", stderr); };
  const auto result = teletact::take(teletact::run_tun_road(options, g_stop, ready));
  std::printf("%s\n", teletact::road_json(result).c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "teletact-road: %s\n", e.what());
    return 2;
  }
}
