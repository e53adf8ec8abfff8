#include "perception/tsdf/blocks/map_reader.hpp"

#include <algorithm>

#include "perception/geometry/no_colour.hpp"

namespace perception {
namespace {

// Grid coordinates outside this range would not fit an int.
bool in_range(const Vec3& grid) noexcept {
  return grid.cwiseAbs().maxCoeff() < 8.0 * MapLayout::kMaxBlockCoord && grid.allFinite();
}

// Of corner n of a cell in the value at its point (fx, fy, fz).
float share_of(int n, float fx, float fy, float fz) noexcept {
  return ((n & 4) != 0 ? fx : 1 - fx) * ((n & 2) != 0 ? fy : 1 - fy) * ((n & 1) != 0 ? fz : 1 - fz);
}

constexpr std::uint8_t kDiffer = 255;  // no label

// Vote of eight nodes of one block, node(n) of the n-th voxel from the first: their label, with the
// sum of their weights times their shares; kDiffer if they differ. Nodes without a vote abstain.
template <class Node>
LabelVoxel agreed(Node&& node, float fx, float fy, float fz) noexcept {
  const LabelVoxel v[8] = {node(0),  node(1),  node(8),  node(9),
                           node(64), node(65), node(72), node(73)};
  std::uint8_t all = 0xff, any = 0;
  float sum = 0;
  for (int n = 0; n < 8; ++n) {
    const bool votes = v[n].weight != 0;
    all &= votes ? v[n].label : std::uint8_t{0xff};
    any |= votes ? v[n].label : std::uint8_t{0};
    sum += share_of(n, fx, fy, fz) * static_cast<float>(v[n].weight);
  }
  if (sum > 0 && all != any) return {kDiffer, 0};
  return {any, static_cast<std::uint8_t>(std::ceil(sum))};
}

}  // namespace

MapReader::Sample MapReader::sample(const Vec3& p_W) noexcept {
  const Vec3 g = p_W * inv_voxel_;
  if (!in_range(g)) return {};
  const Cell c = cell(g.x(), g.y(), g.z());
  if (!c.valid) return {};
  return {c.value() * map_.metres_per_unit(), true};
}

bool MapReader::gradient(const Vec3& p_W, Vec3& out) noexcept {
  const double h = map_.voxel_size();
  for (int a = 0; a < 3; ++a) {
    const Sample lo = sample(p_W - h * Vec3::Unit(a)), hi = sample(p_W + h * Vec3::Unit(a));
    if (!lo.valid || !hi.valid) return false;
    out(a) = (static_cast<double>(hi.distance_m) - static_cast<double>(lo.distance_m)) / (2 * h);
  }
  return true;
}

bool MapReader::colour(const Vec3& p_W, Rgb& out) noexcept {
  const Vec3 g = p_W * inv_voxel_;
  if (!in_range(g)) return false;
  const int i = ifloor(g.x()), j = ifloor(g.y()), k = ifloor(g.z());
  double best = 1e9;
  for (int n = 0; n < 8; ++n) {
    const int x = i + (n >> 2), y = j + ((n >> 1) & 1), z = k + (n & 1);
    const double d = (g - Vec3(x, y, z)).squaredNorm();
    if (d >= best) continue;
    const MapLayout::Chunk* c = chunk_of(x >> 6, y >> 6, z >> 6);
    if (c == nullptr) continue;
    const std::int32_t b =
        c->block[static_cast<std::size_t>(MapLayout::in_chunk(x >> 3, y >> 3, z >> 3))];
    if (b == MapLayout::kNoBlock) continue;
    const std::uint32_t v = map_.block_colours(b)[MapLayout::in_block(x, y, z)];
    if (coloured_readings_of(v) == 0) continue;
    best = d;
    out = colour_of(v);
  }
  return best < 1e9;
}

std::int32_t MapReader::block_number(int x, int y, int z) noexcept {
  const MapLayout::Chunk* c = chunk_of(x >> 6, y >> 6, z >> 6);
  return c == nullptr
             ? MapLayout::kNoBlock
             : c->block[static_cast<std::size_t>(MapLayout::in_chunk(x >> 3, y >> 3, z >> 3))];
}

LabelVoxel MapReader::voted(const Vec3& p_W) noexcept {
  const Vec3 g = p_W * inv_voxel_;
  if (!in_range(g)) return {};
  const int i = ifloor(g.x()), j = ifloor(g.y()), k = ifloor(g.z());
  const auto fx = static_cast<float>(g.x() - i), fy = static_cast<float>(g.y() - j),
             fz = static_cast<float>(g.z() - k);
  const bool inside = (i & 7) != 7 && (j & 7) != 7 && (k & 7) != 7;  // one block has all eight
  std::int32_t b = block_number(i, j, k);
  if (inside && b == MapLayout::kNoBlock) return {};
  // The usual case: what votes says the same, all of it in one block.
  if (inside) {
    const LabelVoxel* held = map_.block_labels(b);
    const int first = MapLayout::in_block(i, j, k);
    const LabelVoxel all =
        held != nullptr
            ? agreed([held, first](int n) { return held[first + n]; }, fx, fy, fz)
            : agreed([this, b, first](int n) { return map_.label_in(b, first + n); }, fx, fy, fz);
    if (all.label != kDiffer) return all.weight > 0 ? all : nearest_vote(i, j, k, {fx, fy, fz});
  }
  // At most eight labels; say[n]: votes for label of corner n, kept at the first corner that has
  // it.
  std::array<std::uint8_t, 8> names{};
  std::array<float, 8> say{};
  int count = 0;
  for (int n = 0; n < 8; ++n) {
    const int x = i + (n >> 2), y = j + ((n >> 1) & 1), z = k + (n & 1);
    if (!inside) b = block_number(x, y, z);
    if (b == MapLayout::kNoBlock) continue;
    const LabelVoxel v = map_.label_in(b, MapLayout::in_block(x, y, z));
    if (v.weight == 0) continue;
    int at = 0;
    while (at < count && names[static_cast<std::size_t>(at)] != v.label) ++at;
    if (at == count) names[static_cast<std::size_t>(count++)] = v.label;
    say[static_cast<std::size_t>(at)] += share_of(n, fx, fy, fz) * static_cast<float>(v.weight);
  }
  const auto most = std::max_element(say.begin(), say.end());
  if (!(*most > 0)) return nearest_vote(i, j, k, {fx, fy, fz});
  return {names[static_cast<std::size_t>(most - say.begin())],
          static_cast<std::uint8_t>(std::ceil(*most))};
}

// Of the nodes round the point's own cell: the nearest one with a vote, up to 1.5 voxels away.
LabelVoxel MapReader::nearest_vote(int i, int j, int k, const Vec3f& in_cell) noexcept {
  constexpr float kFar2 = 1.5F * 1.5F;
  LabelVoxel nearest;
  float least = kFar2;
  for (int x = -1; x <= 2; ++x)
    for (int y = -1; y <= 2; ++y)
      for (int z = -1; z <= 2; ++z) {
        const float d2 =
            (Vec3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)) - in_cell)
                .squaredNorm();
        if (!(d2 < least)) continue;
        const std::int32_t b = block_number(i + x, j + y, k + z);
        if (b == MapLayout::kNoBlock) continue;
        const LabelVoxel v = map_.label_in(b, MapLayout::in_block(i + x, j + y, k + z));
        if (v.weight == 0) continue;
        least = d2;
        nearest = {v.label, 1};
      }
  return nearest;
}

}  // namespace perception
