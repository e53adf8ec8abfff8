#include "perception/tsdf/mesh.hpp"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <unordered_map>

#include <unistd.h>

#include "perception/tsdf/map_reader.hpp"
#include "perception/tsdf/marching_cubes.hpp"

namespace perception {
namespace {

class Mesher {
 public:
  Mesher(const TsdfMap& map, const MeshOptions& o)
      : map_(map),
        reader_(map, o.min_weight),
        max_jump_(static_cast<float>(o.max_edge_jump * TsdfMap::kDistanceOne)),
        least_readings_(
            static_cast<std::uint32_t>(std::clamp(std::lround(2 * o.min_weight) - 1, 1L, 15L))),
        needs_readings_(o.needs_readings && coloured(map)) {}

  Mesh run(rt::NonRealtime& nrt, const MeshOptions& o) {
    map_.for_each_block([&](std::int32_t block, BlockCoord b) {
      block_ = block;
      at_ = b;
      for (int n = 0; n < TsdfMap::kBlockVoxels; ++n)
        cell(b.x * 8 + (n >> 6), b.y * 8 + ((n >> 3) & 7), b.z * 8 + (n & 7));
    });
    if (o.refined) refine_vertices(nrt, observed_, map_.voxel_size(), o.refine, mesh_);
    return std::move(mesh_);
  }

 private:
  void cell(int i, int j, int k) {
    const MapReader::Cell c = reader_.cell(i, j, k, 0.0F, 0.0F, 0.0F);
    if (!c.valid) return;
    unsigned inside = 0;
    for (unsigned n = 0; n < 8; ++n)
      inside |= static_cast<unsigned>(c.corner(static_cast<int>(n)) <= 0) << n;
    const marching_cubes::Case& m = marching_cubes::kCases[inside];
    if (m.triangles == 0) return;
    for (const marching_cubes::Edge& e : marching_cubes::kEdges) {
      const float a = c.corner(e.corner), b = c.corner(e.corner | marching_cubes::axis_bit(e.axis));
      if ((a <= 0) == (b <= 0)) continue;
      if (std::fabs(a - b) > max_jump_) return;
      if (needs_readings_ &&
          readings(i, j, k, e.corner) +
                  readings(i, j, k, e.corner | marching_cubes::axis_bit(e.axis)) <
              least_readings_)
        return;
    }
    for (std::size_t t = 0; t < m.triangles; ++t) {
      std::array<std::uint32_t, 3> tri{};
      for (std::size_t v = 0; v < 3; ++v) tri[v] = vertex(i, j, k, c, m.edge[t][v]);
      // Nodes exactly on the surface collapse a triangle to a line.
      if (tri[0] != tri[1] && tri[1] != tri[2] && tri[0] != tri[2]) mesh_.triangles.push_back(tri);
    }
  }

  static bool coloured(const TsdfMap& map) {
    bool any = false;
    map.for_each_block([&](std::int32_t block, BlockCoord) {
      const std::uint32_t* c = map.block_colours(block);
      any =
          any || std::any_of(c, c + TsdfMap::kBlockVoxels, [](std::uint32_t v) { return v != 0; });
    });
    return any;
  }

  // Readings that ended near this corner of the cell, as far as they are counted.
  [[nodiscard]] std::uint32_t readings(int i, int j, int k, int corner) const {
    const int x = i + (corner >> 2), y = j + ((corner >> 1) & 1), z = k + (corner & 1);
    const BlockCoord b{x >> 3, y >> 3, z >> 3};
    const std::int32_t block = b == at_ ? block_ : map_.find_block(b);
    return block == TsdfMap::kNoBlock
               ? 0U
               : map_.block_colours(block)[TsdfMap::in_block(x, y, z)] >> 24U;
  }

  std::uint32_t vertex(int i, int j, int k, const MapReader::Cell& c, std::uint8_t edge) {
    const marching_cubes::Edge e = marching_cubes::kEdges[edge];
    const int x = i + (e.corner >> 2), y = j + ((e.corner >> 1) & 1), z = k + (e.corner & 1);
    constexpr std::uint64_t kMask = (1U << 20U) - 1U;  // wraps beyond 10 km of 1 cm voxels
    const std::uint64_t key = (static_cast<std::uint64_t>(x) & kMask) << 42U |
                              (static_cast<std::uint64_t>(y) & kMask) << 22U |
                              (static_cast<std::uint64_t>(z) & kMask) << 2U | e.axis;
    const auto [it, added] =
        index_.try_emplace(key, static_cast<std::uint32_t>(mesh_.vertices_W.size()));
    if (!added) return it->second;
    const float a = c.corner(e.corner), b = c.corner(e.corner | marching_cubes::axis_bit(e.axis));
    Vec3 p(x, y, z);
    p(e.axis) += static_cast<double>(a / (a - b));
    p *= map_.voxel_size();
    mesh_.vertices_W.push_back(p.cast<float>());
    observed_.push_back(observations(x, y, z, e.axis));
    Vec3 n;
    if (!reader_.gradient(p, n)) n = cell_gradient(c, e, a / (a - b));
    const double length = n.norm();
    mesh_.normals_W.push_back((length > 0 ? Vec3(n / length) : Vec3::UnitZ()).cast<float>());
    Rgb colour;
    if (!reader_.colour(p, colour)) colour = {128, 128, 128};
    mesh_.colours.push_back(colour);
    return it->second;
  }

  // Of the lesser of the edge's two nodes.
  float observations(int x, int y, int z, int axis) {
    const auto weight = [&](int dx, int dy, int dz) {
      return TsdfMap::word_weight(reader_.word(x + dx, y + dy, z + dz));
    };
    const auto least =
        std::min(weight(0, 0, 0), weight(axis == 0 ? 1 : 0, axis == 1 ? 1 : 0, axis == 2 ? 1 : 0));
    return static_cast<float>(least) / static_cast<float>(TsdfMap::kWeightOne);
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

  const TsdfMap& map_;
  MapReader reader_;
  float max_jump_;
  std::uint32_t least_readings_;
  bool needs_readings_;
  std::int32_t block_ = TsdfMap::kNoBlock;  // whose cells are looked at
  BlockCoord at_;
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

Mesh extract_mesh(rt::NonRealtime& nrt, const TsdfMap& map, const MeshOptions& options) {
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
