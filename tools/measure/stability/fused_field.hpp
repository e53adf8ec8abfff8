// A field as the product fuses it: synthetic depth of a solid, seen from one side, integrated into
// a TsdfMap with known poses. Depth by sphere tracing on the solid's distance; nothing of the map's
// own ray cast is used. The solid is there within 0.15 m of the origin; round it a ball of 1 m
// about the origin is seen from inside, which never moves: a camera that sees nothing but what
// moves can not tell it from its own motion.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/patch/patch_smooth.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace stability {

struct FusedView {
  double incidence_deg = 0;  // of the camera's axis on the floor (+z of S)
  perception::Vec3 lean_S = perception::Vec3::UnitX();  // the camera leans from +z to this side
  // As the synthetic camera has it (drivers/camera/depth_noise.hpp): axial 1, lateral 0.3 px, half
  // of the edge pixels without a reading, 2 % of them between the two sides.
  bool noise = false;
  bool axial_alone = false;  // of that noise
  int frames = 20;
  double smooth = perception::SmoothOptions{}.radius;  // as fusion.patch_smooth; 0: none
};

class FusedField {
 public:
  using Solid = std::function<double(const perception::Vec3& p_S)>;

  // Looks at the origin of S from 1 m, a Kinect v2's lens, small known motions between the frames.
  FusedField(const perception::Pose& X_WS, const FusedView& view);
  // One more frame of the solid as it is now.
  void see(const Solid& solid);
  // As fusion publishes it for a hand at the centre.
  void window(const perception::Vec3& centre_W, int nodes, perception::SurfacePatch& out) const;
  // As the oracle reads it: observed distance; seen free without one: at most a voxel more than its
  // least neighbour that has one, and outside; unknown: solid.
  [[nodiscard]] double node(int x, int y, int z) const;
  // Observed or seen free.
  [[nodiscard]] bool known(int x, int y, int z) const;
  // Where the field crosses zero over (0, 0) of S, between z = -50 and 50 mm.
  [[nodiscard]] double height() const;

 private:
  // Of an observed node, in m.
  [[nodiscard]] double smoothed(int x, int y, int z) const;
  [[nodiscard]] double depth(const Solid& solid, const perception::Pose& X_SC,
                             const perception::Vec3& ray_C) const;
  static void disturb(std::vector<double>& z, int width, int height, rt::Random& random);

  rt::Startup startup_;
  perception::Pose X_WS_;
  FusedView view_;
  perception::TsdfMap map_;
  std::unique_ptr<perception::PatchSmoother> smoother_;  // null: none
  // All that node() asks for, of frame whole_of_.
  mutable std::unique_ptr<perception::SurfacePatch> whole_;
  mutable int whole_of_ = -1;
  int frame_ = 0;
};

}  // namespace stability
