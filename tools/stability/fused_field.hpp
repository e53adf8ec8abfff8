// A field as the product fuses it: synthetic depth of a solid, seen from one side, integrated into a
// TsdfMap with known poses. Depth by sphere tracing on the solid's distance; nothing of the map's own
// ray cast is used.
#pragma once

#include <functional>
#include <memory>

#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"

namespace stability {

struct FusedView {
  double incidence_deg = 0;  // of the camera's axis on the floor (+z of S)
  perception::Vec3 lean_S = perception::Vec3::UnitX();  // the camera leans from +z to this side
  bool noise = false;                                   // axial, as of a Kinect v2
  int frames = 20;
};

class FusedField {
 public:
  using Solid = std::function<double(const perception::Vec3& p_S)>;

  // Looks at the origin of S from 1 m, a Kinect v2's lens, small known motions between the frames.
  FusedField(const perception::Pose& X_WS, const FusedView& view);
  // One more frame of the solid as it is now.
  void see(const Solid& solid);
  void window(const perception::Vec3& centre_W, int nodes, perception::SurfacePatch& out) const;
  // As the oracle reads it: observed distance; seen free without one: at most a voxel more than its
  // least neighbour that has one, and outside; unknown: solid.
  [[nodiscard]] double node(int x, int y, int z) const;
  // Observed or seen free.
  [[nodiscard]] bool known(int x, int y, int z) const;
  // Where the field crosses zero over (0, 0) of S, between z = -50 and 50 mm.
  [[nodiscard]] double height() const;

 private:
  rt::Startup startup_;
  perception::Pose X_WS_;
  FusedView view_;
  perception::TsdfMap map_;
  int frame_ = 0;
};

}  // namespace stability
