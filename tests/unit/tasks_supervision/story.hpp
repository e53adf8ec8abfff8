// Stories: what the boxes do, tick by tick, when something happens.
#pragma once

#include <gtest/gtest.h>

#include "rt/memory/section.hpp"
#include "tasks/supervision/supervision_task.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {

using namespace std::chrono_literals;
using rt::Box;
using rt::Severity;
using tasks::ClearRule;
using tasks::kFaultTable;
using tasks::Mode;
using tasks::SupervisionConfig;
using tasks::SupervisionTask;
using Engage = SupervisionTask::Engage;
using Pause = SupervisionTask::Pause;
using Clear = SupervisionTask::Clear;

inline rt::Startup startup;

// A box whose world is fine unless the story says otherwise.
struct Story {
  std::array<tasks::Watch, 2> watches{{{190, 50ms}, {390, 300ms}}};
  SupervisionTask task;
  SupervisionTask::In in;
  SupervisionTask::Out out;
  rt::Tick tick;
  std::array<bool, 2> silent{};
  bool link_up = true;
  bool estop_sampled = true;
  bool peer_follows = true;

  explicit Story(Box box = Box::kOperator, const rt::ModeGate& gate = {},
                 const SupervisionConfig& config = {})
      : task(startup.token(), config, box, watches.data(), 2, gate) {
    tick.start = rt::time_from_ns(5'000'000'000);
    in.link_expected = true;
    in.estop_fitted = true;
    in.requests.engage = Engage::kNo;
    in.requests.clear = Clear::kNo;
    in.tasks[0].heard = in.tasks[1].heard = true;
  }
  Story& run(std::chrono::milliseconds time) {
    for (auto t = 0ms; t < time; t += 10ms) {
      tick.start += 10ms;
      ++tick.k;
      for (std::size_t i = 0; i < 2; ++i) {
        if (!silent[i]) in.tasks[i].heartbeat = tick.start - 1ms;
      }
      if (link_up) in.link_heard = true, in.link_last = tick.start - 20ms;
      if (estop_sampled) in.estop_sampled = tick.start;
      const Severity before = out.episode.severity;
      const Mode mode_before = out.mode.mode;
      rt_guard::reset();
      {
        rt::Section s;
        (void)task.step(tick, in, out);
      }
      EXPECT_EQ(rt_guard::counts().total(), 0U);
      EXPECT_EQ(out.mode.seq, tick.k);
      if (out.mode.mode == mode_before) {
        EXPECT_GE(out.episode.severity, before) << "severity only grows within an episode";
      }
      if (peer_follows) {
        in.peer_mode = out.mode.mode == Mode::kEngaged ? Mode::kEngaged : Mode::kHold;
        in.peer_mode_at = tick.start;
      }
    }
    return *this;
  }
  Story& engage() {
    in.requests.engage = Engage::kNo;
    run(10ms);
    in.requests.engage = Engage::kYes;
    return run(10ms);
  }
  Story& clear() {
    in.requests.clear = Clear::kNo;
    run(10ms);
    in.requests.clear = Clear::kYes;
    run(10ms);
    in.requests.clear = Clear::kNo;
    return *this;
  }
  Story& engaged() {
    run(20ms).engage();
    EXPECT_EQ(mode(), Mode::kEngaged);
    return run(50ms);
  }
  // The robot's box says what it does, whatever this one does. kNone: it says nothing of a pause.
  Story& robot_says(Mode mode, Pause pause = Pause::kNone) {
    peer_follows = false;
    in.peer_mode = mode;
    in.peer_mode_at = tick.start;
    in.peer_pause = pause;
    return *this;
  }
  Mode mode() const { return out.mode.mode; }
};

}  // namespace tests
