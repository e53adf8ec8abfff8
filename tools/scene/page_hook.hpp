// A page beside the console: what a run calls where somebody sits at one. The room that serves
// pages implements it; without a page nothing calls it. By the console's thread alone.
#pragma once

#include <cstdint>
#include <thread>

#include "drivers/haptic/haptic_device.hpp"
#include "rt/audit/run_log.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace teletact {

struct BoxOptions;
class OperatorBox;
class OperatorConsole;
struct Scene;

// Of a core, declared for a page beside the console's own thread: views and server.
inline constexpr double kPageShare = 0.10;

class PageHook {
 public:
  // kFree: simulated time, as fast as it goes.
  enum class Clock : std::uint8_t { kReal, kPaced, kFree };
  virtual ~PageHook() = default;
  // Before the box is made: what stands between the haptic task and its device; `device` where
  // nothing is to. It outlives the box.
  [[nodiscard]] virtual drivers::HapticDevice* hand_over(rt::NonRealtime&,
                                                         drivers::HapticDevice& device) {
    return &device;
  }
  // In the operator's process, once box and console stand, before the first job.
  virtual void open(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
                    Clock clock) = 0;
  // The tasks of a box, before their first job, and what each job and sentinel was like. On the
  // real clock those of the operator's box, by the thread that keeps the records.
  virtual void tasks(const rt::RunLog& /*header*/) {}
  virtual void job(const rt::JobRecord& /*record*/) {}
  virtual void sentinel(const rt::SentinelRecord& /*record*/) {}
  // After each tick of the console.
  virtual void tick(rt::Time now) = 0;
  // On the real clock, between two ticks: sleeps until the page asks for something that becomes an
  // input of a task, so long at most. True: it does, and take_acts() hands it over at once.
  [[nodiscard]] virtual bool await_acts(rt::Nanos most) {
    std::this_thread::sleep_for(most);
    return false;
  }
  virtual void take_acts(rt::Time /*now*/) {}
  // Before the box goes.
  virtual void close() = 0;
  // CPU that the page has cost this process so far, beside the console's own thread.
  [[nodiscard]] virtual std::int64_t cpu_ns() const = 0;
};

// The page's hand into what a box is made with, inside of what is there already (a recorder's tap).
// Nothing where there is no page.
void put_page_hand(rt::NonRealtime& nrt, PageHook* page, BoxOptions& options);

}  // namespace teletact
