#include "drivers/camera/render.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/camera/row_kernels.hpp"
#include "rt/effect_count.hpp"

namespace drivers {

using perception::Intrinsics;
using perception::Mat3;
using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

namespace {

// One stream of random numbers per row and purpose, so that switching one effect on leaves the
// numbers of the others as they were.
enum class Purpose : std::uint64_t { kJitterU, kJitterV, kAxial, kFlying, kDropout };
RowStream row_stream(std::uint64_t seed, std::uint64_t seq, int v, Purpose purpose) noexcept {
  return {seed,
          rt::mix64(seq, static_cast<std::uint64_t>(v) * 8U + static_cast<std::uint64_t>(purpose))};
}

struct TileBounds {
  double x0, x1, y0, y1;  // directions of the tile's rays lie within
};

bool may_see(const SeenShape& s, const TileBounds& b) noexcept {
  if (s.shape->kind == Shape::Kind::kPlane) {
    // Linear in (x, y): it can be met if it is approached by one of the corners.
    const Vec3& n = s.normal_C;
    const double least =
        n.z() + std::min(n.x() * b.x0, n.x() * b.x1) + std::min(n.y() * b.y0, n.y() * b.y1);
    return s.origin_S.z() > 0 && least < 0;
  }
  if (b.x1 < s.x0 || b.x0 > s.x1 || b.y1 < s.y0 || b.y0 > s.y1) return false;
  // Bounding sphere against the four side planes of the tile's frustum.
  const Vec3& c = s.centre_C;
  const double r = s.shape->bound_radius_m;
  const auto outside = [&](double along, double slope) {  // along - slope z <= 0 is inside
    return along - slope * c.z() > r * std::sqrt(1 + slope * slope);
  };
  return c.z() > -r && !outside(c.x(), b.x1) && !outside(-c.x(), -b.x0) && !outside(c.y(), b.y1) &&
         !outside(-c.y(), -b.y0);
}

// Half of the box round the shape, along its own axes.
Vec3 half_of(const Shape& shape) noexcept {
  const Vec3& h = shape.half;
  switch (shape.kind) {
    case Shape::Kind::kBox:
      return h;
    case Shape::Kind::kCylinder:
      return {h.x(), h.x(), h.z()};
    case Shape::Kind::kCapsule:
      return {h.x(), h.x(), h.z() + h.x()};
    case Shape::Kind::kPlane:
    case Shape::Kind::kSphere:
      break;
  }
  return Vec3::Constant(h.x());
}

// Sets the directions that can meet the shape: those between the corners of its box, if all corners
// are before the lens.
void look_between(const Pose& X_CS, SeenShape& s) noexcept {
  constexpr double kInf = std::numeric_limits<double>::infinity(), kBefore_m = 1e-3;
  s.x0 = s.y0 = -kInf;
  s.x1 = s.y1 = kInf;
  if (s.shape->kind == Shape::Kind::kPlane) return;
  const Vec3 h = half_of(*s.shape);
  double x0 = kInf, x1 = -kInf, y0 = kInf, y1 = -kInf;
  for (unsigned n = 0; n < 8; ++n) {
    const Vec3 c = X_CS * Vec3((n & 1U) != 0 ? h.x() : -h.x(), (n & 2U) != 0 ? h.y() : -h.y(),
                               (n & 4U) != 0 ? h.z() : -h.z());
    if (c.z() < kBefore_m) return;
    x0 = std::min(x0, c.x() / c.z()), x1 = std::max(x1, c.x() / c.z());
    y0 = std::min(y0, c.y() / c.z()), y1 = std::max(y1, c.y() / c.z());
  }
  constexpr double kRounding = 1e-6;  // of a direction; a pixel is a thousand times as much
  s.x0 = x0 - kRounding, s.x1 = x1 + kRounding;
  s.y0 = y0 - kRounding, s.y1 = y1 + kRounding;
}

// `moves`: the world of the shapes if some of them may move; null: they rest at their own pose.
void look(std::span<const Shape> shapes, const World* moves, const Pose& X_WC, rt::Time t,
          std::vector<SeenShape>& seen) noexcept {
  assert(seen.capacity() >= seen.size() + shapes.size());
  for (const Shape& shape : shapes) {
    SeenShape s;
    s.shape = &shape;
    s.id = static_cast<std::int64_t>(seen.size());
    const Pose X_WS = moves == nullptr || shape.mover < 0
                          ? shape.X_WS
                          : moves->X_WS_at(static_cast<int>(s.id), t);
    const Mat3 R_SW = X_WS.linear().transpose();
    s.origin_S = R_SW * (X_WC.translation() - X_WS.translation());
    s.R_SC = R_SW * X_WC.linear();
    s.centre_C = X_WC.linear().transpose() * (X_WS.translation() - X_WC.translation());
    s.normal_C = s.R_SC.row(2).transpose();
    look_between(X_WC.inverse() * X_WS, s);
    seen.push_back(s);
  }
}

void jitter_rows(const LateralJitter& jitter, std::uint64_t seed, std::uint64_t seq, int v0,
                 int rows, int width, RenderScratch& scratch) noexcept {
  const float sigma = static_cast<float>(jitter.sigma_px);
  const auto draw = [&](int v, Purpose purpose, std::vector<float>& out) {
    float* row = out.data() + static_cast<std::ptrdiff_t>(v) * width;
    draw_normals(row_stream(seed, seq, v0 + v, purpose), jitter.normal, row, width);
    for (int u = 0; u < width; ++u) row[u] *= sigma;
  };
  for (int v = 0; v < rows; ++v) {
    draw(v, Purpose::kJitterU, scratch.shift_u);
    draw(v, Purpose::kJitterV, scratch.shift_v);
  }
}

struct TileAt {
  int u0, v0, width, height;  // px; a tile at the border is narrower
};

// Rays of the tile; the missing ones of a border tile repeat the last.
TileBounds aim(const Intrinsics& k, const TileAt& at, const RenderScratch& scratch, bool jittered,
               double margin_px, RayTile& tile) noexcept {
  for (int j = 0; j < RayTile::kHeight; ++j) {
    const int dv = std::min(j, at.height - 1);
    const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(dv) * k.width + at.u0;
    tile_pixels(tile, j, at.u0, at.v0 + dv, at.width,
                jittered ? scratch.shift_u.data() + first : nullptr,
                jittered ? scratch.shift_v.data() + first : nullptr);
  }
  tile_aim(tile, {k.fx, k.fy, k.cx, k.cy});
  return {(at.u0 - margin_px - k.cx) / k.fx, (at.u0 + at.width - 1 + margin_px - k.cx) / k.fx,
          (at.v0 - margin_px - k.cy) / k.fy, (at.v0 + at.height - 1 + margin_px - k.cy) / k.fy};
}

// 1/depth of a plane is linear in (x, y): within the tile it lies between those of the corners.
struct Between {
  double least, most;
};
Between inverse_depth(const SeenShape& plane, const TileBounds& b) noexcept {
  const Vec3 n = plane.normal_C / -plane.origin_S.z();
  const double x0 = n.x() * b.x0, x1 = n.x() * b.x1, y0 = n.y() * b.y0, y1 = n.y() * b.y1;
  return {n.z() + std::min(x0, x1) + std::min(y0, y1), n.z() + std::max(x0, x1) + std::max(y0, y1)};
}

// Of planes that all rays of the tile meet behind another one, none is seen. In a room that leaves
// one or two of its walls.
void drop_hidden_planes(const TileBounds& b, std::vector<const SeenShape*>& in_tile) noexcept {
  double nearest = 0;  // all rays meet a plane before this inverse depth; 0: there is none
  const auto is_plane = [](const SeenShape& s) { return s.shape->kind == Shape::Kind::kPlane; };
  for (const SeenShape* s : in_tile) {
    if (is_plane(*s)) nearest = std::max(nearest, inverse_depth(*s, b).least);
  }
  constexpr double kRounding = 1e-9;
  std::erase_if(in_tile, [&](const SeenShape* s) {
    return is_plane(*s) && inverse_depth(*s, b).most < nearest * (1 - kRounding);
  });
}

void cast_tile(const std::vector<SeenShape>& seen, const TileBounds& bounds, double max_t,
               bool colour, std::vector<const SeenShape*>& in_tile, RayTile& tile) noexcept {
  in_tile.clear();
  for (const SeenShape& s : seen) {
    if (may_see(s, bounds)) in_tile.push_back(&s);
  }
  drop_hidden_planes(bounds, in_tile);
  tile_begin(tile, max_t);
  for (const SeenShape* s : in_tile) tile_cast(tile, *s);
  if (!colour) return;
  for (const SeenShape* s : in_tile) tile_paint(tile, *s);
}

void store(const RayTile& tile, const TileAt& at, int width, float* depth_m,
           perception::Rgb* colour, std::int16_t* shape) noexcept {
  for (int j = 0; j < at.height; ++j) {
    const std::ptrdiff_t to = static_cast<std::ptrdiff_t>(at.v0 + j) * width + at.u0;
    tile_store(tile, j, at.width, depth_m + to, colour + to);
    if (shape == nullptr) continue;
    const auto from = static_cast<std::size_t>(j * RayTile::kWidth);
    for (int i = 0; i < at.width; ++i)
      shape[to + i] = static_cast<std::int16_t>(tile.id[from + static_cast<std::size_t>(i)]);
  }
}

class NoisyRows {
 public:
  NoisyRows(const DepthNoise& noise, std::uint64_t seed, std::uint64_t seq, const Intrinsics& k,
            RenderScratch& scratch) noexcept
      : noise_(noise),
        seed_(seed),
        seq_(seq),
        camera_(k),
        width_(k.width),
        height_(k.height),
        scratch_(scratch) {}

  // Noisy depth of row v into `z`; `z` holds the true depth before.
  void apply(int v, float* z) const noexcept {
    using rt::Effect;
    if (noise_.flying() != nullptr || noise_.dropout() != nullptr) {
      const bool inside = v > 0 && v + 1 < height_;
      mark_edges({inverse(v), inside ? inverse(v - 1) : nullptr, inside ? inverse(v + 1) : nullptr},
                 scratch_.row.data(), scratch_.beside.data(), width_);
    }
    if (noise_.flying() != nullptr) rt::effect_ran(Effect::kFlying), fly(v, z);
    if (noise_.axial() != nullptr) rt::effect_ran(Effect::kAxial), shake(v, z);
    if (noise_.dropout() != nullptr) rt::effect_ran(Effect::kEdgeDropout), drop(v, z);
  }

 private:
  [[nodiscard]] const float* inverse(int v) const noexcept {
    return scratch_.inverse_m.data() + static_cast<std::ptrdiff_t>(v) * width_;
  }
  static bool none_of_8(const std::uint8_t* beside) noexcept {
    std::uint64_t all;
    std::memcpy(&all, beside, sizeof all);
    return all == 0;
  }
  // Calls at_edge(u, bits) for the pixels of row v beside an edge; each has bits of its own.
  template <class AtEdge>
  void beside_edges(int v, Purpose purpose, AtEdge&& at_edge) const noexcept {
    const RowStream stream = row_stream(seed_, seq_, v, purpose);
    const std::uint8_t* beside = scratch_.beside.data();
    for (int u = 0; u < width_; ++u) {
      if (u + 8 <= width_ && none_of_8(beside + u)) {
        u += 7;
        continue;
      }
      if (beside[u] != 0) at_edge(u, stream(u));
    }
  }
  void fly(int v, float* z) const noexcept {
    const auto share = static_cast<float>(noise_.flying()->share);
    beside_edges(v, Purpose::kFlying, [&](int u, std::uint64_t bits) {
      if (unit(bits >> 32U) >= share) return;
      float lo = inverse(v)[u], hi = lo;
      const auto widen = [&lo, &hi](float i) {
        if (i > 0) lo = std::min(lo, i), hi = std::max(hi, i);
      };
      if (u > 0) widen(inverse(v)[u - 1]);
      if (u + 1 < width_) widen(inverse(v)[u + 1]);
      if (v > 0) widen(inverse(v - 1)[u]);
      if (v + 1 < height_) widen(inverse(v + 1)[u]);
      z[u] = 1 / hi + (1 / lo - 1 / hi) * unit(bits & 0xffffffffU);
    });
  }
  void shake(int v, float* z) const noexcept {
    const AxialNoise& axial = *noise_.axial();
    float* deviate = scratch_.row.data();
    draw_normals(row_stream(seed_, seq_, v, Purpose::kAxial), axial.normal, deviate, width_);
    const float* tilt = nullptr;
    if (axial.incidence > 0) tilt_row(axial, v), tilt = scratch_.tilt.data();
    shake_row(z, deviate, tilt, static_cast<float>(axial.scale), width_);
  }
  void tilt_row(const AxialNoise& axial, int v) const noexcept {
    const auto aside = [&](int w) { return w >= 0 && w < height_ ? inverse(w) : nullptr; };
    float* tilt = scratch_.tilt.data();
    incidence_row({{inverse(v), aside(v - 2), aside(v + 2)},
                   static_cast<float>(camera_.fx),
                   static_cast<float>(camera_.fy),
                   static_cast<float>(camera_.cx),
                   static_cast<float>((v - camera_.cy) / camera_.fy)},
                  tilt, width_);
    const auto factor = static_cast<float>(axial.incidence);
    for (int u = 0; u < width_; ++u) tilt[u] = factor * axial.tilt(tilt[u]);
  }
  void drop(int v, float* z) const noexcept {
    const auto share = static_cast<float>(noise_.dropout()->share);
    beside_edges(v, Purpose::kDropout, [&](int u, std::uint64_t bits) {
      if (unit(bits >> 32U) < share) z[u] = 0;
    });
  }
  static float unit(std::uint64_t bits32) noexcept {
    return static_cast<float>(bits32 >> 8U) * 0x1.0p-24F;
  }

  const DepthNoise& noise_;
  std::uint64_t seed_, seq_;
  const Intrinsics& camera_;
  int width_, height_;
  RenderScratch& scratch_;
};

}  // namespace

RenderScratch::RenderScratch(rt::NonRealtime&, std::size_t max_shapes)
    : depth_m(RgbdFrame::kMaxPixels),
      inverse_m(RgbdFrame::kMaxPixels),
      tilt(RgbdFrame::kMaxWidth),
      row(RgbdFrame::kMaxWidth),
      beside(RgbdFrame::kMaxWidth),
      shift_u(static_cast<std::size_t>(RgbdFrame::kMaxWidth) * RayTile::kHeight),
      shift_v(shift_u.size()) {
  seen.reserve(max_shapes);
  in_tile.reserve(max_shapes);
}

void render(const World& world, const Intrinsics& k, const Pose& X_WC, const DepthRange& range,
            const DepthNoise& noise, std::uint64_t seed, std::uint64_t seq, RenderScratch& scratch,
            RgbdFrame& out, rt::Time t, std::span<const Shape> carried) noexcept {
  assert(k.width <= RgbdFrame::kMaxWidth && k.height <= RgbdFrame::kMaxHeight);
  scratch.seen.clear();
  look(world.shapes(), &world, X_WC, t, scratch.seen);
  look(carried, nullptr, X_WC, t, scratch.seen);
  const double margin_px = noise.lateral() != nullptr ? 4.2 * noise.lateral()->sigma_px : 0.0;
  RayTile tile;
  for (int v0 = 0; v0 < k.height; v0 += RayTile::kHeight) {
    const int rows = std::min(RayTile::kHeight, k.height - v0);
    if (noise.lateral() != nullptr) {
      rt::effect_ran(rt::Effect::kLateral);
      jitter_rows(*noise.lateral(), seed, seq, v0, rows, k.width, scratch);
    }
    for (int u0 = 0; u0 < k.width; u0 += RayTile::kWidth) {
      const TileAt at{u0, v0, std::min(RayTile::kWidth, k.width - u0), rows};
      const TileBounds bounds = aim(k, at, scratch, noise.lateral() != nullptr, margin_px, tile);
      cast_tile(scratch.seen, bounds, 1000.0, scratch.colour, scratch.in_tile, tile);
      store(tile, at, k.width, scratch.depth_m.data(), out.colour.data(),
            scratch.shape.empty() ? nullptr : scratch.shape.data());
    }
  }
  const int pixels = k.width * k.height;
  const bool tilts = noise.axial() != nullptr && noise.axial()->incidence > 0;
  if (noise.flying() != nullptr || noise.dropout() != nullptr || tilts) {
    invert(scratch.depth_m.data(), scratch.inverse_m.data(), pixels);
  }
  const NoisyRows noisy(noise, seed, seq, k, scratch);
  for (int v = 0; v < k.height; ++v) {
    const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(v) * k.width;
    noisy.apply(v, scratch.depth_m.data() + row);
    quantise(scratch.depth_m.data() + row, out.depth_mm.data() + row, k.width,
             static_cast<float>(range.min_m), static_cast<float>(range.max_m));
  }
  out.intrinsics = k;
  out.has_colour = scratch.colour;
  out.seq = seq;
}

}  // namespace drivers
