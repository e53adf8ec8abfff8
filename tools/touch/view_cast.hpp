// A full ray cast of a dense field from a pinhole camera: the surface points of the method
// force_shading where there is no fusion to make them.
#pragma once

#include <limits>
#include <optional>

#include "perception/geometry/pose.hpp"
#include "tasks/haptic/force_shading.hpp"
#include "tools/touch/field_window.hpp"

namespace teletact {

struct View {
  perception::Vec3 eye = perception::Vec3::Zero(), look = perception::Vec3::UnitZ();  // W, m
  int width = 512, height = 424;
  double f = 365;  // px
};

// Trilinear value at p (grid frame: node (0,0,0) at the origin), NaN where a node is unknown.
[[nodiscard]] double field_value(const DenseField& field, double voxel_size,
                                 const perception::Vec3& p);

// One ray a pixel, from the eye, first crossing from + to -; normals from differences one voxel to
// either side. View in the grid frame. Returns the number of pixels that met a surface.
std::size_t cast_view(const DenseField& field, double voxel_size, const View& view,
                      tasks::SurfacePoints& out);

// Finds where hand and field first come into contact: from outside or from unknown space to inside,
// by the hand's motion or by the field that is visible then. Call it tick by tick.
class FirstContact {
 public:
  // 1 m off that place, along the outward normal, looking at it; empty before and after it.
  [[nodiscard]] std::optional<View> at(const DenseField& field, double voxel_size,
                                       const perception::Vec3& p);

 private:
  double before_ = std::numeric_limits<double>::quiet_NaN();
  bool met_ = false;
};

}  // namespace teletact
