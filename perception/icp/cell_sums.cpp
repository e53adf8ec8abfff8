#include "perception/icp/cell_sums.hpp"

#include <algorithm>

#include "perception/icp/rows_job.hpp"

namespace perception {

namespace {

constexpr int kEdge = CellSums::kEdge;
static_assert(icp::kSquare == kEdge);  // a cell is a square of the kernels, which take two
constexpr int kTogether = icp::kLanes / icp::kSquare;

void put(const float (&sums)[icp::kSums], std::size_t c, CellSums& out) noexcept {
  for (std::size_t i = 0; i < 21; ++i) out.H[i][c] = sums[i];
  for (std::size_t i = 0; i < 6; ++i) out.g[i][c] = sums[21 + i];
  out.r2[c] = sums[27];
  out.pairs[c] = sums[28];
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
                      const Vec3& centre_F, const Gates& gates, CellSums& out, int rows,
                      bool recount) noexcept {
  const int width = live.depth.width(), height = live.depth.height();
  out.columns = (width + kEdge - 1) / kEdge;
  out.rows = (height + kEdge - 1) / kEdge;
  const icp::RowsJob whole = make_rows_job(live, model, X_FC, centre_F, gates);
  const icp::Kernels& kernels = icp::kernels();
  icp::SquareSums sums;
  for (int row = 0; row < out.rows; ++row) {
    for (int column = 0; column < out.columns; column += kTogether) {
      icp::RowsJob job = whole;
      const int u = column * kEdge, v = row * kEdge;
      const std::ptrdiff_t at = v * job.stride + u;
      job.z += at, job.nx += at, job.ny += at, job.nz += at;
      job.x_factor += u;
      job.y_factor += v;
      job.width = std::min(kTogether * kEdge, width - u);
      const int all = std::min(kEdge, height - v);
      job.rows = std::min(rows, all);
      kernels.accumulate_squares(job, static_cast<float>(all) / static_cast<float>(job.rows), sums);
      for (int k = 0; k < std::min(kTogether, out.columns - column); ++k)
        put(sums[k], static_cast<std::size_t>(row * out.columns + column + k), out);
    }
  }
  if (recount) count_live(live, out);
}

}  // namespace perception
