// What a box says into its store beside the jobs, and of it: changes of the mode, what is lowered
// of the pictures, a disk that refuses.
#pragma once

#include <string>
#include <utility>

#include "rt/store/run_store.hpp"
#include "tasks/contract/messages.hpp"
#include "tools/files/refused_files.hpp"
#include "tools/pictures/picture_words.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

// The consoles' samples are saved whole: each second at first, when a run is short and a kill
// near, then less often.
inline constexpr std::int64_t save_period_ns(std::int64_t since_epoch_ns) noexcept {
  return since_epoch_ns < 60000000000 ? 1000000000 : 10000000000;
}

class StoreWatch {
 public:
  // `folder`: the store's.
  StoreWatch(rt::RunStore& store, rt::Box box, std::string folder, RefusedFiles& refused)
      : store_(store), box_(box), folder_(std::move(folder)), refused_(refused) {}

  void look(const tasks::ModeMsg& mode, drivers::Spared spared, rt::Time now) {
    if (mode.seq != 0 && (mode.mode != mode_ || mode.cause != cause_)) {
      static constexpr const char* kNames[] = {"init", "hold", "engaged", "ramp down", "safe stop"};
      std::string text = std::string("mode ") + kNames[static_cast<int>(mode.mode)];
      if (mode.cause != rt::kNoFault) text += ", " + fault_text(mode.cause);
      store_.event(rt::ns_of(now), text);
      mode_ = mode.mode;
      cause_ = mode.cause;
    }
    if (const std::string line = spared_.look(spared, rt::ns_of(now)); !line.empty())
      store_.event(rt::ns_of(now), line);
    const std::string problem = store_.problem();
    if (problem.empty() || told_) return;
    told_ = true;
    store_.event(rt::ns_of(now), problem);
    refused_.tell(box_ == rt::Box::kOperator ? "operator" : "robot", folder_,
                  "the job records are thinned harder, and counted");
  }

 private:
  rt::RunStore& store_;
  rt::Box box_;
  std::string folder_;
  RefusedFiles& refused_;
  tasks::Mode mode_ = tasks::Mode::kInit;
  rt::FaultId cause_ = rt::kNoFault;
  SparedNews spared_;
  bool told_ = false;
};

}  // namespace teletact
