#include "perception/icp/cell_sums.hpp"

#include <algorithm>

#include "perception/icp/rows_job.hpp"

namespace perception {

namespace {

constexpr int kEdge = CellSums::kEdge;
static_assert(icp::kLanes == 2 * kEdge);  // a vector's lanes are two cells

// Both halves of the lanes: the cells at `cell` and beside it.
void split(const icp::LaneSums& lanes, int halves, std::size_t cell, double factor,
           CellSums& out) noexcept {
  const auto half_sum = [&](const double* lane, int half) {
    double s = 0;
    for (int k = 0; k < kEdge; ++k) s += lane[half * kEdge + k];
    return static_cast<float>(factor * s);
  };
  for (int h = 0; h < halves; ++h) {
    const std::size_t c = cell + static_cast<std::size_t>(h);
    for (std::size_t i = 0; i < 21; ++i) out.H[i][c] = half_sum(lanes.sums[i], h);
    for (std::size_t i = 0; i < 6; ++i) out.g[i][c] = half_sum(lanes.sums[21 + i], h);
    out.r2[c] = half_sum(lanes.sums[27], h);
    out.pairs[c] = half_sum(lanes.sums[28], h);
  }
}

void count_live(const DepthLevel& live, CellSums& out) noexcept {
  out.live.fill(0);
  out.depth_m.fill(0);
  for (int v = 0; v < live.depth.height(); ++v) {
    const float* z = live.depth.row(v);
    const auto at = static_cast<std::size_t>(v / kEdge * out.columns);
    for (int c = 0; c < out.columns; ++c) {  // readable beyond the row, where depth is 0
      float n = 0, sum = 0;
      for (int u = 0; u < kEdge; ++u) {
        const float d = z[c * kEdge + u];
        n += d > 0 ? 1.0F : 0.0F;
        sum += d;
      }
      out.live[at + static_cast<std::size_t>(c)] += n;
      out.depth_m[at + static_cast<std::size_t>(c)] += sum;
    }
  }
  for (std::size_t c = 0; c < static_cast<std::size_t>(out.size()); ++c)
    if (out.live[c] > 0) out.depth_m[c] /= out.live[c];
}

}  // namespace

void accumulate_cells(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                      const Vec3& centre_F, const Gates& gates, CellSums& out, int rows) noexcept {
  const int width = live.depth.width(), height = live.depth.height();
  out.columns = (width + kEdge - 1) / kEdge;
  out.rows = (height + kEdge - 1) / kEdge;
  const icp::RowsJob whole = make_rows_job(live, model, X_FC, centre_F, gates);
  for (int row = 0; row < out.rows; ++row) {
    for (int column = 0; column < out.columns; column += 2) {
      icp::RowsJob job = whole;
      const int u = column * kEdge, v = row * kEdge;
      const std::ptrdiff_t at = v * job.stride + u;
      job.z += at, job.nx += at, job.ny += at, job.nz += at;
      job.x_factor += u;
      job.y_factor += v;
      job.width = std::min(2 * kEdge, width - u);
      const int all = std::min(kEdge, height - v);
      job.rows = std::min(rows, all);
      icp::LaneSums lanes;
      icp::kernels().accumulate(job, false, lanes);
      split(lanes, std::min(2, out.columns - column),
            static_cast<std::size_t>(row * out.columns + column),
            static_cast<double>(all) / job.rows, out);
    }
  }
  count_live(live, out);
}

}  // namespace perception
