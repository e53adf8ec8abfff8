// The field's optimum on the hand and the windows of a recording: does it jump or turn where the
// product did? The optimum rests at the path-constrained nearest point to the hand on the blended
// windows (tools/measure/support/field_optimum.hpp). It is computed only for contacts in which the
// product missed a limit, because it takes a thousand times as long as a tick.
// Frames: W world (= map).  SI.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "tasks/haptic/haptic_task.hpp"
#include "tools/measure/support/pop_checker.hpp"

namespace teletact {

// Of product or optimum in the contacts that were asked about.
struct ContactFigures {
  std::uint64_t ticks = 0;         // asked about
  std::uint64_t jumps = 0;         // |dF| > K |dh| + 0.5 N
  std::uint64_t longest_jump = 0;  // ticks in a row
  std::uint64_t turned = 0;        // as PopChecker counts them
  double step_max_N = 0;
};

// First and last tick of a contact.
using TickSpan = std::pair<std::size_t, std::size_t>;

class RecordingOptimum {
 public:
  // `spans`: sorted, apart from each other. Each begins where the hand is in the free.
  RecordingOptimum(const tasks::HapticConfig& config, std::vector<TickSpan> spans)
      : config_(config), spans_(std::move(spans)) {}
  [[nodiscard]] bool asked(std::size_t k) const noexcept {
    return at_ < spans_.size() && k >= spans_[at_].first && k <= spans_[at_].second;
  }
  // A tick that is asked about, after the product's step. `field`: the windows that it had; `blend`
  // of the newer.
  void tick(std::size_t k, const perception::Vec3& h_W, double step_product_N, PopChecker& field,
            double blend);
  [[nodiscard]] const ContactFigures& product() const noexcept { return product_; }
  [[nodiscard]] const ContactFigures& optimum() const noexcept { return optimum_; }
  void product_turned() noexcept { ++product_.turned; }

 private:
  static void count(double step_N, double moved_m, double stiffness_N_per_m, ContactFigures& of,
                    std::uint64_t& run) noexcept;
  tasks::HapticConfig config_;
  std::vector<TickSpan> spans_;
  std::size_t at_ = 0;
  bool begun_ = false;
  perception::Vec3 p_W_ = perception::Vec3::Zero(), h_W_ = p_W_, f_W_ = p_W_;
  PopChecker::Turn turn_;
  ContactFigures product_, optimum_;
  std::uint64_t run_product_ = 0, run_optimum_ = 0;
};

}  // namespace teletact
