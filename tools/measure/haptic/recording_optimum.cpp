#include "tools/measure/haptic/recording_optimum.hpp"

#include <algorithm>
#include <cmath>

#include "tools/measure/support/field_optimum.hpp"

namespace teletact {

using perception::Vec3;

namespace {

constexpr double kAbout_m =
    0.03;  // of the field beside hand and proxy: the longest way of a search, and a cell

// The blended windows about hand and proxy. A node that was not observed is NaN, and nothing is
// solid beside it.
support::ReferenceField field_about(const PopChecker& windows, double blend, const Vec3& p_W,
                                    const Vec3& h_W) {
  const double voxel = windows.voxel_m();
  const Vec3 lo = (p_W.cwiseMin(h_W).array() - kAbout_m) / voxel,
             hi = (p_W.cwiseMax(h_W).array() + kAbout_m) / voxel;
  const Eigen::Array3i first = lo.array().floor().cast<int>();
  const Eigen::Array3i count = hi.array().ceil().cast<int>() - first + 1;
  const auto node = [&](int x, int y, int z) { return windows.node_value({x, y, z}, blend); };
  return {node, voxel, first, count};
}

}  // namespace

void RecordingOptimum::count(double step_N, double moved_m, double stiffness_N_per_m,
                             ContactFigures& of, std::uint64_t& run) noexcept {
  const bool jump = step_N > stiffness_N_per_m * moved_m + 0.5;
  run = jump ? run + 1 : 0;
  of.jumps += jump ? 1 : 0;
  of.longest_jump = std::max(of.longest_jump, run);
  of.step_max_N = std::max(of.step_max_N, step_N);
}

void RecordingOptimum::tick(std::size_t k, const Vec3& h_W, double step_product_N,
                            PopChecker& field, double blend) {
  if (!begun_) {
    begun_ = true;
    p_W_ = h_W_ = h_W;
    f_W_ = Vec3::Zero();
    turn_ = {};
    run_product_ = run_optimum_ = 0;
  }
  const support::ReferenceField about = field_about(field, blend, p_W_, h_W);
  const support::FieldOptimum optimum(about, config_.tip_radius_m, field.voxel_m());
  p_W_ = optimum.follow(p_W_, h_W_, h_W);
  const double moved_m = (h_W - h_W_).norm() / config_.scale;
  h_W_ = h_W;
  Vec3 f_W = config_.stiffness_N_per_m / config_.scale * (p_W_ - h_W);
  f_W *= std::min(1.0, config_.force_limit_N / std::max(f_W.norm(), 1e-12));
  ++product_.ticks;
  ++optimum_.ticks;
  count(step_product_N, moved_m, config_.stiffness_N_per_m, product_, run_product_);
  count((f_W - f_W_).norm(), moved_m, config_.stiffness_N_per_m, optimum_, run_optimum_);
  f_W_ = f_W;
  optimum_.turned += turn_.judge((p_W_ - h_W).norm() > 1e-6, p_W_ - h_W) ? 1 : 0;
  if (k == spans_[at_].second) ++at_, begun_ = false;
}

}  // namespace teletact
