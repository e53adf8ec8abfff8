#include "perception/tsdf/blocks/update_camera.hpp"

#include <array>

#include "perception/simd/isa.hpp"

namespace perception {

UpdateCamera update_camera(const MapStore& store, const DepthPyramid& pyramid, const Intrinsics& k,
                           const Pose& X_CW) noexcept {
  UpdateCamera cam{};
  cam.fx = static_cast<float>(k.fx), cam.fy = static_cast<float>(k.fy);
  cam.cx_plus_half = static_cast<float>(k.cx + 0.5),
  cam.cy_plus_half = static_cast<float>(k.cy + 0.5);
  cam.width = k.width, cam.height = k.height;
  cam.pixels = pyramid.pixels();
  cam.gather = simd::gathers();
  cam.truncation_m = static_cast<float>(store.truncation);
  cam.units_per_m = static_cast<float>(MapLayout::kDistanceOne / store.truncation);
  cam.weight_cap = static_cast<std::int32_t>(store.config.max_weight * MapLayout::kWeightOne);
  cam.colour_band_m = -1.0F;
  const Mat3 step = X_CW.linear() * store.voxel;
  const auto along = [&step](int axis) {
    return std::array{static_cast<float>(step(0, axis)), static_cast<float>(step(1, axis)),
                      static_cast<float>(step(2, axis))};
  };
  cam.place_nodes(along(0), along(1), along(2));
  return cam;
}

}  // namespace perception
