// Aligns two thumbnails: their depths as point clouds.
//
// Projective point-to-plane ICP (as perception/icp, Newcombe et al. 2011) of the seen cells against
// the kept ones, at most 832 points, starting from the shift of the images. It gives the camera's
// pose relative to the keyframe, to a few centimetres, before anything is cast. It also tells
// whether the keyframe's place is possible: points of either view in space that the other has seen
// through contradict it. The result is only a guess and a ranking, since cells are 2 degrees wide
// and depths are coded to 1.2 %.
//
// Frames: S camera of the view seen, K camera of the one kept; metres. No allocation.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/camera_model.hpp"
#include "perception/relocalisation/keyframes.hpp"

namespace perception {

// For the 3 x 3 cells round each inner cell: the number of known depths, the least (infinity: none)
// and the largest (0: none).
struct CellSpans {
  std::array<float, Thumbnail::kCells> nearest, farthest;
  std::array<std::int32_t, Thumbnail::kCells> known;
};
// A frame by its cells, in the camera.
struct CellView {
  std::array<Vec3f, Thumbnail::kCells> point;  // (0, 0, 0) where there is none
  CellSpans about;
  // Every second cell in a chequered pattern, of these the ones that have a point and a normal.
  static constexpr int kMost = Thumbnail::kCells / 2;
  struct Lanes {
    std::array<float, kMost> x, y, z;
  };
  Lanes at, normal;
  int count = 0;
};
// Of the coarsest level, at the pixels that make_thumbnail() reads.
void fill_cell_view(const DepthLevel& depth, CellView& out) noexcept;

struct ThumbnailFit {
  Pose X_KS = Pose::Identity();
  double overlap = 0;  // seen cells that fall on kept ones / seen cells
  double close = 0;    // of those, the share that lies on the kept surface
  double against = 0;  // of the cells of both views that meet, the share in the other's free space
  // What fits less what can not, of all that is seen.
  [[nodiscard]] double score() const noexcept { return overlap * (close - 2 * against); }
};

class ThumbnailAligner {
 public:
  static constexpr int kIterations = 8;
  // `camera`: of full-size images; both views are its.
  explicit ThumbnailAligner(const Intrinsics& camera) noexcept;
  // From X_KS0 on.
  [[nodiscard]] ThumbnailFit align(const CellView& seen, const Thumbnail& kept,
                                   const Pose& X_KS0) const noexcept;

 private:
  struct Kept;  // points of the kept view
  struct Pairs;
  struct Moved;  // of the cells seen, as the kept view would see them
  [[nodiscard]] bool cell_of(const Vec3f& p, int& i, int& j) const noexcept;
  void move(const CellView& seen, const Pose& X_KS, Moved& out) const noexcept;
  void refine(const CellView& seen, const Kept& kept, float gate_m, Pose& X_KS) const noexcept;
  [[nodiscard]] ThumbnailFit judge(const CellView& seen, const Kept& kept,
                                   const Pose& X_KS) const noexcept;
  Intrinsics cells_;  // a pixel a cell
  std::array<float, Thumbnail::kWidth> ray_x_{};
  std::array<float, Thumbnail::kHeight> ray_y_{};
  std::array<float, 256> depth_m_{};  // of a code
};

}  // namespace perception
