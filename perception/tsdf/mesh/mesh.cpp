#include "perception/tsdf/mesh/mesh.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "perception/tsdf/mesh/mesh_cells.hpp"

namespace perception {
namespace {

class Mesher {
 public:
  Mesher(const MapView& map, const MeshOptions& o)
      : map_(map),
        cells_(map, o.min_weight, o.max_edge_jump, o.needs_readings && coloured(map)),
        reader_(cells_.reader()) {}

  Mesh run(rt::NonRealtime& nrt, const MeshOptions& o) {
    map_.for_each_block([&](std::int32_t block, BlockCoord b) {
      cells_.cut(block, b,
                 [&](int i, int j, int k, const MapReader::Cell& c, const marching_cubes::Case& m) {
                   add(i, j, k, c, m);
                 });
    });
    if (o.refined) refine_vertices(nrt, observed_, map_.voxel_size(), o.refine, mesh_);
    return std::move(mesh_);
  }

 private:
  void add(int i, int j, int k, const MapReader::Cell& c, const marching_cubes::Case& m) {
    for (std::size_t t = 0; t < m.triangles; ++t) {
      std::array<std::uint32_t, 3> tri{};
      for (std::size_t v = 0; v < 3; ++v) tri[v] = vertex(i, j, k, c, m.edge[t][v]);
      // Nodes exactly on the surface collapse a triangle to a line.
      if (tri[0] != tri[1] && tri[1] != tri[2] && tri[0] != tri[2]) mesh_.triangles.push_back(tri);
    }
  }

  static bool coloured(const MapView& map) {
    bool any = false;
    map.for_each_block(
        [&](std::int32_t block, BlockCoord) { any = any || MeshCells::coloured(map, block); });
    return any;
  }

  std::uint32_t vertex(int i, int j, int k, const MapReader::Cell& c, std::uint8_t edge) {
    const MeshCells::Crossing at = MeshCells::crossing(i, j, k, c, edge);
    constexpr std::uint64_t kMask = (1U << 20U) - 1U;  // wraps beyond 10 km of 1 cm voxels
    const std::uint64_t key = (static_cast<std::uint64_t>(at.x) & kMask) << 42U |
                              (static_cast<std::uint64_t>(at.y) & kMask) << 22U |
                              (static_cast<std::uint64_t>(at.z) & kMask) << 2U |
                              static_cast<std::uint64_t>(at.axis);
    const auto [it, added] =
        index_.try_emplace(key, static_cast<std::uint32_t>(mesh_.vertices_W.size()));
    if (!added) return it->second;
    const Vec3 p = at.position(map_.voxel_size());
    mesh_.vertices_W.push_back(p.cast<float>());
    observed_.push_back(observations(at.x, at.y, at.z, at.axis));
    Vec3 n;
    if (!reader_.gradient(p, n)) n = cell_gradient(c, marching_cubes::kEdges[edge], at.share);
    const double length = n.norm();
    mesh_.normals_W.push_back((length > 0 ? Vec3(n / length) : Vec3::UnitZ()).cast<float>());
    Rgb colour;
    if (!reader_.colour(p, colour)) colour = kNeutral;
    mesh_.colours.push_back(colour);
    return it->second;
  }

  // Of the lesser of the edge's two nodes.
  float observations(int x, int y, int z, int axis) {
    const auto weight = [&](int dx, int dy, int dz) {
      return MapLayout::word_weight(reader_.word(x + dx, y + dy, z + dz));
    };
    const auto least =
        std::min(weight(0, 0, 0), weight(axis == 0 ? 1 : 0, axis == 1 ? 1 : 0, axis == 2 ? 1 : 0));
    return static_cast<float>(least) / static_cast<float>(MapLayout::kWeightOne);
  }

  static Vec3 cell_gradient(MapReader::Cell c, marching_cubes::Edge e, float at) {
    float f[3] = {static_cast<float>(e.corner >> 2), static_cast<float>((e.corner >> 1) & 1),
                  static_cast<float>(e.corner & 1)};
    f[e.axis] = at;
    c.fx = f[0], c.fy = f[1], c.fz = f[2];
    float g[3];
    c.gradient(g);
    return {static_cast<double>(g[0]), static_cast<double>(g[1]), static_cast<double>(g[2])};
  }

  MapView map_;
  MeshCells cells_;
  MapReader& reader_;
  Mesh mesh_;
  std::vector<float> observed_;                             // of each vertex
  std::unordered_map<std::uint64_t, std::uint32_t> index_;  // grid edge -> vertex; never iterated
};

}  // namespace

Mesh extract_mesh(rt::NonRealtime& nrt, const MapView& map, const MeshOptions& options) {
  return Mesher(map, options).run(nrt, options);
}

}  // namespace perception
