#include "perception/tsdf/mesh/mesh.hpp"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <unordered_map>

#include <unistd.h>

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

template <class T>
void append(std::string& out, const T& value) {
  static_assert(std::endian::native == std::endian::little);
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

std::string ply_bytes(const Mesh& m) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                    std::to_string(m.vertices_W.size()) +
                    "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
                    "property float ny\nproperty float nz\nproperty uchar red\n"
                    "property uchar green\nproperty uchar blue\nelement face " +
                    std::to_string(m.triangles.size()) +
                    "\nproperty list uchar int vertex_indices\nend_header\n";
  out.reserve(out.size() + m.vertices_W.size() * 27 + m.triangles.size() * 13);
  for (std::size_t i = 0; i < m.vertices_W.size(); ++i) {
    for (int a = 0; a < 3; ++a) append(out, m.vertices_W[i](a));
    for (int a = 0; a < 3; ++a) append(out, m.normals_W[i](a));
    append(out, m.colours[i].r), append(out, m.colours[i].g), append(out, m.colours[i].b);
  }
  for (const auto& t : m.triangles) {
    append(out, std::uint8_t{3});
    for (const std::uint32_t v : t) append(out, static_cast<std::int32_t>(v));
  }
  return out;
}

}  // namespace

Mesh extract_mesh(rt::NonRealtime& nrt, const MapView& map, const MeshOptions& options) {
  return Mesher(map, options).run(nrt, options);
}

rt::Result<bool> write_ply(rt::NonRealtime&, const std::string& path, const Mesh& mesh) {
  if (mesh.normals_W.size() != mesh.vertices_W.size() ||
      mesh.colours.size() != mesh.vertices_W.size())
    return rt::Error{path + ": the mesh has " + std::to_string(mesh.vertices_W.size()) +
                     " vertices but another number of normals or colours"};
  const std::string beside = path + ".tmp" + std::to_string(::getpid());
  const auto fail = [&](const char* what) {
    const std::string why = std::strerror(errno);
    std::remove(beside.c_str());
    return rt::Error{path + ": " + what + ": " + why};
  };
  std::FILE* f = std::fopen(beside.c_str(), "wb");
  if (f == nullptr) return fail("cannot create");
  const std::string bytes = ply_bytes(mesh);
  const bool written = std::fwrite(bytes.data(), 1, bytes.size(), f) == bytes.size() &&
                       std::fflush(f) == 0 && ::fsync(::fileno(f)) == 0;
  const bool closed = std::fclose(f) == 0;
  if (!written || !closed) return fail("cannot write");
  if (std::rename(beside.c_str(), path.c_str()) != 0) return fail("cannot rename");
  return true;
}

}  // namespace perception
