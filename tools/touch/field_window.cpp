#include "tools/touch/field_window.hpp"

#include <algorithm>
#include <cmath>

namespace teletact {

rt::Result<DenseField> to_field(NpyArray array, const std::string& name) {
  if (array.shape.size() != 3) {
    return rt::Error{name + ": " + std::to_string(array.shape.size()) +
                     " dimensions; a field has 3 (x, y, z)"};
  }
  DenseField out;
  for (std::size_t a = 0; a < 3; ++a) {
    if (array.shape[a] < 2 || array.shape[a] > 4096) {
      return rt::Error{name + ": dimension " + std::to_string(a) + " has " +
                       std::to_string(array.shape[a]) + " nodes; allowed are 2 to 4096"};
    }
    out.size[a] = static_cast<int>(array.shape[a]);
  }
  for (std::size_t i = 0; i < array.values.size(); ++i) {
    if (std::isinf(array.values[i])) {
      return rt::Error{name + ": element " + std::to_string(i) +
                       " is infinite; allowed are finite numbers and NaN (unobserved)"};
    }
  }
  out.distance = std::move(array.values);
  return out;
}

void fill_window(const DenseField& field, const perception::Vec3& centre, double voxel_size,
                 double truncation, int nodes, perception::SurfacePatch& patch) {
  patch.voxel_size = voxel_size;
  patch.metres_per_unit = static_cast<float>(truncation / 32767.0);
  patch.nodes = nodes;
  for (std::size_t a = 0; a < 3; ++a) {
    const double middle = std::clamp(centre[static_cast<Eigen::Index>(a)] / voxel_size, -1e8, 1e8);
    patch.origin_node[a] = static_cast<std::int32_t>(std::lround(middle)) - nodes / 2;
  }
  const auto t = static_cast<float>(truncation);
  const float units = 32767.0F / t;
  for (int x = 0; x < nodes; ++x) {
    for (int y = 0; y < nodes; ++y) {
      for (int z = 0; z < nodes; ++z) {
        const std::size_t i = patch.index(x, y, z);
        const int gx = patch.origin_node[0] + x, gy = patch.origin_node[1] + y,
                  gz = patch.origin_node[2] + z;
        patch.distance[i] = 0;
        patch.material[i] = 0;
        patch.set_free(i, false);
        if (gx < 0 || gy < 0 || gz < 0 || gx >= field.size[0] || gy >= field.size[1] ||
            gz >= field.size[2]) {
          continue;
        }
        const auto row = static_cast<std::size_t>(gx) * static_cast<std::size_t>(field.size[1]) +
                         static_cast<std::size_t>(gy);
        const std::size_t node =
            row * static_cast<std::size_t>(field.size[2]) + static_cast<std::size_t>(gz);
        const float d = field.distance[node];
        if (std::isnan(d)) continue;
        patch.set_free(i, d > 0);
        if (d > t) continue;  // free: the field is + truncation here
        patch.material[i] =
            static_cast<std::uint8_t>(field.label.empty() ? 1 : field.label[node] + 1);
        patch.distance[i] = static_cast<std::int16_t>(std::lround(std::clamp(d, -t, t) * units));
      }
    }
  }
}

}  // namespace teletact
