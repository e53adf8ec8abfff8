// The black box of one box of the demo: the last seconds of its job records, sentinels, log lines
// (modes, contacts, marks, ...) and sensed inputs, in <folder>/<box>.blackbox
// (rt/audit/black_box.hpp).
//
// A normal end removes it. Anything else leaves it: an end by request, a hung task, an error, a
// crash, SIGKILL. A ramp down or safe stop in the midst of a run that goes on leaves a copy of the
// seconds round it, <box>.stop<n>.blackbox. They are numbered on; of more than kMaxStops the oldest
// goes, a ramp down before a safe stop. All by ordinary threads.
//
// Records beside 'J' and 'S':
//   'L'  a line of a task's log: "<time s> <task>: text"
//   'I'  JobOp: what a job latched from outside (input_record.hpp)
//   'R'  RecordingMark, with --record: how far the recording beside it had come
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "rt/audit/black_box.hpp"
#include "tasks/contract/messages.hpp"
#include "tools/record/input_record.hpp"

namespace teletact {

struct RecordingMark {
  std::int64_t at_ns = 0;  // box clock
  std::uint64_t ops = 0, messages = 0, frames = 0;
};

class BoxRecorder {
 public:
  static constexpr std::size_t kMaxStops = 8;
  static constexpr rt::Nanos kAfterStop = std::chrono::milliseconds{500};

  // Throws std::runtime_error naming the file.
  BoxRecorder(const std::string& folder, rt::Box box, const rt::RunLog& header, double seconds);
  ~BoxRecorder();  // without end(): the file stays
  BoxRecorder(const BoxRecorder&) = delete;
  BoxRecorder& operator=(const BoxRecorder&) = delete;

  void add(const rt::JobRecord& record) noexcept { writer_.add(record); }
  void add(const rt::SentinelRecord& record) noexcept { writer_.add(record); }
  void add(const JobOp& op) noexcept;
  void add(const RecordingMark& mark) noexcept;
  void line(std::string_view text) noexcept;
  // Every so often: the mode in force. Entering a ramp down or a safe stop is a stop.
  void watch(const tasks::ModeMsg& mode, rt::Time now);
  // Crashes of this process leave their signal's number in this file.
  void catch_crashes() noexcept;
  // Empty: a normal end.
  void end(const std::string& why);

 private:
  struct Kept {
    int number;
    bool safe;
  };
  void copy_stop();
  [[nodiscard]] std::string copy_of(int stop) const;
  std::string stem_;
  rt::BlackBoxWriter writer_;
  tasks::Mode mode_ = tasks::Mode::kInit;
  int stops_ = 0;
  std::vector<Kept> kept_;
  std::string pending_;  // why of the stop whose copy is due
  bool pending_safe_ = false;
  rt::Time due_{};
};

// "F-SUP-02 link silent" for a fault id; "no fault" for none.
[[nodiscard]] std::string fault_text(rt::FaultId id);
// The same for what put the operator's box into its mode. If that is what the robot's box did, the
// cause is there: "F-SUP-05 the other box went into a safe stop (there: F-CRE-03 ...)".
[[nodiscard]] std::string cause_text(rt::FaultId id, const drivers::RobotState& robot);
// "; to do: check the network and the other box, then engage again"; empty for none.
[[nodiscard]] std::string fault_advice(rt::FaultId id);

// Black boxes in a folder and why each was left, one "<file>: <why>" a line; for the end of a run,
// which says them on stderr.
[[nodiscard]] std::vector<std::string> black_boxes_in(const std::string& folder);
void say_black_boxes(const std::string& folder);
// Those of an earlier run.
void remove_black_boxes(const std::string& folder);

// What was going on, for people: why, span, log lines and changes of the tasks' health in order of
// time.
void print_black_box(const std::string& path, const rt::BlackBox& box);

// Span of the job records, s.
[[nodiscard]] double seconds_of(const rt::BlackBox& box) noexcept;
// Log lines and health changes, in order of time.
[[nodiscard]] std::vector<std::string> events_of(const rt::BlackBox& box);

}  // namespace teletact
