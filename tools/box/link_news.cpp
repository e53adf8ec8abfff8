#include "tools/box/link_news.hpp"

#include <cstdio>

#include "rt/clock/box_time.hpp"

namespace teletact {

std::string LinkNews::line(bool ready, std::uint64_t sessions, const std::string& fault) {
  const bool first = !begun_;
  begun_ = true;
  if (ready && (!was_ready_ || sessions != sessions_)) {
    was_ready_ = true;
    sessions_ = sessions;
    told_fault_.clear();
    return "link: the other box is there (connection " + std::to_string(sessions) + ")" +
           (sessions > 1 ? "; engage again to go on" : "");
  }
  if (ready) return {};
  const bool lost = was_ready_;
  was_ready_ = false;
  if (!first && !lost && fault == told_fault_) return {};
  told_fault_ = fault;
  return (lost ? "link: the other box is gone" : "link: no other box yet") +
         (fault.empty() ? std::string() : " (" + fault + ")") + "; this box holds still";
}

std::string LinkNews::refused_line(std::uint64_t refused, const char* newest, std::int64_t now_ns) {
  if (refused == refused_ || now_ns < next_refused_ns_) return {};
  // Another box, which counts from one, may be there since.
  const std::uint64_t more = refused > refused_ ? refused - refused_ : refused;
  refused_ = refused;
  next_refused_ns_ = now_ns + 1'000'000'000;
  return "the robot's box refused " + std::to_string(more) + " command" + (more == 1 ? "" : "s") +
         " (the newest: " + newest + ")";
}

void LinkNews::look(const drivers::LinkTransport& link, const tasks::LinkStatus& status,
                    bool quiet) {
  const bool ready = link.state() == drivers::LinkTransport::State::kReady;
  for (const std::string& text :
       {line(ready, link.sessions(), ready ? std::string() : link.fault()),
        refused_line(
            status.commands_refused.load(),
            drivers::to_text(static_cast<drivers::CommandFault>(status.commands_newest.load())),
            rt::monotonic_ns()),
        ready ? spared_news_.look(status.spared(), rt::monotonic_ns()) : std::string()}) {
    if (text.empty() || quiet) continue;
    std::printf("%s\n", text.c_str());
    std::fflush(stdout);
  }
}

}  // namespace teletact
