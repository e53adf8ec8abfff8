// The desk: between a page's server and the tasks of the operator's box. docs/desk.md.
//
//   take(), stop(), role()   from the server's thread; they return at once
//   tick()                   by the console's thread, after the console's own tick, every 20 ms:
//                            acts that wait become inputs of the tasks and are answered, holds are
//                            kept, and, with somebody there to look, views are made. With nobody
//                            there none is made.
//   await_acts(),            by the same thread between two ticks on the real clock: acts do not
//   take_acts()              wait for the next one
//
// What a page asks for is an input like a device's sample: a recording holds what the tasks latched
// of it, so a run that was driven from a page replays bit for bit.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/console/console_server.hpp"
#include "tools/desk/desk_acts.hpp"
#include "tools/desk/desk_inbox.hpp"
#include "tools/desk/desk_show.hpp"
#include "tools/desk/task_watch.hpp"

namespace teletact {

struct DeskOptions {
  // Empty: acts are taken. Else every act is refused with this line; a stop never is.
  std::string no_acts;
  bool paced = false;
  std::string device;                   // kind, as the page names it
  PageHand* hand = nullptr;             // null: none stands between the haptic task and its device
  TaskWatch* tasks = nullptr;           // null: nothing is told of the tasks' timing
  std::string log;                      // file of all events; empty: none
  std::function<std::int64_t()> clock;  // of arrivals, ns; empty: the monotonic one
  bool clicks_at_once = false;          // see ClickWorker; the disk of sessions as well
  SessionPlace sessions;                // its scene is written by the desk
};

class Desk {
 public:
  Desk(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
       DeskOptions options, DeskPort port);

  // None: answered later, or not at all (token, drive, hand).
  [[nodiscard]] std::optional<ConsoleAnswer> take(std::uint32_t session, std::int64_t id,
                                                  std::string_view act,
                                                  const nlohmann::json& intent);
  void stop() noexcept { acts_.stop(); }
  void role(const RoleEvent& event);
  void tick(rt::Time now);
  // Sleeps until acts wait, so long at most. False: none does.
  [[nodiscard]] bool await_acts(rt::Nanos most) { return inbox_.await(most); }
  void take_acts(rt::Time now);

  [[nodiscard]] const DeskActs& acts() const noexcept { return acts_; }
  [[nodiscard]] const DeskEvents& events() const noexcept { return events_; }
  [[nodiscard]] const DeskFigures& figures() const noexcept { return figures_; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(); }

 private:
  [[nodiscard]] std::int64_t clock_ns() const { return options_.clock(); }
  void do_acts(rt::Time now);
  void answer(std::uint32_t session, std::int64_t id, const ConsoleAnswer& answer);

  OperatorConsole& console_;
  DeskOptions options_;
  DeskPort port_;
  DeskInbox inbox_;
  DeskEvents events_;
  DeskActs acts_;
  DeskFigures figures_;
  DeskShow show_;
  rt::Time now_{};  // of the last look at what has come
  std::atomic<std::uint64_t> refused_{0};
};

}  // namespace teletact
