#include "perception/body/body_mask.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "perception/simd/clones.hpp"

namespace perception {

namespace {

constexpr float kNothing = 1e9F;
constexpr double kNearest_m = 0.02;  // what reaches nearer to the image plane may be anywhere in it
constexpr int kPieces = 8;           // of a capsule, whose outlines are boxed one by one

// A capsule seen from the origin along (x, y, 1).
struct Cast {
  float ax, ay, az, bx, by, bz;  // b: from a to the other end
  float radius2, bb, ab, aa;
  bool holds_lens;

  explicit Cast(const Capsule& c) noexcept {
    const Vec3 a = -c.a, b = c.b - c.a;
    ax = static_cast<float>(a.x()), ay = static_cast<float>(a.y()), az = static_cast<float>(a.z());
    bx = static_cast<float>(b.x()), by = static_cast<float>(b.y()), bz = static_cast<float>(b.z());
    radius2 = static_cast<float>(c.radius * c.radius);
    bb = static_cast<float>(b.squaredNorm());
    ab = static_cast<float>(a.dot(b));
    aa = static_cast<float>(a.squaredNorm());
    const double length2 = b.squaredNorm();
    const double nearest = length2 > 0 ? std::clamp(a.dot(b) / length2, 0.0, 1.0) : 0.0;
    holds_lens = (nearest * b - a).norm() <= c.radius;
  }
};

// Depth at which rays of a row enter a capsule, if that is before `front`. Intersects the infinite
// cylinder first, and beyond an end of the axis the ball there. (A ray that misses the cylinder
// misses the balls.)
TELETACT_CLONES
void cast_row(const float* x, float y, int n, const Cast s, float* front) noexcept {
  const float db0 = s.by * y + s.bz, da0 = s.ay * y + s.az, dd0 = y * y + 1.0F;
  const float C = s.bb * s.aa - s.ab * s.ab - s.radius2 * s.bb;
  const float other = s.aa - 2.0F * s.ab + s.bb;  // from the lens to the other end, squared
  for (int i = 0; i < n; ++i) {
    const float db = s.bx * x[i] + db0, da = s.ax * x[i] + da0, dd = x[i] * x[i] + dd0;
    const float A = s.bb * dd - db * db;
    const float B = s.bb * da - s.ab * db;
    const float h = B * B - A * C;
    const float side = (-B - __builtin_sqrtf(h > 0.0F ? h : 0.0F)) / (A > 1e-12F ? A : 1e-12F);
    const float along = s.ab + side * db;
    const bool far = along > 0.0F;  // end: the one at b
    const float ed = far ? da - db : da;
    const float ee = far ? other : s.aa;
    const float h2 = ed * ed - dd * (ee - s.radius2);
    const float cap = (-ed - __builtin_sqrtf(h2 > 0.0F ? h2 : 0.0F)) / dd;
    const bool on_side = (along >= 0.0F) & (along <= s.bb) & (s.bb > 0.0F);
    const float t = on_side ? side : cap;
    const bool met = (h >= 0.0F) & (on_side | (h2 >= 0.0F)) & (t > 0.0F);
    const float entry = met ? t : kNothing;
    front[i] = entry < front[i] ? entry : front[i];
  }
}

TELETACT_CLONES
int mark_row(const float* front, int n, std::uint16_t* depth_mm, std::uint8_t* mask) noexcept {
  int marked = 0;
  for (int i = 0; i < n; ++i) {
    const float z = static_cast<float>(depth_mm[i]) * 1e-3F;
    const bool body = (front[i] < kNothing) & ((depth_mm[i] == 0) | (z >= front[i]));
    depth_mm[i] = body ? std::uint16_t{0} : depth_mm[i];
    mask[i] = body ? static_cast<std::uint8_t>(PixelOf::kBody) : mask[i];
    marked += body ? 1 : 0;
  }
  return marked;
}

}  // namespace

double pad_of(const Capsule& c, double error_m, const BodyPadding& p,
              const Intrinsics& k) noexcept {
  const double z = std::max({c.a.z(), c.b.z(), 0.0});
  const double off = z - p.noise_from_m;
  return error_m + p.pad_px * z / std::min(k.fx, k.fy) +
         p.sigmas * (p.noise_m + p.noise_per_m2 * off * off) + p.pad_m;
}

BodyMask::BodyMask(rt::NonRealtime&, int max_width, int max_height)
    : height_(max_height),
      outlines_(kMost),
      lo_(static_cast<std::size_t>(kMost) * static_cast<std::size_t>(max_height)),
      hi_(lo_.size()),
      set_lo_(static_cast<std::size_t>(max_height)),
      set_hi_(set_lo_.size()),
      front_(static_cast<std::size_t>(max_width)),
      x_(front_.size()) {}

// Columns u0 .. u1 of rows v0 .. v1 may meet capsule n.
void BodyMask::widen(std::size_t n, int v0, int v1, int u0, int u1) noexcept {
  Outline& o = outlines_[n];
  std::int16_t* lo = lo_.data() + n * static_cast<std::size_t>(height_);
  std::int16_t* hi = hi_.data() + n * static_cast<std::size_t>(height_);
  const auto clear = [&](int from, int to) {
    for (int v = from; v <= to; ++v) lo[v] = std::numeric_limits<std::int16_t>::max(), hi[v] = -1;
  };
  if (o.v1 < o.v0) {
    clear(v0, v1);
    o.v0 = v0, o.v1 = v1;
  } else {
    if (v0 < o.v0) clear(v0, o.v0 - 1), o.v0 = v0;
    if (v1 > o.v1) clear(o.v1 + 1, v1), o.v1 = v1;
  }
  for (int v = v0; v <= v1; ++v) {
    lo[v] = std::min(lo[v], static_cast<std::int16_t>(u0));
    hi[v] = std::max(hi[v], static_cast<std::int16_t>(u1));
  }
}

// The outline of a convex hull lies in the hull of the outlines: piece by piece, the box of both
// its balls' outlines.
void BodyMask::outline(std::size_t n, const Capsule& c, const Intrinsics& k) noexcept {
  outlines_[n] = {};
  const double r = c.radius;
  if (std::max(c.a.z(), c.b.z()) + r <= 0) return;  // behind the lens
  if (std::min(c.a.z(), c.b.z()) - r < kNearest_m) return widen(n, 0, k.height - 1, 0, k.width - 1);
  for (int i = 0; i < kPieces; ++i) {
    double u0 = 1e9, u1 = -1e9, v0 = 1e9, v1 = -1e9;
    for (const int end : {i, i + 1}) {
      const Vec3 p = c.a + (c.b - c.a) * (static_cast<double>(end) / kPieces);
      // Extent of a ball's outline along an axis: tangents from the lens in the plane of that axis
      // and z.
      const double in = p.z() * p.z() - r * r;
      const auto extent = [&](double q, double f, double centre, double& lo, double& hi) {
        const double root = r * std::sqrt(std::max(0.0, q * q + in));
        lo = std::min(lo, f * (q * p.z() - root) / in + centre);
        hi = std::max(hi, f * (q * p.z() + root) / in + centre);
      };
      extent(p.x(), k.fx, k.cx, u0, u1);
      extent(p.y(), k.fy, k.cy, v0, v1);
    }
    const int a = static_cast<int>(std::floor(std::clamp(u0, -1.0, static_cast<double>(k.width))));
    const int b = static_cast<int>(std::ceil(std::clamp(u1, -1.0, static_cast<double>(k.width))));
    const int d = static_cast<int>(std::floor(std::clamp(v0, -1.0, static_cast<double>(k.height))));
    const int e = static_cast<int>(std::ceil(std::clamp(v1, -1.0, static_cast<double>(k.height))));
    if (b < 0 || a >= k.width || e < 0 || d >= k.height) continue;
    widen(n, std::max(d, 0), std::min(e, k.height - 1), std::max(a, 0), std::min(b, k.width - 1));
  }
}

int BodyMask::mark(std::span<const Capsule> padded_C, const Intrinsics& k,
                   ImageView<std::uint16_t> depth_mm, ImageView<std::uint8_t> mask) noexcept {
  work_ = 0;
  for (int v = set_v0_; v <= std::min(set_v1_, mask.height - 1); ++v) {
    std::uint8_t* row = mask.row(v);
    const auto n = static_cast<std::size_t>(v);
    for (int u = set_lo_[n]; u <= std::min<int>(set_hi_[n], mask.width - 1); ++u)
      if (row[u] == static_cast<std::uint8_t>(PixelOf::kBody))
        row[u] = static_cast<std::uint8_t>(PixelOf::kPlace);
  }
  set_v0_ = 0, set_v1_ = -1;
  const std::size_t count = std::min(padded_C.size(), static_cast<std::size_t>(kMost));
  int v0 = k.height, v1 = -1;
  for (std::size_t n = 0; n < count; ++n) {
    outline(n, padded_C[n], k);
    if (outlines_[n].v1 < outlines_[n].v0) continue;
    v0 = std::min(v0, outlines_[n].v0);
    v1 = std::max(v1, outlines_[n].v1);
  }
  if (v1 < v0) return 0;
  for (int u = 0; u < k.width; ++u)
    x_[static_cast<std::size_t>(u)] = static_cast<float>((u - k.cx) / k.fx);
  set_v0_ = v0, set_v1_ = v1;
  int marked = 0;
  for (int v = v0; v <= v1; ++v) {
    int u0 = k.width, u1 = -1;
    const auto of = [&](std::size_t n) {
      return n * static_cast<std::size_t>(height_) + static_cast<std::size_t>(v);
    };
    const auto meets = [&](std::size_t n) {
      return v >= outlines_[n].v0 && v <= outlines_[n].v1 && hi_[of(n)] >= lo_[of(n)];
    };
    for (std::size_t n = 0; n < count; ++n) {
      if (!meets(n)) continue;
      u0 = std::min<int>(u0, lo_[of(n)]);
      u1 = std::max<int>(u1, hi_[of(n)]);
    }
    set_lo_[static_cast<std::size_t>(v)] = static_cast<std::int16_t>(u0);
    set_hi_[static_cast<std::size_t>(v)] = static_cast<std::int16_t>(u1);
    if (u1 < u0) continue;
    std::fill(front_.begin() + u0, front_.begin() + u1 + 1, kNothing);
    const float y = static_cast<float>((v - k.cy) / k.fy);
    for (std::size_t n = 0; n < count; ++n) {
      if (!meets(n)) continue;
      const int from = lo_[of(n)], to = hi_[of(n)];
      const Cast cast(padded_C[n]);
      if (cast.holds_lens)
        std::fill(front_.begin() + from, front_.begin() + to + 1, 0.0F);
      else
        cast_row(x_.data() + from, y, to - from + 1, cast, front_.data() + from);
      work_ += static_cast<std::uint64_t>(to - from + 1);
    }
    marked += mark_row(front_.data() + u0, u1 - u0 + 1, depth_mm.row(v) + u0, mask.row(v) + u0);
  }
  return marked;
}

}  // namespace perception
