// SIGINT, SIGTERM, SIGHUP: what run_options.hpp says of them. SIGPIPE, SIGXFSZ: ignored.
#include <signal.h>

#include "rt/clock/box_time.hpp"
#include "tools/host/run_options.hpp"

namespace teletact {

std::atomic<bool> g_stop_requested{false};
std::atomic<std::int64_t> g_stop_asked_ns{0};
std::atomic<std::atomic<bool>*> g_ramp_down{nullptr};

namespace {

static_assert(std::atomic<std::int64_t>::is_always_lock_free &&
                  std::atomic<std::atomic<bool>*>::is_always_lock_free,
              "a signal handler may not wait");
void on_signal(int) {
  std::int64_t never = 0;
  g_stop_asked_ns.compare_exchange_strong(never, rt::monotonic_ns());
  if (auto* request = g_ramp_down.load()) request->store(true);
  g_stop_requested.store(true);
}

}  // namespace

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // The terminal is gone, as when the road to it is: an orderly end, but under nohup.
  struct sigaction before {};
  if (sigaction(SIGHUP, nullptr, &before) == 0 && before.sa_handler != SIG_IGN)
    sigaction(SIGHUP, &action, nullptr);
  // Who read the lines is gone: they are lost, and the box drives on.
  action.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &action, nullptr);
  // A file that may not grow any more (a limit of the shell's or the service's): as on a full disk
  // the write fails, and is told. The kernel's default would end the box while it drives.
  sigaction(SIGXFSZ, &action, nullptr);
}

}  // namespace teletact
