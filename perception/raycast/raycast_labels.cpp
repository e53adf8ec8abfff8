// Labels of a cast view, and the outlines of what is labelled.
//
// In the cast a surface ends with the last cell whose eight nodes were observed: up to a voxel
// before the edge of a thing that was seen from one side only. A labelled surface is therefore
// continued in its own plane to its expected edge, over pixels that show nothing or a surface
// behind.
//
// Nodes near that plane determine the edge. A node observed on the plane: the surface is there. A
// node seen through, or observed well in front of another surface: it is not. Readings on a depth
// edge are not fused and carve nothing behind the nearer side, so nodes near an edge are unknown,
// equally far to both sides: the edge runs where both kinds of nodes have the same weight. A cubic
// B-spline sums the nodes (de Boor 1978); over four nodes in each direction the steps of the grid
// average out.
#include <algorithm>
#include <cmath>

#include "perception/raycast/raycast.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"

namespace perception {
namespace {

constexpr std::uint8_t kContinued = 0x80;  // beside a label, while outlines are looked for
// Voxels.
constexpr float kBesidePlane = 1.0F;   // a node so near to the plane says something of it
constexpr float kAgrees = 0.5F;        // of the stored distance with that to the plane
constexpr float kBehind = 0.5F;        // what a continued surface covers lies so far behind
constexpr float kFarAlong = 2.5F;      // from where it is continued, along the optical axis
constexpr float kLeastFacing = 0.15F;  // cosine between ray and normal
constexpr float kInFront = 0.5F;       // truncations: a node so far in front has been seen through
constexpr float kLeastShare = 0.1F;    // of nodes on the plane
constexpr int kMostReach_px = 16;

// Of nodes -1, 0, 1, 2 at a point f beyond node 0.
void spline_shares(float f, float (&out)[4]) noexcept {
  const float r = 1 - f;
  out[0] = r * r * r / 6;
  out[1] = 2.0F / 3 - 0.5F * f * f * (2 - f);
  out[2] = 2.0F / 3 - 0.5F * r * r * (2 - r);
  out[3] = f * f * f / 6;
}

class Edge {
 public:
  explicit Edge(const MapView& map) noexcept
      : map_(map),
        reader_(map),
        inverse_voxel_(1.0 / map.voxel_size()),
        voxels_per_unit_(map.metres_per_unit() / static_cast<float>(map.voxel_size())) {}

  // Does the surface of the object reach to this point of its plane, seen along a ray with this
  // cosine to its normal? (Distances are stored along the ray.)
  [[nodiscard]] bool holds(const Vec3& p_W, const Vec3& normal_W, float cosine,
                           std::uint8_t id) noexcept {
    const Vec3 g = p_W * inverse_voxel_;
    const int i = ifloor(g.x()), j = ifloor(g.y()), k = ifloor(g.z());
    const Vec3f at = (g - Vec3(i, j, k)).cast<float>(), normal = normal_W.cast<float>();
    float share_x[4], share_y[4], share_z[4];
    spline_shares(at.x(), share_x);
    spline_shares(at.y(), share_y);
    spline_shares(at.z(), share_z);
    float there = 0, not_there = 0;
    for (int x = -1; x <= 2; ++x)
      for (int y = -1; y <= 2; ++y)
        for (int z = -1; z <= 2; ++z) {
          const Vec3f off(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
          const float height = normal.dot(off - at);
          if (std::fabs(height) > kBesidePlane) continue;
          const float share = share_x[x + 1] * share_y[y + 1] * share_z[z + 1];
          const std::uint32_t word = reader_.word(i + x, j + y, k + z);
          if (!reader_.known(word)) {
            if (map_.free_at(i + x, j + y, k + z)) not_there += share;
            continue;
          }
          const auto stored = static_cast<float>(MapLayout::word_distance(word));
          const float distance = stored * voxels_per_unit_ * cosine;
          if (stored > kInFront * MapLayout::kDistanceOne || distance > height + kAgrees)
            not_there += share;
          else if (distance >= height - kAgrees)
            there += share;
        }
    if (there < kLeastShare || there < not_there) return false;
    const LabelVoxel said = reader_.voted(p_W);
    return said.weight == 0 || said.label == id;
  }

 private:
  MapView map_;
  MapReader reader_;
  double inverse_voxel_;
  float voxels_per_unit_;
};

}  // namespace

void RaycastMaps::find_labels(const MapView& map) noexcept {
  const bool any = map.label_block_count() > 0;
  MapReader reader(map);
  std::size_t i = 0;
  for (int v = 0; v < intrinsics.height; ++v)
    for (int u = 0; u < intrinsics.width; ++u, ++i)
      labels_[i] =
          any && hit(u, v) ? reader.label(X_WC * vertex_C(u, v).cast<double>()) : std::uint8_t{0};
  if (any) continue_outlines(map);
}

void RaycastMaps::continue_outlines(const MapView& map) noexcept {
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
      const Vec3 normal_W = X_WC.linear() * normal.cast<double>();
      for (int b = std::max(0, v - reach); b <= std::min(h - 1, v + reach); ++b)
        for (int a = std::max(0, u - reach); a <= std::min(w - 1, u + reach); ++a) {
          if (label(a, b) != 0) continue;
          const Vec3f ray(static_cast<float>((a - intrinsics.cx) / intrinsics.fx),
                          static_cast<float>((b - intrinsics.cy) / intrinsics.fy), 1);
          const float facing = -normal.dot(ray), cosine = facing / ray.norm();
          if (cosine < kLeastFacing) continue;
          const float z = -plane / facing;
          if (!(std::fabs(z - vertex.z()) < kFarAlong * voxel)) continue;
          if (hit(a, b) && at(a, b)[3] < z + kBehind * voxel) continue;
          if (!edge.holds(X_WC * (ray * z).cast<double>(), normal_W, cosine, id)) continue;
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
