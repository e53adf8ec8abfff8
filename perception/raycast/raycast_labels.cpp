// Labels of a cast view, and the outlines of what is labelled.
//
// A surface ends in the cast with the last cell whose eight nodes were observed, up to a voxel before the
// edge of a thing that was seen from one side only. Where that surface is labelled it is continued in its
// own plane, over pixels that show nothing or what lies behind, to where its edge is to be expected. The last
// observed node lies up to a voxel within the edge, and one pixel more, since readings beside a depth edge
// are not fused: on average half a voxel and a pixel.
#include <algorithm>
#include <cmath>

#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/map_reader.hpp"

namespace perception {
namespace {

constexpr std::uint8_t kContinued = 0x80;  // beside a label, while outlines are looked for
constexpr float kAtSurface = 1.8F;         // voxels: a node of a cell that the surface passes
constexpr float kOnPlane = 0.5F;       // voxels: of the point to the surface that is stored there
constexpr float kBehind = 0.5F;        // voxels: what a continued surface covers lies so far behind
constexpr float kLeastFacing = 0.15F;  // cosine between ray and normal
constexpr float kLeastShare = 0.1F;
constexpr int kMostReach_px = 16;

class Edge {
 public:
  explicit Edge(const TsdfMap& map) noexcept
      : reader_(map),
        inverse_voxel_(1.0 / map.voxel_size()),
        units_per_voxel_(static_cast<float>(map.voxel_size()) / map.metres_per_unit()) {}

  // Does the surface of the object reach to this point of its continuation, pixel_m from the next one?
  [[nodiscard]] bool holds(const Vec3& p_W, std::uint8_t id, float pixel_m) noexcept {
    // Share of the cell's nodes, by their nearness, that lie at the surface where its edge is expected.
    const float edge = std::max(kLeastShare, 0.5F - pixel_m * static_cast<float>(inverse_voxel_));
    const Vec3 g = p_W * inverse_voxel_;
    const int i = ifloor(g.x()), j = ifloor(g.y()), k = ifloor(g.z());
    const auto fx = static_cast<float>(g.x() - i), fy = static_cast<float>(g.y() - j),
               fz = static_cast<float>(g.z() - k);
    float at_surface = 0, distance = 0;
    int count = 0;
    for (int n = 0; n < 8; ++n) {
      const std::uint32_t word = reader_.word(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1));
      const auto d = static_cast<float>(TsdfMap::word_distance(word));
      if (!reader_.known(word) || std::fabs(d) > kAtSurface * units_per_voxel_) continue;
      const float share = ((n & 4) != 0 ? fx : 1 - fx) * ((n & 2) != 0 ? fy : 1 - fy) *
                          ((n & 1) != 0 ? fz : 1 - fz);
      at_surface += share;
      distance += share * d;
      ++count;
    }
    // All of them: the cast itself has seen what there is.
    if (count == 8 || at_surface < edge) return false;
    if (std::fabs(distance) > kOnPlane * units_per_voxel_ * at_surface) return false;
    return reader_.label(p_W) == id;
  }

 private:
  MapReader reader_;
  double inverse_voxel_;
  float units_per_voxel_;
};

}  // namespace

void RaycastMaps::find_labels(const TsdfMap& map) noexcept {
  const bool any = map.label_block_count() > 0;
  MapReader reader(map);
  std::size_t i = 0;
  for (int v = 0; v < intrinsics.height; ++v)
    for (int u = 0; u < intrinsics.width; ++u, ++i)
      labels_[i] =
          any && hit(u, v) ? reader.label(X_WC * vertex_C(u, v).cast<double>()) : std::uint8_t{0};
  if (any) continue_outlines(map);
}

void RaycastMaps::continue_outlines(const TsdfMap& map) noexcept {
  const int w = intrinsics.width, h = intrinsics.height;
  const auto voxel = static_cast<float>(map.voxel_size());
  const auto fx = static_cast<float>(intrinsics.fx);
  Edge edge(map);
  const auto label = [&](int u, int v) -> std::uint8_t& {
    return labels_[static_cast<std::size_t>(v) * static_cast<std::size_t>(w) +
                   static_cast<std::size_t>(u)];
  };
  const auto ends_at = [&](int u, int v, std::uint8_t id) {
    return (u > 0 && label(u - 1, v) != id) || (u + 1 < w && label(u + 1, v) != id) ||
           (v > 0 && label(u, v - 1) != id) || (v + 1 < h && label(u, v + 1) != id);
  };
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const std::uint8_t id = label(u, v);
      if (id == 0 || (id & kContinued) != 0 || !ends_at(u, v, id)) continue;
      const Vec3f vertex = vertex_C(u, v), normal = normal_C(u, v);
      const int reach = std::min(kMostReach_px, static_cast<int>(voxel * fx / vertex.z()) + 1);
      const float plane = normal.dot(vertex);
      for (int b = std::max(0, v - reach); b <= std::min(h - 1, v + reach); ++b)
        for (int a = std::max(0, u - reach); a <= std::min(w - 1, u + reach); ++a) {
          if (label(a, b) != 0) continue;
          const Vec3f ray(static_cast<float>((a - intrinsics.cx) / intrinsics.fx),
                          static_cast<float>((b - intrinsics.cy) / intrinsics.fy), 1);
          const float facing = -normal.dot(ray);
          if (facing < kLeastFacing * ray.norm()) continue;
          const float z = -plane / facing;
          if (!(std::fabs(z - vertex.z()) < 2 * voxel)) continue;
          if (hit(a, b) && at(a, b)[3] < z + kBehind * voxel) continue;
          if (!edge.holds(X_WC * (ray * z).cast<double>(), id, z / fx)) continue;
          label(a, b) = static_cast<std::uint8_t>(id | kContinued);
          float* record = records_ + kStride * (static_cast<std::ptrdiff_t>(b) * w + a);
          for (int c = 0; c < 3; ++c) record[c] = normal[c];
          record[3] = z;
        }
    }
  for (std::size_t i = 0; i < static_cast<std::size_t>(w) * static_cast<std::size_t>(h); ++i)
    labels_[i] &= static_cast<std::uint8_t>(~kContinued);
}

}  // namespace perception
