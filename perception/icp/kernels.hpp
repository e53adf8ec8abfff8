// The innermost loops of tracking, in two forms: vector code of any width (kernels.cpp and
// accumulate.cpp, by Highway, chosen at run time), and plain loops as the tests' reference
// (kernels_scalar.cpp). A sum has 16 lanes, pixel u goes to lane u mod 16, and no operations are
// contracted, so all forms give the same bytes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace perception::icp {

inline constexpr int kLanes = 16;
inline constexpr int kSums = 29;   // 21 of H (upper triangle by rows), 6 of g, r2, weight
inline constexpr int kCross = 21;  // upper triangle by rows
inline constexpr int kSquare = 8;  // pixels, edge of a square that has sums of its own

// A point counts as on the surface if its distance is below this many sigmas of its reading plus
// the surface's own error.
inline constexpr float kOnSurfaceSigmas = 3;

// Stated error of a reading at depth z: sigma(z) = least_m + per_m2 max(z - from_m, 0)^2. It covers
// noise and the remaining systematic error. A residual has the weight (least_m / sigma)^2.
struct NoiseRule {
  float least_m, per_m2, from_m;
};

// Some rows of a level against the model. Rows are readable up to the next multiple of 16 pixels,
// where depth is 0.
struct RowsJob {
  const float *z, *nx, *ny, *nz;  // live depth and normals, pixel 0 of the first row
  std::ptrdiff_t stride;          // floats from row to row, of all four
  const float* x_factor;
  const float* y_factor;  // one a row
  int width, rows;
  float R_F[9], t_F[3];  // live camera -> camera that cast the model, row-major
  float fx, fy, cx, cy, inv_fx, inv_fy;
  const float* model;  // nx, ny, nz, depth a pixel
  float model_width, model_height;
  float centre[3];  // in F
  float gate_d2, gate_cos;
  NoiseRule noise;
  float map_error_m;  // of the model's surface
};

// fp32 within a row, fp64 over rows.
struct LaneSums {
  alignas(64) double sums[kSums][kLanes] = {};
  alignas(64) double cross[kCross][kLanes] = {};
  std::int64_t inliers = 0, met = 0, live = 0;
  std::int64_t on_surface = 0;  // with the cross moment only
};

// Of two squares side by side.
using SquareSums = float[kLanes / kSquare][kSums];

// Depth step that separates two surfaces at depth z: noise(z) = base + per_m2 z^2 for what should
// be flat, step(z) = noise(z) + per_m z for neighbours on a slope.
struct EdgeRule {
  float base, per_m, per_m2;
};

struct Kernels {
  // Adds to the sums; with `cross` also to the cross moment.
  void (*accumulate)(const RowsJob&, bool cross, LaneSums&);
  // The sums of the two squares at pixel 0 (the first alone if the job is no wider), at most
  // kSquare rows. All in fp32: rows of a column upwards, then the columns as
  // ((0 + 1) + (2 + 3)) + ((4 + 5) + (6 + 7)); times `factor`.
  void (*accumulate_squares)(const RowsJob&, float factor, SquareSums&);
  // out[u] of one row; `in` points at pixel 0 of the row, `stride` floats between rows. What is
  // readable beyond the row, up to a multiple of 16, is 0; so is what gets written there.
  void (*bilateral_row)(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                        int radius, const EdgeRule& rule, float* out);
  void (*normal_row)(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                     const float* y_factor, const EdgeRule& rule, float* nx, float* ny, float* nz);
  // These two read and write no more than the row.
  void (*to_metres_row)(const std::uint16_t* mm, int width, float min_m, float max_m, float* out);
  void (*half_row)(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule,
                   float* out);
};

extern const Kernels kScalarKernels;
// Kernels::accumulate for vectors (accumulate.cpp).
void accumulate_vectors(const RowsJob& job, bool cross, LaneSums& out);
void accumulate_squares_vectors(const RowsJob& job, float factor, SquareSums& out);
// Those of simd::chosen().
[[nodiscard]] const Kernels& kernels() noexcept;

}  // namespace perception::icp
