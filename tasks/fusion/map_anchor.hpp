// Keeps the map where it is.
//
// The map follows the camera that is tracked by it: each image is fused at the pose that it was
// given, so an error of the pose that stays the same (a ray cast of voxels is not, to 0.1 mm, what
// the filtered image of the same surface is) moves the map by a share of itself a frame, and with
// the map the next pose. Tracking can not see that: camera and map move together. The map's nodes
// can: what is settled should stay.
//
// Some thousand settled nodes beside the surface are remembered as they are. How they differ from
// that later, taken together as the motion of a rigid surface (point to plane, weighed as tracking
// weighs), is how far the map has moved since. Poses are moved back by kGain times that: a lasting
// error b of the poses then moves the map by b / kGain, and not by b for every max_weight frames. A
// node that has changed by more than noise does not count: the scene has.
//
// This is for a camera that rests (within 2 cm and 1 degree for a second). One that moves sees the
// same nodes from elsewhere and changes them by what it learns there; holding it made its poses a
// little worse (docs/fusion.md).
#pragma once

#include <cstdint>
#include <vector>

#include "perception/icp/kernels.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/blocks/map_view.hpp"
#include "rt/memory/non_realtime.hpp"

namespace tasks {

class MapAnchor {
 public:
  using Twist = Eigen::Matrix<double, 6, 1>;  // (v, w) in W about a centre

  explicit MapAnchor(rt::NonRealtime&);

  // The nodes are no longer what they were: another map, or another place.
  void forget() noexcept;
  // The same camera pose with the map's motion taken back; moved by kMost_m at most.
  [[nodiscard]] perception::Pose held(const perception::Pose& X_WC) const noexcept;
  // After an image was fused, taken at X_WC, and `model` was cast. length_m: mean depth.
  void update(const perception::MapView& map, const perception::RaycastMaps& model,
              const perception::icp::NoiseRule& noise, const perception::Pose& X_WC,
              double length_m) noexcept;

  // Of the nodes remembered, since then, about centre_W().
  [[nodiscard]] const Twist& moved() const noexcept { return moved_; }
  [[nodiscard]] const perception::Vec3& centre_W() const noexcept { return centre_W_; }
  [[nodiscard]] int nodes() const noexcept { return static_cast<int>(nodes_.size()); }

 private:
  struct Node {
    std::int32_t block, voxel;
    perception::BlockCoord at;
    std::uint32_t word;
    float row[6];  // of a unit twist about the centre: how much nearer the surface comes
    float across;  // that, for one unit of distance along the ray
    float most_m;  // a larger change is none of a surface that stays
    float weight;
  };
  void remember(const perception::MapView& map, const perception::RaycastMaps& model,
                const perception::icp::NoiseRule& noise) noexcept;
  void take(const perception::MapView& map, const perception::Vec3& hit_W,
            const perception::Vec3& n_W, Node node) noexcept;
  void compare(const perception::MapView& map) noexcept;

  std::vector<Node> nodes_;
  Twist moved_ = Twist::Zero();
  perception::Vec3 centre_W_ = perception::Vec3::Zero();
  perception::Pose X_WC_ = perception::Pose::Identity();  // from where it rests
  int rested_ = 0;                                        // frames, while there are no nodes
  double length_m_ = 0;
};

}  // namespace tasks
