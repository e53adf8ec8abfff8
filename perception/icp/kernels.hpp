// The hot leaf loops of tracking, compiled twice from kernels.inl: for the baseline instruction set and
// for x86-64-v3 (AVX2). Both work on 8 lanes in the same order without contraction, so they give the
// same bytes; tests compare them.
#pragma once

#include <cstddef>
#include <cstdint>

namespace perception::icp {

inline constexpr int kLanes = 8;
inline constexpr int kSums = 29;   // 21 of H (upper triangle by rows), 6 of g, r2, weight
inline constexpr int kCross = 21;  // upper triangle by rows

// One row of a level against the model. All pointers may be unaligned; rows are readable up to the
// next multiple of 8 pixels, where depth is 0.
struct RowJob {
  const float *z, *nx, *ny, *nz;  // live depth and normals
  const float* x_factor;
  float y_factor;
  int width;
  float R_F[9], t_F[3];  // live camera -> camera that cast the model, row-major
  float fx, fy, cx, cy;
  const float* model;
  float model_width, model_height;
  float centre[3];  // in F
  float gate_d2, gate_cos, range_weight2;
};

struct RowSums {
  alignas(32) float sums[kSums][kLanes];
  alignas(32) float cross[kCross][kLanes];
  std::int32_t inliers, met, live;
};

// Depth step that separates two surfaces at depth z: noise(z) = base + per_m2 z^2 for what should be
// flat, step(z) = noise(z) + per_m z for neighbours on a slope.
struct EdgeRule {
  float base, per_m, per_m2;
};

struct Kernels {
  const char* name;
  void (*accumulate_row)(const RowJob&, RowSums&) noexcept;
  void (*accumulate_row_cross)(const RowJob&, RowSums&) noexcept;
  // out[u] of one row; `in` points at pixel 0 of the row, `stride` floats between rows.
  void (*bilateral_row)(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                        int radius, const EdgeRule& rule, float* out) noexcept;
  void (*normal_row)(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                     const float* y_factor, const EdgeRule& rule, float* nx, float* ny,
                     float* nz) noexcept;
  void (*to_metres_row)(const std::uint16_t* mm, int width, float min_m, float max_m,
                        float* out) noexcept;
  void (*half_row)(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule,
                   float* out) noexcept;
};

extern const Kernels kBaseKernels;
extern const Kernels kV3Kernels;
// The best one this machine can run; fixed for the life of the process.
[[nodiscard]] const Kernels& kernels() noexcept;
[[nodiscard]] bool cpu_has_v3() noexcept;

}  // namespace perception::icp
