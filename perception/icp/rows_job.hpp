// A level against a model as the kernels want it.
#pragma once

#include "perception/icp/normal_equations.hpp"

namespace perception {

// X_FC: pose of the live camera in the model's frame.
[[nodiscard]] icp::RowsJob make_rows_job(const DepthLevel& live, const ModelView& model,
                                         const Pose& X_FC, const Vec3& centre_F,
                                         const Gates& gates) noexcept;

}  // namespace perception
