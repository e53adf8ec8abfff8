// What has happened, in words: the newest for the page's timeline, all of them in a file.
#pragma once

#include <cstdint>
#include <cstdio>
#include <deque>
#include <memory>
#include <string>
#include <string_view>

#include "tools/host/console.hpp"

namespace teletact {

class DeskEvents {
 public:
  static constexpr std::size_t kMost = 100;
  struct Event {
    double t_s = 0;  // since the epoch of the run
    std::string kind, text;
  };

  // `path` empty: no file.
  DeskEvents(rt::Time epoch, const std::string& path);
  void add(rt::Time now, std::string kind, std::string text);
  // In the file alone: acts, answers, roles. From kMostLogged bytes on nothing more of these.
  void note(rt::Time now, std::string_view kind, std::string_view text);
  static constexpr std::uint64_t kMostLogged = 64U << 20U;
  // Since the epoch of the run.
  [[nodiscard]] double seconds_at(rt::Time now) const { return rt::seconds(now - epoch_); }
  // Tells of what has changed since the last look: mode, phase, faults.
  void watch(const OperatorView& seen, rt::Time now);
  [[nodiscard]] const std::deque<Event>& newest() const noexcept { return events_; }
  [[nodiscard]] std::uint64_t all() const noexcept { return all_; }
  // When the fault that is reported now began.
  [[nodiscard]] double mode_since_s() const noexcept { return mode_since_s_; }
  [[nodiscard]] double robot_mode_since_s() const noexcept { return robot_mode_since_s_; }
  [[nodiscard]] double robot_fault_since_s() const noexcept { return robot_fault_since_s_; }

 private:
  struct Close {
    void operator()(std::FILE* f) const noexcept { std::fclose(f); }
  };
  rt::Time epoch_;
  std::unique_ptr<std::FILE, Close> file_;
  std::deque<Event> events_;
  std::uint64_t all_ = 0, logged_bytes_ = 0;
  tasks::Mode mode_ = tasks::Mode::kInit;
  rt::FaultId cause_ = rt::kNoFault;
  std::uint16_t robot_fault_ = 0, robot_cause_ = 0;
  std::uint8_t robot_mode_ = 0;
  tasks::TaskState::Phase phase_ = tasks::TaskState::Phase::kIdle;
  tasks::CameraPose::Tracking tracking_ = tasks::CameraPose::Tracking::kLost;
  std::uint32_t named_ = 0;
  double mode_since_s_ = 0, robot_mode_since_s_ = 0, robot_fault_since_s_ = 0;
};

}  // namespace teletact
