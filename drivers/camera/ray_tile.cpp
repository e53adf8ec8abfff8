#include "drivers/camera/ray_tile.hpp"

#include <bit>
#include <cmath>
#include <cstring>

namespace drivers {

namespace {

constexpr int kN = RayTile::kSize;

double least(double a, double b) noexcept { return a < b ? a : b; }
double most(double a, double b) noexcept { return a > b ? a : b; }
// 1/d with a huge finite value for 0, so that no slab product is NaN.
double safe_inverse(double d) noexcept {
  const double magnitude = d < 0 ? -d : d;
  return 1.0 / (magnitude > 1e-30 ? d : 1e-30);
}

struct Linear {  // d_S = a x + b y + c, one axis
  double a, b, c, o;
  Linear(const SeenShape& s, int axis)
      : a(s.R_SC(axis, 0)), b(s.R_SC(axis, 1)), c(s.R_SC(axis, 2)), o(s.origin_S[axis]) {}
  [[nodiscard]] double operator()(double x, double y) const noexcept { return a * x + b * y + c; }
};

TELETACT_CAMERA_CLONES
void cast_plane(RayTile& tile, const Linear z, std::int64_t id) noexcept {
  for (int i = 0; i < kN; ++i) {
    const double d = z(tile.x[i], tile.y[i]);
    const double t = -z.o / (d < -1e-30 ? d : -1e-30);
    const bool hit = (d < -1e-30) & (t < tile.t[i]);
    tile.t[i] = hit ? t : tile.t[i];
    tile.id[i] = hit ? id : tile.id[i];
  }
}

TELETACT_CAMERA_CLONES
void cast_box(RayTile& tile, const Linear lx, const Linear ly, const Linear lz, double hx,
              double hy, double hz, std::int64_t id) noexcept {
  for (int i = 0; i < kN; ++i) {
    const double x = tile.x[i], y = tile.y[i];
    const double ix = safe_inverse(lx(x, y)), iy = safe_inverse(ly(x, y));
    const double iz = safe_inverse(lz(x, y));
    const double x0 = (-hx - lx.o) * ix, x1 = (hx - lx.o) * ix;
    const double y0 = (-hy - ly.o) * iy, y1 = (hy - ly.o) * iy;
    const double z0 = (-hz - lz.o) * iz, z1 = (hz - lz.o) * iz;
    const double t = most(most(least(x0, x1), least(y0, y1)), least(z0, z1));
    const double leave = least(least(most(x0, x1), most(y0, y1)), most(z0, z1));
    const bool hit = (t <= leave) & (t > 0) & (t < tile.t[i]);
    tile.t[i] = hit ? t : tile.t[i];
    tile.id[i] = hit ? id : tile.id[i];
  }
}

TELETACT_CAMERA_CLONES
void cast_cylinder(RayTile& tile, const Linear lx, const Linear ly, const Linear lz, double radius,
                   double hz, std::int64_t id) noexcept {
  const double c = lx.o * lx.o + ly.o * ly.o - radius * radius;
  for (int i = 0; i < kN; ++i) {
    const double dx = lx(tile.x[i], tile.y[i]), dy = ly(tile.x[i], tile.y[i]);
    const double iz = safe_inverse(lz(tile.x[i], tile.y[i]));
    const double a = most(dx * dx + dy * dy, 1e-30), b = lx.o * dx + ly.o * dy;
    const double disc = b * b - a * c;
    const double root = __builtin_sqrt(most(disc, 0.0));
    const double z0 = (-hz - lz.o) * iz, z1 = (hz - lz.o) * iz;
    const double t = most((-b - root) / a, least(z0, z1));
    const double leave = least((-b + root) / a, most(z0, z1));
    const bool hit = (disc >= 0) & (t <= leave) & (t > 0) & (t < tile.t[i]);
    tile.t[i] = hit ? t : tile.t[i];
    tile.id[i] = hit ? id : tile.id[i];
  }
}

TELETACT_CAMERA_CLONES
void cast_sphere(RayTile& tile, const Linear lx, const Linear ly, const Linear lz, double radius,
                 std::int64_t id) noexcept {
  const double c = lx.o * lx.o + ly.o * ly.o + lz.o * lz.o - radius * radius;
  for (int i = 0; i < kN; ++i) {
    const double dx = lx(tile.x[i], tile.y[i]), dy = ly(tile.x[i], tile.y[i]);
    const double dz = lz(tile.x[i], tile.y[i]);
    const double a = dx * dx + dy * dy + dz * dz, b = lx.o * dx + ly.o * dy + lz.o * dz;
    const double disc = b * b - a * c;
    const double t = (-b - __builtin_sqrt(most(disc, 0.0))) / a;
    const bool hit = (disc >= 0) & (t > 0) & (t < tile.t[i]);
    tile.t[i] = hit ? t : tile.t[i];
    tile.id[i] = hit ? id : tile.id[i];
  }
}

// Intersects the infinite cylinder first. If the ray enters it beyond an end of the axis, it
// intersects the ball there. (A ray that misses the cylinder misses the balls.)
TELETACT_CAMERA_CLONES
void cast_capsule(RayTile& tile, const Linear lx, const Linear ly, const Linear lz, double radius,
                  double hz, std::int64_t id) noexcept {
  const double c = lx.o * lx.o + ly.o * ly.o - radius * radius;
  for (int i = 0; i < kN; ++i) {
    const double dx = lx(tile.x[i], tile.y[i]), dy = ly(tile.x[i], tile.y[i]);
    const double dz = lz(tile.x[i], tile.y[i]);
    const double across = dx * dx + dy * dy;
    const double a = most(across, 1e-30), b = lx.o * dx + ly.o * dy;
    const double disc = b * b - a * c;
    const double side = (-b - __builtin_sqrt(most(disc, 0.0))) / a;
    const double z = lz.o + side * dz;
    // The ball that the ray meets where it is beyond the side.
    const double oz = lz.o - (z > 0 ? hz : -hz);
    const double ball_a = across + dz * dz, ball_b = b + oz * dz;
    const double ball = ball_b * ball_b - ball_a * (c + oz * oz);
    const double cap = (-ball_b - __builtin_sqrt(most(ball, 0.0))) / ball_a;
    const bool on_side = (z <= hz) & (z >= -hz);
    const double t = on_side ? side : cap;
    const bool hit = (disc >= 0) & (on_side | (ball >= 0)) & (t > 0) & (t < tile.t[i]);
    tile.t[i] = hit ? t : tile.t[i];
    tile.id[i] = hit ? id : tile.id[i];
  }
}

// Brightness of every ray of the tile as if it met this shape.
template <Paint::Texture texture>
[[gnu::always_inline]] inline void levels(const RayTile& tile, const Linear lx, const Linear ly,
                                          const Linear lz, const Shape& s,
                                          std::uint32_t* out) noexcept {
  const double inverse = 1.0 / s.paint.cell_m;
  const double fx = s.lattice_offset_m.x(), fy = s.lattice_offset_m.y();
  const double fz = s.lattice_offset_m.z();
  const std::uint32_t depth = pattern_depth(s.paint), seed = s.paint_seed;
  for (int i = 0; i < kN; ++i) {
    const double x = tile.x[i], y = tile.y[i], t = tile.t[i];
    out[i] = paint_level(lattice_index(lx.o + t * lx(x, y), fx, inverse),
                         lattice_index(ly.o + t * ly(x, y), fy, inverse),
                         lattice_index(lz.o + t * lz(x, y), fz, inverse), texture, depth, seed);
  }
}

TELETACT_CAMERA_CLONES
void levels_checker(const RayTile& tile, const Linear lx, const Linear ly, const Linear lz,
                    const Shape& s, std::uint32_t* out) noexcept {
  levels<Paint::Texture::kChecker>(tile, lx, ly, lz, s, out);
}

TELETACT_CAMERA_CLONES
void levels_noise(const RayTile& tile, const Linear lx, const Linear ly, const Linear lz,
                  const Shape& s, std::uint32_t* out) noexcept {
  levels<Paint::Texture::kNoise>(tile, lx, ly, lz, s, out);
}

TELETACT_CAMERA_CLONES
void mix(RayTile& tile, const std::uint32_t* level, perception::Rgb c, std::int64_t id) noexcept {
  const std::uint32_t r = c.r, g = c.g, b = c.b;
  for (int i = 0; i < kN; ++i) {
    const std::uint32_t l = level[i];
    const std::uint32_t colour = (r * l >> 8U) | ((g * l >> 8U) << 8U) | ((b * l >> 8U) << 16U);
    const std::uint32_t lifted = colour != 0 ? colour : 0x010101U;  // no_colour.hpp
    tile.colour[i] = tile.id[i] == id ? lifted : tile.colour[i];
  }
}

TELETACT_CAMERA_CLONES
bool meets(const RayTile& tile, std::int64_t id) noexcept {
  std::int64_t any = 0;
  for (int i = 0; i < kN; ++i) any |= tile.id[i] == id ? 1 : 0;
  return any != 0;
}

TELETACT_CAMERA_CLONES
void shift(double* pixel, double first, double step, const float* by, int n) noexcept {
  for (int i = 0; i < n; ++i) pixel[i] = (first + step * i) + static_cast<double>(by[i]);
}

TELETACT_CAMERA_CLONES
void depths(const double* t, const std::int64_t* id, float* depth_m, int n) noexcept {
  for (int i = 0; i < n; ++i) depth_m[i] = id[i] >= 0 ? static_cast<float>(t[i]) : 0.0F;
}

}  // namespace

void tile_begin(RayTile& tile, double max_t) noexcept {
  tile.t.fill(max_t);
  tile.id.fill(-1);
  tile.colour.fill(0);
}

void tile_pixels(RayTile& tile, int j, int u0, int v, int n, const float* du_px,
                 const float* dv_px) noexcept {
  double* x = tile.x.data() + static_cast<std::ptrdiff_t>(j) * RayTile::kWidth;
  double* y = tile.y.data() + static_cast<std::ptrdiff_t>(j) * RayTile::kWidth;
  if (du_px != nullptr) {
    shift(x, u0, 1, du_px, n);
    shift(y, v, 0, dv_px, n);
  } else {
    for (int i = 0; i < n; ++i) x[i] = u0 + i, y[i] = v;
  }
  for (int i = n; i < RayTile::kWidth; ++i) x[i] = x[n - 1], y[i] = y[n - 1];
}

TELETACT_CAMERA_CLONES
void tile_aim(RayTile& tile, const Lens& lens) noexcept {
  for (int i = 0; i < kN; ++i) tile.x[i] = (tile.x[i] - lens.cx) / lens.fx;
  for (int i = 0; i < kN; ++i) tile.y[i] = (tile.y[i] - lens.cy) / lens.fy;
}

void tile_cast(RayTile& tile, const SeenShape& s) noexcept {
  const Linear x(s, 0), y(s, 1), z(s, 2);
  const auto& h = s.shape->half;
  switch (s.shape->kind) {
    case Shape::Kind::kPlane:
      return cast_plane(tile, z, s.id);
    case Shape::Kind::kBox:
      return cast_box(tile, x, y, z, h.x(), h.y(), h.z(), s.id);
    case Shape::Kind::kCylinder:
      return cast_cylinder(tile, x, y, z, h.x(), h.z(), s.id);
    case Shape::Kind::kSphere:
      return cast_sphere(tile, x, y, z, h.x(), s.id);
    case Shape::Kind::kCapsule:
      return cast_capsule(tile, x, y, z, h.x(), h.z(), s.id);
  }
}

void tile_paint(RayTile& tile, const SeenShape& s) noexcept {
  if (!meets(tile, s.id)) return;
  const Linear x(s, 0), y(s, 1), z(s, 2);
  alignas(64) std::array<std::uint32_t, kN> level;
  switch (s.shape->paint.texture) {
    case Paint::Texture::kPlain:
      level.fill(256);
      break;
    case Paint::Texture::kChecker:
      levels_checker(tile, x, y, z, *s.shape, level.data());
      break;
    case Paint::Texture::kNoise:
      levels_noise(tile, x, y, z, *s.shape, level.data());
      break;
  }
  mix(tile, level.data(), s.shape->paint.colour, s.id);
}

void tile_store(const RayTile& tile, int j, int n, float* depth_m,
                perception::Rgb* colour) noexcept {
  const std::ptrdiff_t from = static_cast<std::ptrdiff_t>(j) * RayTile::kWidth;
  depths(tile.t.data() + from, tile.id.data() + from, depth_m, n);
  const std::uint32_t* c = tile.colour.data() + from;
  static_assert(sizeof(perception::Rgb) == 3 && std::endian::native == std::endian::little);
  // Four bytes at once: the fourth is the next pixel's first, which is written after it.
  auto* to = reinterpret_cast<std::uint8_t*>(colour);
  for (int i = 0; i + 1 < n; ++i) std::memcpy(to + 3 * i, c + i, 4);
  std::memcpy(to + 3 * (n - 1), c + n - 1, 3);
}

}  // namespace drivers
