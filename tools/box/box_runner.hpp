// Runs one box's tasks on the real clock once its graph, link and console stand: the executor in a
// thread of its own, and in this one the console, the files, and the end (a signal, a hung task).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/link/link_transport.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/sched/registry.hpp"
#include "rt/store/run_store.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tools/box/box_main.hpp"
#include "tools/box/box_status.hpp"
#include "tools/box/link_news.hpp"
#include "tools/files/refused_files.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

[[nodiscard]] std::vector<rt::PlacedTask> placed_tasks(
    const BoxPlan& plan, rt::Box box, const std::function<rt::TaskBody&(tasks::TaskId)>& body);

// Refuses to start beside another teletact whose tasks leave no room on these cores;
// without a box, with the rows of both.
[[nodiscard]] rt::Registry enter_registry(const BoxPlan& plan, std::optional<rt::Box> box);

struct BoxRunner {
  const DemoOptions& options;
  const BoxPlan& plan;
  rt::Box box;
  rt::BoxTime clock;
  std::vector<rt::PlacedTask> placed{};
  tasks::OperatorRequests* requests = nullptr;
  drivers::LinkTransport* link = nullptr;
  std::function<void(rt::Time)> tick{};    // console
  std::function<void(rt::Nanos)> rest{};   // between two looks, so long at most; empty: sleeps
  std::function<bool()> save{};            // partial half, so that a kill loses little
  std::function<void()> make_safe{};       // outputs to zero, from any thread
  std::function<tasks::ModeMsg()> mode{};  // newest that the console has seen
  std::vector<BoxTotals> totals{};
  std::uint64_t dropped = 0, hangs = 0;
  std::function<std::int64_t()> camera_twin_cpu{};  // empty: no camera's twin in this process
  OrdinaryCpu ordinary{};
  std::unique_ptr<BoxRecorder> black_box{};
  RefusedFiles refused{};
  LinkNews link_news{};
  PictureRoad picture_road{};
  std::function<void(std::string_view)> say{};        // a line into the box's log
  rt::RunStore* store = nullptr;                      // while it runs
  const std::vector<std::string>* missing = nullptr;  // real-time rights; null: not known yet
  std::optional<StatusServer> status_server{};
  tasks::LinkStatus* link_status = nullptr;

  [[nodiscard]] const char* name() const noexcept {
    return box == rt::Box::kOperator ? "operator" : "robot";
  }
  [[nodiscard]] rt::Time now() const { return clock.from_host(rt::monotonic_ns()); }

  // Handshake before the epoch, or an error that names what is missing.
  void await_link() const;
  // Of a box of its own: answers `teletact status` from now on. Without a place for the socket it
  // runs all the same, and says so.
  void answer_status();
  // Returns at the end of the run; its jobs are in `file`.
  void run(rt::NonRealtime& nrt, const std::string& file);

 private:
  struct Watch;
  template <class Faults>
  void run(rt::NonRealtime& nrt, const Faults& faults, const std::string& file);
  void watch(Watch& w, rt::RunStore& writer, const std::function<void()>& request_stop,
             const std::function<std::uint64_t()>& hung,
             const std::function<const std::vector<std::string>*()>& rights);
  void save_now_and_then(Watch& w, rt::RunStore& writer, std::int64_t host_ns);
  void note_request(std::int64_t host) const;
  void look();
  // To whoever watches this program, to the log, and so to the black box.
  void tell(const std::string& line) const;
  void tell_rights() const;
  void begin_black_box(const rt::RunLog& header);
  void end_black_box(bool asked) const;
  [[nodiscard]] BoxStatus status() const;
  void add_link(BoxStatus& status) const;
  void add_machine(BoxStatus& status) const;
  [[nodiscard]] OrdinaryCpu ordinary_now() const;

  void tell_page(const rt::JobRecord& record) const;
  void tell_page(const rt::SentinelRecord& record) const;
  template <class Record>
  void keep(rt::RunStore& writer, const Record& record) {
    writer.add(record);
    if (black_box) black_box->add(record);
    tell_page(record);
  }
};

}  // namespace teletact
