// The sums of one ICP iteration over one pyramid level.
#pragma once

#include <array>
#include <cstdint>

#include "perception/icp/model_view.hpp"
#include "perception/icp/preprocess.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

struct Gates {
  float distance_m = 0.1F;    // largest |q - v_m|
  float normal_cos = 0.866F;  // smallest n_live . n_m
  icp::NoiseRule noise{0.0015F, 0.004F, 0.8F};
  float map_error_m = 0.01F;  // of the model's surface
};

// Weighted normal equations H xi = -g of xi = (v, w) about `centre_F`, residual sums and counts.
struct NormalEquations {
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  double weight = 0;  // sum of weights
  double r2 = 0;      // sum of weight * r^2
  std::int64_t inliers = 0;
  std::int64_t met = 0;   // live points that project onto a model surface
  std::int64_t live = 0;  // live points with depth
  // Of `met`: within the gate's distance, and nearer to the model's tangent plane than
  // icp::kOnSurfaceSigmas sigmas of the reading plus the map's error, whatever the normals.
  // accumulate_cross() only.
  std::int64_t on_surface = 0;
};

// The cross moment of live and model rows, symmetrised: 1/2 sum w (J_l J_m^T + J_m J_l^T) with
// J = [n, (q - c) x n], n the live or the model normal. Same weights and gates.
struct CrossMoment {
  Mat6 H = Mat6::Zero();
};

// X_FC: pose of the live camera in the model's frame. Noexcept, no allocation. The level's size
// alone decides how rows are divided into parts, and the parts' sums are added in order: the same
// bytes for any number of threads.
void accumulate(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                rt::ForkJoin& crew = rt::serial()) noexcept;
// The same with the cross moment (about a third dearer; once a level).
void accumulate_cross(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                      const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                      CrossMoment& cross, rt::ForkJoin& crew = rt::serial()) noexcept;

}  // namespace perception
