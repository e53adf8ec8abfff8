// Smooths the field round the hand: each node moves to the surface that its neighbourhood agrees
// on.
//
// A node of the map is the mean of what its own pixels said: whole millimetres, pixels of a slanted
// face one after the other, and noise. The neighbouring nodes saw other pixels. So each node near
// the hand and near the surface takes the value of a surface of second order through the nodes
// round it (moving least squares, Levin 1998; Alexa et al. 2003):
//
//   d(o) = a + g.o + q (n.o)^2 + k (c1 t1^2 + c2 t1 t2 + c3 t2^2),   n = g / |g|, t1, t2 across it
//
//   o        a neighbour's offset, voxels, |o| < radius, within 1.25 voxels of the surface; weight (1 - |o|^2 / R^2)^2
//   q        a projective distance is not linear across a slanted face: - z h / (1 + h / c), c =
//            the camera's distance
//   k        curvature counts as far as it exceeds its own standard error: max(0, 1 - 2 / F)
//   residual kNoise voxels of RMS are noise and are taken out, kShape are shape and stay as they
//   are; between them,
//            smoothly less. At a crease, a rim, a thin wall nothing changes by a bit.
//
// The new value of a node depends on the map alone. How much of it is used fades out from .65 reach
// to reach voxels of the hand. Units: voxels, fractions of the truncation as in SurfacePatch. No
// allocation, no lock. Cost: nodes within reach of the hand whose cells the surface passes through,
// some 180 neighbours each; none where there is no surface.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct SmoothOptions {
  double radius = 5;   // voxels, 2 to 8
  double reach = 4.5;  // voxels from the hand, 2 to 8
};

struct SmoothStats {
  std::int32_t nodes = 0;    // near hand and surface, that their neighbours say something of
  std::int32_t changed = 0;  // of them
};

class PatchSmoother {
 public:
  PatchSmoother(rt::NonRealtime&, const SmoothOptions& options);

  // Changes distance and free bits of observed nodes. A malformed patch (nodes, voxel_size) stays
  // as it is.
  SmoothStats smooth(const Vec3& hand_W, SurfacePatch& patch) noexcept;
  // The new value of a node without fading, in units of the patch; 0 for an unobserved node.
  [[nodiscard]] float node(const SurfacePatch& patch, int ix, int iy, int iz) noexcept;

 private:
  struct Offset {
    Eigen::Vector3f at;
    float weight;
    std::int32_t step;  // in field_
  };
  struct Change {
    std::size_t at;
    std::int16_t distance;
  };
  struct Fit;
  // The nodes about `first` as one block, in voxels; NaN: not observed, cut off, or outside the
  // patch.
  void take(const SurfacePatch& patch, const std::array<int, 3>& first, int edge) noexcept;
  [[nodiscard]] float smoothed(std::ptrdiff_t at) const noexcept;
  [[nodiscard]] bool gradient(std::ptrdiff_t at, Eigen::Vector3f& g) const noexcept;

  SmoothOptions options_;
  int margin_ = 0;  // nodes about one that it needs
  int edge_ = 0;    // of field_
  std::vector<Offset> offsets_;
  std::vector<float> field_;
  std::vector<Change> changes_;
};

}  // namespace perception
