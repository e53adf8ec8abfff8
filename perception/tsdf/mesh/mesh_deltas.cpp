#include "perception/tsdf/mesh/mesh_deltas.hpp"

#include <algorithm>
#include <cmath>

#include "perception/tsdf/mesh/mesh_cells.hpp"

namespace perception {
namespace {

constexpr std::size_t kNodes =
    MapLayout::kBlockEdge + 1;  // along an edge, those of the next block too
constexpr std::uint16_t kNone = 0xffff;
constexpr int most_of_a_cell() {
  int most = 0;
  for (const marching_cubes::Case& c : marching_cubes::kCases)
    most = std::max(most, static_cast<int>(c.triangles));
  return most;
}
// Of one block: a vertex an edge.
constexpr int kMostVertices = 3 * static_cast<int>(kNodes * kNodes * kNodes);
constexpr int kMostTriangles = most_of_a_cell() * MapLayout::kBlockVoxels;
static_assert(kMostVertices <= MeshDelta::kMostVertices && kMostVertices < kNone);
static_assert(kMostTriangles <= MeshDelta::kMostTriangles);

}  // namespace

MeshSender::MeshSender(rt::NonRealtime&, const MapView& map)
    : map_(map),
      sent_(static_cast<std::size_t>(map.config().max_blocks)),
      vertex_of_edge_(static_cast<std::size_t>(kMostVertices), kNone),
      map_id_(map.map_id()) {}

MeshSender::~MeshSender() = default;

std::size_t MeshSender::memory_bytes() const noexcept {
  return sizeof *this + sent_.capacity() * sizeof(Sent) +
         vertex_of_edge_.capacity() * sizeof(std::uint16_t);
}

void MeshSender::restart() noexcept {
  std::fill_n(sent_.begin(), most_, Sent{});
  begins_ = true;
}

bool MeshSender::room(const MeshDelta& out) const noexcept {
  return out.block_count + 2 <= MeshDelta::kMostBlocks &&  // one withdrawn, one in its place
         out.vertex_count + kMostVertices <= MeshDelta::kMostVertices &&
         out.triangle_count + kMostTriangles <= MeshDelta::kMostTriangles;
}

bool MeshSender::next(int budget, MeshDelta& out) noexcept {
  out.block_count = out.vertex_count = out.triangle_count = 0;
  out.restart = begins_;
  cut_last_ = 0;
  if (map_.map_id() != map_id_) {
    map_id_ = map_.map_id();
    coloured_ = false;
  }
  most_ = std::max(most_, map_.block_slots());
  if (cursor_ >= most_) cursor_ = 0;
  for (std::int32_t looked = 0; looked < most_ && room(out); ++looked) {
    const std::int32_t slot = cursor_;
    Sent& sent = sent_[static_cast<std::size_t>(slot)];
    const bool live = slot < map_.block_slots() && map_.in_use(slot);
    const BlockCoord at = live ? map_.block_coord(slot) : BlockCoord{};
    if (sent.shown && !(live && at == sent.at)) withdraw(sent, out);
    if (live &&
        (sent.revision == 0 || !(at == sent.at) || map_.cells_revision(slot) > sent.revision)) {
      if (cut_last_ == budget) break;  // begins here the next time
      ++cut_last_;
      const bool shows = cut(slot, at, out);
      sent.at = at;
      sent.revision = map_.revision();
      sent.shown = shows;
    }
    cursor_ = slot + 1 < most_ ? slot + 1 : 0;
  }
  if (out.block_count == 0) return false;
  begins_ = false;
  return true;
}

// What is no longer in this place of the pool. Where it has another place by now, that is to be
// sent after this.
void MeshSender::withdraw(Sent& sent, MeshDelta& out) noexcept {
  MeshDelta::Block& b = out.blocks[static_cast<std::size_t>(out.block_count++)];
  b = {sent.at, map_.revision(), 0, 0};
  const std::int32_t elsewhere = map_.find_block(sent.at);
  if (elsewhere != MapLayout::kNoBlock) {
    Sent& other = sent_[static_cast<std::size_t>(elsewhere)];
    if (other.at == sent.at) other.revision = 0;
  }
  sent = {};
}

// True: the receiver has triangles of the block now.
bool MeshSender::cut(std::int32_t block, BlockCoord at, MeshDelta& out) noexcept {
  if (!coloured_ && MeshCells::coloured(map_, block)) {
    // From now on a surface needs readings: what was sent before may have too much.
    coloured_ = true;
    for (std::int32_t n = 0; n < most_; ++n) sent_[static_cast<std::size_t>(n)].revision = 0;
  }
  const MeshOptions options;
  MeshCells cells(map_, options.min_weight, options.max_edge_jump, coloured_);
  const int first_vertex = out.vertex_count, first_triangle = out.triangle_count;
  std::fill(vertex_of_edge_.begin(), vertex_of_edge_.end(), kNone);
  cells.cut(block, at,
            [&](int i, int j, int k, const MapReader::Cell& c, const marching_cubes::Case& m) {
              for (std::size_t t = 0; t < m.triangles; ++t) {
                MeshDelta::Triangle tri{};
                for (std::size_t v = 0; v < 3; ++v) {
                  const auto x = MeshCells::crossing(i, j, k, c, m.edge[t][v]);
                  const auto n = static_cast<std::size_t>(x.x - at.x * 8) * kNodes * kNodes +
                                 static_cast<std::size_t>(x.y - at.y * 8) * kNodes +
                                 static_cast<std::size_t>(x.z - at.z * 8);
                  std::uint16_t& index = vertex_of_edge_[n * 3 + static_cast<std::size_t>(x.axis)];
                  if (index == kNone) {
                    index = static_cast<std::uint16_t>(out.vertex_count - first_vertex);
                    const Vec3f p = x.position(map_.voxel_size()).cast<float>();
                    out.vertices[static_cast<std::size_t>(out.vertex_count++)] = {
                        p.x(), p.y(), p.z(), colour(x.x, x.y, x.z, x.axis, x.share), 0};
                  }
                  tri[v] = index;
                }
                if (tri[0] == tri[1] || tri[1] == tri[2] || tri[0] == tri[2]) continue;
                out.triangles[static_cast<std::size_t>(out.triangle_count++)] = tri;
              }
            });
  const Sent& sent = sent_[static_cast<std::size_t>(block)];
  const bool shows = out.triangle_count > first_triangle;
  if (!shows) out.vertex_count = first_vertex;
  if (shows || (sent.shown && sent.at == at)) {
    out.blocks[static_cast<std::size_t>(out.block_count++)] = {
        at, map_.revision(), static_cast<std::uint16_t>(out.vertex_count - first_vertex),
        static_cast<std::uint16_t>(out.triangle_count - first_triangle)};
  }
  return shows;
}

// Of the nearer node of the edge that has one.
Rgb MeshSender::colour(int x, int y, int z, int axis, float share) const noexcept {
  const bool upper_first = share > 0.5F;
  for (const bool upper : {upper_first, !upper_first}) {
    const int step = upper ? 1 : 0;
    const int i = x + (axis == 0 ? step : 0), j = y + (axis == 1 ? step : 0),
              k = z + (axis == 2 ? step : 0);
    const std::int32_t block = map_.find_block({i >> 3, j >> 3, k >> 3});
    if (block == MapLayout::kNoBlock) continue;
    const std::uint32_t v = map_.block_colours(block)[MapLayout::in_block(i, j, k)];
    if (coloured_readings_of(v) == 0) continue;
    return colour_of(v);
  }
  return kNeutral;
}

// ---------------------------------------------------------------- the viewer's side

bool MeshStore::take(const MeshDelta& d) {
  const auto within = [](std::int32_t n, int most) { return n >= 0 && n <= most; };
  if (!within(d.block_count, MeshDelta::kMostBlocks) ||
      !within(d.vertex_count, MeshDelta::kMostVertices) ||
      !within(d.triangle_count, MeshDelta::kMostTriangles))
    return false;
  std::int32_t vertices = 0, triangles = 0;
  for (std::int32_t n = 0; n < d.block_count; ++n) {
    const MeshDelta::Block& b = d.blocks[static_cast<std::size_t>(n)];
    if (triangles + b.triangles > d.triangle_count || vertices + b.vertices > d.vertex_count)
      return false;
    for (std::int32_t t = triangles; t < triangles + b.triangles; ++t)
      for (const std::uint16_t v : d.triangles[static_cast<std::size_t>(t)])
        if (v >= b.vertices) return false;
    vertices += b.vertices, triangles += b.triangles;
  }
  if (vertices != d.vertex_count || triangles != d.triangle_count) return false;
  for (std::int32_t n = 0; n < vertices; ++n) {
    const auto& v = d.vertices[static_cast<std::size_t>(n)];
    if (!std::isfinite(v.x + v.y + v.z)) return false;
  }
  if (d.restart) {
    parts_.clear();
    triangles_ = 0;
  }
  const auto* vertex = d.vertices.data();
  const auto* triangle = d.triangles.data();
  for (std::int32_t n = 0; n < d.block_count; ++n) {
    const MeshDelta::Block& b = d.blocks[static_cast<std::size_t>(n)];
    const std::array<std::int32_t, 3> key{b.at.x, b.at.y, b.at.z};
    if (const auto old = parts_.find(key); old != parts_.end()) {
      triangles_ -= old->second.triangles.size();
      parts_.erase(old);
    }
    if (b.triangles > 0) {
      Part& part = parts_[key];
      part.version = b.version;
      part.vertices.assign(vertex, vertex + b.vertices);
      part.triangles.assign(triangle, triangle + b.triangles);
      triangles_ += part.triangles.size();
    }
    vertex += b.vertices, triangle += b.triangles;
  }
  seq_ = d.seq;
  return true;
}

Mesh MeshStore::mesh() const {
  Mesh mesh;
  for (const auto& [at, part] : parts_) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices_W.size());
    for (const MeshDelta::Vertex& v : part.vertices) {
      mesh.vertices_W.emplace_back(v.x, v.y, v.z);
      mesh.normals_W.emplace_back(Vec3f::Zero());
      mesh.colours.push_back(v.colour);
    }
    for (const MeshDelta::Triangle& t : part.triangles) {
      const std::array<std::uint32_t, 3> tri{first + t[0], first + t[1], first + t[2]};
      mesh.triangles.push_back(tri);
      const Vec3f& a = mesh.vertices_W[tri[0]];
      const Vec3f n = (mesh.vertices_W[tri[1]] - a).cross(mesh.vertices_W[tri[2]] - a);  // by area
      for (const std::uint32_t v : tri) mesh.normals_W[v] += n;
    }
  }
  for (Vec3f& n : mesh.normals_W) {
    const float length = n.norm();
    n = length > 0 ? Vec3f(n / length) : Vec3f::UnitZ();
  }
  return mesh;
}

}  // namespace perception
