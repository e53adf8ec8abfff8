#include "perception/icp/normal_equations.hpp"

#include "perception/icp/kernels.hpp"

namespace perception {

namespace {

void to_float(const Pose& X, float* R, float* t) noexcept {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) R[3 * i + j] = static_cast<float>(X.linear()(i, j));
    t[i] = static_cast<float>(X.translation()(i));
  }
}

icp::RowJob make_job(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                     const Vec3& centre_F, const Gates& gates) noexcept {
  icp::RowJob job{};
  job.x_factor = live.x_factor.data() + PaddedImage::kMargin;
  job.width = live.depth.width();
  to_float(X_FC, job.R_F, job.t_F);
  job.fx = static_cast<float>(model.intrinsics.fx);
  job.fy = static_cast<float>(model.intrinsics.fy);
  job.cx = static_cast<float>(model.intrinsics.cx);
  job.cy = static_cast<float>(model.intrinsics.cy);
  job.model = model.data;
  job.model_width = static_cast<float>(model.intrinsics.width);
  job.model_height = static_cast<float>(model.intrinsics.height);
  for (int i = 0; i < 3; ++i) job.centre[i] = static_cast<float>(centre_F(i));
  job.gate_d2 = gates.distance_m * gates.distance_m;
  job.gate_cos = gates.normal_cos;
  job.range_weight2 = gates.range_weight_m * gates.range_weight_m;
  return job;
}

// Lanes in rising order, in double.
double lane_sum(const float* lanes) noexcept {
  double s = 0;
  for (int k = 0; k < icp::kLanes; ++k) s += static_cast<double>(lanes[k]);
  return s;
}

void unpack_upper(const double* upper, Mat6& H) noexcept {
  int s = 0;
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) H(i, j) = H(j, i) = upper[s++];
  }
}

void accumulate_rows(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                     const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                     CrossMoment* cross) noexcept {
  icp::RowJob job = make_job(live, model, X_FC, centre_F, gates);
  const icp::Kernels& k = icp::kernels();
  double sums[icp::kSums] = {};
  double cross_sums[icp::kCross] = {};
  icp::RowSums row;
  out = NormalEquations{};
  for (int v = 0; v < live.depth.height(); ++v) {
    job.z = live.depth.row(v);
    job.nx = live.nx.row(v);
    job.ny = live.ny.row(v);
    job.nz = live.nz.row(v);
    job.y_factor = live.y_factor[static_cast<std::size_t>(v + PaddedImage::kMargin)];
    if (cross != nullptr) {
      k.accumulate_row_cross(job, row);
      for (int i = 0; i < icp::kCross; ++i) cross_sums[i] += lane_sum(row.cross[i]);
    } else {
      k.accumulate_row(job, row);
    }
    for (int i = 0; i < icp::kSums; ++i) sums[i] += lane_sum(row.sums[i]);
    out.inliers += row.inliers;
    out.met += row.met;
    out.live += row.live;
  }
  unpack_upper(sums, out.H);
  for (int i = 0; i < 6; ++i) out.g(i) = sums[21 + i];
  out.r2 = sums[27];
  out.weight = sums[28];
  if (cross != nullptr) unpack_upper(cross_sums, cross->H);
}

}  // namespace

void accumulate(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                const Vec3& centre_F, const Gates& gates, NormalEquations& out) noexcept {
  accumulate_rows(live, model, X_FC, centre_F, gates, out, nullptr);
}

void accumulate_cross(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                      const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                      CrossMoment& cross) noexcept {
  accumulate_rows(live, model, X_FC, centre_F, gates, out, &cross);
}

}  // namespace perception
