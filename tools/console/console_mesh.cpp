#include "tools/console/console_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "perception/tsdf/mesh/mesh_deltas.hpp"

namespace teletact {

namespace {

using perception::MeshDelta;
constexpr std::size_t kVertexBytes = 10, kTriangleBytes = 6, kBlockBytes = 20;

bool sound(const MeshDelta& d) {
  if (d.block_count < 0 || d.block_count > MeshDelta::kMostBlocks || d.vertex_count < 0 ||
      d.vertex_count > MeshDelta::kMostVertices || d.triangle_count < 0 ||
      d.triangle_count > MeshDelta::kMostTriangles)
    return false;
  std::int64_t vertices = 0, triangles = 0;
  for (int b = 0; b < d.block_count; ++b) {
    const MeshDelta::Block& block = d.blocks[static_cast<std::size_t>(b)];
    const std::int64_t first = triangles;
    vertices += block.vertices;
    triangles += block.triangles;
    if (vertices > d.vertex_count || triangles > d.triangle_count) return false;
    for (std::int64_t t = first; t < triangles; ++t)
      for (const std::uint16_t i : d.triangles[static_cast<std::size_t>(t)])
        if (i >= block.vertices) return false;
  }
  if (vertices != d.vertex_count || triangles != d.triangle_count) return false;
  return std::all_of(d.vertices.begin(), d.vertices.begin() + d.vertex_count, [](const auto& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
  });
}

std::uint16_t offset_of(double value_m, std::int32_t block, double edge_m) {
  const double corner_m = (static_cast<double>(block) - 0.125) * edge_m;
  const double share = (value_m - corner_m) / (1.25 * edge_m);
  return static_cast<std::uint16_t>(std::lround(65535 * std::clamp(share, 0.0, 1.0)));
}

}  // namespace

void ConsoleMesh::clear() {
  blocks_.clear();
  by_change_.clear();
  bytes_ = 0;
  waits_ = true;
}

void ConsoleMesh::put(const Key& key, Block block) {
  const auto found = blocks_.find(key);
  const std::size_t size = block.vertices.size() + block.triangles.size();
  std::size_t before = 0;
  if (found != blocks_.end())
    before = found->second.vertices.size() + found->second.triangles.size();
  const bool no_place = found == blocks_.end() && blocks_.size() >= kMostBlocks;
  if (no_place || bytes_ - before + size > kMostBytes) {
    ++left_out_;
    return;
  }
  bytes_ = bytes_ - before + size;
  if (found != blocks_.end()) by_change_.erase(found->second.changed);
  block.changed = ++changes_;
  by_change_[block.changed] = key;
  blocks_[key] = std::move(block);
}

bool ConsoleMesh::take(const MeshDelta& delta, const ViewStamp& stamp, double block_edge_m) {
  if ((waits_ && !delta.restart) || !(block_edge_m > 0) || !std::isfinite(block_edge_m) ||
      (!delta.restart && block_edge_m != edge_m_) || !sound(delta))
    return false;
  if (delta.restart) {
    clear();
    ++epoch_;
    edge_m_ = block_edge_m;
    waits_ = false;
  }
  stamp_ = stamp;
  const auto* vertex = delta.vertices.data();
  const auto* triangle = delta.triangles.data();
  for (int b = 0; b < delta.block_count; ++b) {
    const MeshDelta::Block& from = delta.blocks[static_cast<std::size_t>(b)];
    Block block;
    block.version = from.version;
    block.vertices.reserve(kVertexBytes * from.vertices);
    block.triangles.reserve(kTriangleBytes * from.triangles);
    ByteWriter v(block.vertices), t(block.triangles);
    for (int i = 0; i < from.vertices; ++i, ++vertex) {
      v.u16(offset_of(vertex->x, from.at.x, edge_m_));
      v.u16(offset_of(vertex->y, from.at.y, edge_m_));
      v.u16(offset_of(vertex->z, from.at.z, edge_m_));
      v.u8(vertex->colour.r);
      v.u8(vertex->colour.g);
      v.u8(vertex->colour.b);
      v.u8(0);
    }
    for (int i = 0; i < from.triangles; ++i, ++triangle)
      for (const std::uint16_t corner : *triangle) t.u16(corner);
    put({from.at.x, from.at.y, from.at.z}, std::move(block));
  }
  return true;
}

ViewBytes ConsoleMesh::next(Cursor& cursor) const {
  if (!has_news(cursor)) return nullptr;
  const bool restart = cursor.epoch != epoch_;
  if (restart) cursor = {epoch_, 0, 0};
  std::vector<std::pair<const Key*, const Block*>> some;
  std::size_t size = 0;
  for (auto at = by_change_.upper_bound(cursor.seen); at != by_change_.end(); ++at) {
    const Block& block = blocks_.at(at->second);
    const std::size_t more = kBlockBytes + block.vertices.size() + block.triangles.size();
    if (!some.empty() && size + more > kMessageBytes) break;
    size += more;
    some.emplace_back(&at->second, &block);
    cursor.seen = at->first;
  }
  if (some.empty()) cursor.seen = changes_;
  auto bytes = std::make_shared<std::vector<std::uint8_t>>();
  bytes->reserve(kViewHeadBytes + 16 + size);
  write_view_head(ViewKind::kMesh, cursor.next_seq, stamp_, *bytes);
  ByteWriter w(*bytes);
  w.u32(cursor.next_seq++);
  w.u32(restart ? 1 : 0);  // u8 and three of padding
  w.u32(static_cast<std::uint32_t>(some.size()));
  for (const auto& [key, block] : some) {
    for (const std::int32_t c : *key) w.i32(c);
    w.u32(block->version);
    w.u16(static_cast<std::uint16_t>(block->vertices.size() / kVertexBytes));
    w.u16(static_cast<std::uint16_t>(block->triangles.size() / kTriangleBytes));
  }
  w.f32(static_cast<float>(edge_m_));
  for (const auto& part : some) w.bytes(part.second->vertices);
  for (const auto& part : some) w.bytes(part.second->triangles);
  return bytes;
}

}  // namespace teletact
