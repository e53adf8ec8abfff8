#include "perception/icp/normal_equations.hpp"

#include "perception/icp/kernels.hpp"
#include "perception/icp/rows_job.hpp"

namespace perception {

namespace {

void to_float(const Pose& X, float* R, float* t) noexcept {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) R[3 * i + j] = static_cast<float>(X.linear()(i, j));
    t[i] = static_cast<float>(X.translation()(i));
  }
}

constexpr int kMostParts = 8;

// Below some ten thousand pixels a fork costs more than it saves.
int parts_of(const icp::RowsJob& job) noexcept {
  return job.width * job.rows >= 32768 && job.rows >= kMostParts ? kMostParts : 1;
}

icp::RowsJob part_of(const icp::RowsJob& job, int part, int parts) noexcept {
  const int first = job.rows * part / parts;
  const std::ptrdiff_t at = first * job.stride;
  icp::RowsJob out = job;
  out.z += at, out.nx += at, out.ny += at, out.nz += at;
  out.y_factor += first;
  out.rows = job.rows * (part + 1) / parts - first;
  return out;
}

// Parts in rising order.
void add(const icp::LaneSums& part, bool cross, icp::LaneSums& sum) noexcept {
  for (int i = 0; i < icp::kSums; ++i)
    for (int k = 0; k < icp::kLanes; ++k) sum.sums[i][k] += part.sums[i][k];
  for (int i = 0; cross && i < icp::kCross; ++i)
    for (int k = 0; k < icp::kLanes; ++k) sum.cross[i][k] += part.cross[i][k];
  sum.inliers += part.inliers, sum.met += part.met, sum.live += part.live;
  sum.on_surface += part.on_surface;
}

void sum_parts(const icp::RowsJob& job, int parts, bool cross, rt::ForkJoin& crew,
               icp::LaneSums& lanes) noexcept {
  std::array<icp::LaneSums, kMostParts> part;  // 50 KiB of stack
  crew.for_parts(parts, [&](int p) {
    icp::kernels().accumulate(part_of(job, p, parts), cross, part[static_cast<std::size_t>(p)]);
  });
  for (int p = 0; p < parts; ++p) add(part[static_cast<std::size_t>(p)], cross, lanes);
}

// Lanes in rising order.
double lane_sum(const double* lanes) noexcept {
  double s = 0;
  for (int k = 0; k < icp::kLanes; ++k) s += lanes[k];
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
                     CrossMoment* cross, rt::ForkJoin& crew) noexcept {
  const icp::RowsJob job = make_rows_job(live, model, X_FC, centre_F, gates);
  icp::LaneSums lanes;
  if (const int parts = parts_of(job); parts == 1) {
    icp::kernels().accumulate(job, cross != nullptr, lanes);
  } else {
    sum_parts(job, parts, cross != nullptr, crew, lanes);
  }
  double sums[icp::kSums], cross_sums[icp::kCross];
  for (int i = 0; i < icp::kSums; ++i) sums[i] = lane_sum(lanes.sums[i]);
  for (int i = 0; i < icp::kCross; ++i) cross_sums[i] = lane_sum(lanes.cross[i]);
  out = NormalEquations{};
  out.inliers = lanes.inliers;
  out.met = lanes.met;
  out.live = lanes.live;
  out.on_surface = lanes.on_surface;
  unpack_upper(sums, out.H);
  for (int i = 0; i < 6; ++i) out.g(i) = sums[21 + i];
  out.r2 = sums[27];
  out.weight = sums[28];
  if (cross != nullptr) unpack_upper(cross_sums, cross->H);
}

}  // namespace

icp::RowsJob make_rows_job(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                           const Vec3& centre_F, const Gates& gates) noexcept {
  icp::RowsJob job{};
  job.x_factor = live.x_factor.data() + PaddedImage::kMargin;
  job.width = live.depth.width();
  job.rows = live.depth.height();
  job.stride = live.depth.stride();
  job.z = live.depth.row(0);
  job.nx = live.nx.row(0);
  job.ny = live.ny.row(0);
  job.nz = live.nz.row(0);
  job.y_factor = live.y_factor.data() + PaddedImage::kMargin;
  to_float(X_FC, job.R_F, job.t_F);
  job.fx = static_cast<float>(model.intrinsics.fx);
  job.fy = static_cast<float>(model.intrinsics.fy);
  job.cx = static_cast<float>(model.intrinsics.cx);
  job.cy = static_cast<float>(model.intrinsics.cy);
  job.inv_fx = static_cast<float>(1 / model.intrinsics.fx);
  job.inv_fy = static_cast<float>(1 / model.intrinsics.fy);
  job.model = model.data;
  job.model_width = static_cast<float>(model.intrinsics.width);
  job.model_height = static_cast<float>(model.intrinsics.height);
  for (int i = 0; i < 3; ++i) job.centre[i] = static_cast<float>(centre_F(i));
  job.gate_d2 = gates.distance_m * gates.distance_m;
  job.gate_cos = gates.normal_cos;
  job.noise = gates.noise;
  job.map_error_m = gates.map_error_m;
  return job;
}

void accumulate(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                rt::ForkJoin& crew) noexcept {
  accumulate_rows(live, model, X_FC, centre_F, gates, out, nullptr, crew);
}

void accumulate_cross(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                      const Vec3& centre_F, const Gates& gates, NormalEquations& out,
                      CrossMoment& cross, rt::ForkJoin& crew) noexcept {
  accumulate_rows(live, model, X_FC, centre_F, gates, out, &cross, crew);
}

}  // namespace perception
