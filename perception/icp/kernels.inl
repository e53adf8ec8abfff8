// Included by kernels_base.cpp and kernels_v3.cpp inside their own namespaces; see kernels.hpp.
// GCC vector extensions: the compiler lowers 8 lanes to what the target has.

typedef float F8 __attribute__((vector_size(32)));
typedef float F4 __attribute__((vector_size(16)));
typedef std::int32_t I8 __attribute__((vector_size(32)));

#define LANE_FN static inline __attribute__((always_inline))

LANE_FN F8 load(const float* p) {
  F8 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
LANE_FN F4 load4(const float* p) {
  F4 v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
LANE_FN void store(float* p, F8 v) { std::memcpy(p, &v, sizeof v); }
LANE_FN F8 splat(float x) { return F8{x, x, x, x, x, x, x, x}; }
LANE_FN I8 bits(F8 v) {
  I8 i;
  std::memcpy(&i, &v, sizeof i);
  return i;
}
LANE_FN F8 from_bits(I8 i) {
  F8 v;
  std::memcpy(&v, &i, sizeof v);
  return v;
}
// v where the mask is set, +0 elsewhere; a NaN in a masked lane vanishes.
LANE_FN F8 keep(I8 mask, F8 v) { return from_bits(mask & bits(v)); }
LANE_FN F8 magnitude(F8 v) {
  const std::int32_t m = 0x7fffffff;
  return from_bits(bits(v) & I8{m, m, m, m, m, m, m, m});
}
LANE_FN F8 lesser(F8 a, F8 b) { return a < b ? a : b; }
LANE_FN F8 root(F8 v) {
#if defined(__AVX__)
  return _mm256_sqrt_ps(v);
#else
  F4 lo, hi;
  std::memcpy(&lo, &v, sizeof lo);
  std::memcpy(&hi, reinterpret_cast<const char*>(&v) + sizeof lo, sizeof hi);
  lo = _mm_sqrt_ps(lo);
  hi = _mm_sqrt_ps(hi);
  return F8{lo[0], lo[1], lo[2], lo[3], hi[0], hi[1], hi[2], hi[3]};
#endif
}
LANE_FN std::int32_t count(I8 mask) {
  std::int32_t n = 0;
  for (int k = 0; k < 8; ++k) n -= mask[k];
  return n;
}

// x, y, z of eight 4-float groups at base + offset[k].
LANE_FN void gather3(const float* base, const std::int32_t* offset, F8& x, F8& y, F8& z) {
  F8 a[4];
  for (int k = 0; k < 4; ++k) {
    const F4 lo = load4(base + offset[k]);
    const F4 hi = load4(base + offset[k + 4]);
    a[k] = __builtin_shufflevector(lo, hi, 0, 1, 2, 3, 4, 5, 6, 7);
  }
  const F8 t0 = __builtin_shufflevector(a[0], a[1], 0, 8, 1, 9, 4, 12, 5, 13);
  const F8 t1 = __builtin_shufflevector(a[2], a[3], 0, 8, 1, 9, 4, 12, 5, 13);
  const F8 t2 = __builtin_shufflevector(a[0], a[1], 2, 10, 3, 11, 6, 14, 7, 15);
  const F8 t3 = __builtin_shufflevector(a[2], a[3], 2, 10, 3, 11, 6, 14, 7, 15);
  x = __builtin_shufflevector(t0, t1, 0, 1, 8, 9, 4, 5, 12, 13);
  y = __builtin_shufflevector(t0, t1, 2, 3, 10, 11, 6, 7, 14, 15);
  z = __builtin_shufflevector(t2, t3, 0, 1, 8, 9, 4, 5, 12, 13);
}

LANE_FN F8 affine(const float* R, float t, F8 x, F8 y, F8 z) {
  return splat(R[0]) * x + splat(R[1]) * y + splat(R[2]) * z + splat(t);
}

template <bool kWithCross>
LANE_FN void accumulate_row_impl(const RowJob& job, RowSums& out) {
  F8 sum[kSums];
  F8 cross[kWithCross ? kCross : 1];
  for (F8& s : sum) s = splat(0);
  for (F8& s : cross) s = splat(0);
  I8 inliers = {}, met = {}, live = {};

  for (int u = 0; u < job.width; u += 8) {
    const F8 z = load(job.z + u);
    const I8 has_depth = z > splat(0);
    live -= has_depth;
    const F8 x = load(job.x_factor + u) * z;
    const F8 y = splat(job.y_factor) * z;

    // Project into the camera that cast the model, nearest pixel.
    const F8 qx = affine(job.R_F, job.t_F[0], x, y, z);
    const F8 qy = affine(job.R_F + 3, job.t_F[1], x, y, z);
    const F8 qz = affine(job.R_F + 6, job.t_F[2], x, y, z);
    I8 ok = has_depth & (qz > splat(0.05F));
    const F8 inv_z = splat(1.0F) / (ok ? qz : splat(1.0F));
    F8 pu = splat(job.fx) * qx * inv_z + splat(job.cx + 0.5F);
    F8 pv = splat(job.fy) * qy * inv_z + splat(job.cy + 0.5F);
    ok &= (pu >= splat(0)) & (pv >= splat(0)) & (pu < splat(job.model_width)) &
          (pv < splat(job.model_height));
    pu = __builtin_convertvector(__builtin_convertvector(keep(ok, pu), I8), F8);
    pv = __builtin_convertvector(__builtin_convertvector(keep(ok, pv), I8), F8);
    const I8 index = __builtin_convertvector(pv * splat(job.model_width) + pu, I8)
                     << 3;  // exact below 2^24
    alignas(32) std::int32_t offset[8];
    std::memcpy(offset, &index, sizeof offset);

    F8 mx, my, mz, nx, ny, nz;
    gather3(job.model, offset, mx, my, mz);
    gather3(job.model + 4, offset, nx, ny, nz);
    ok &= (nx * nx + ny * ny + nz * nz) > splat(0.5F);  // a model surface, and not NaN
    met -= ok;

    const F8 dx = qx - mx, dy = qy - my, dz = qz - mz;
    const F8 lnx = load(job.nx + u), lny = load(job.ny + u), lnz = load(job.nz + u);
    const F8 lx = affine(job.R_F, 0, lnx, lny, lnz);
    const F8 ly = affine(job.R_F + 3, 0, lnx, lny, lnz);
    const F8 lz = affine(job.R_F + 6, 0, lnx, lny, lnz);
    ok &= (dx * dx + dy * dy + dz * dz) < splat(job.gate_d2);
    ok &= (lx * nx + ly * ny + lz * nz) > splat(job.gate_cos);
    inliers -= ok;

    const F8 r = keep(ok, nx * dx + ny * dy + nz * dz);
    const F8 share = lesser(splat(1.0F), splat(job.range_weight2) * inv_z * inv_z);
    const F8 w = keep(ok, share * share);
    const F8 ax = qx - splat(job.centre[0]), ay = qy - splat(job.centre[1]),
             az = qz - splat(job.centre[2]);
    const F8 J[6] = {keep(ok, nx),
                     keep(ok, ny),
                     keep(ok, nz),
                     keep(ok, ay * nz - az * ny),
                     keep(ok, az * nx - ax * nz),
                     keep(ok, ax * ny - ay * nx)};
    int s = 0;
    for (int i = 0; i < 6; ++i) {
      const F8 wJ = w * J[i];
      for (int j = i; j < 6; ++j) sum[s++] += wJ * J[j];
      sum[21 + i] += wJ * r;
    }
    sum[27] += w * r * r;
    sum[28] += w;
    if constexpr (kWithCross) {
      const F8 L[6] = {keep(ok, lx),
                       keep(ok, ly),
                       keep(ok, lz),
                       keep(ok, ay * lz - az * ly),
                       keep(ok, az * lx - ax * lz),
                       keep(ok, ax * ly - ay * lx)};
      const F8 half = splat(0.5F) * w;
      s = 0;
      for (int i = 0; i < 6; ++i) {
        for (int j = i; j < 6; ++j) cross[s++] += half * (L[i] * J[j] + J[i] * L[j]);
      }
    }
  }
  for (int i = 0; i < kSums; ++i) store(out.sums[i], sum[i]);
  if constexpr (kWithCross) {
    for (int i = 0; i < kCross; ++i) store(out.cross[i], cross[i]);
  }
  // The masks were subtracted: each lane holds a positive count.
  out.inliers = -count(inliers);
  out.met = -count(met);
  out.live = -count(live);
}

static void accumulate_row(const RowJob& job, RowSums& out) noexcept {
  accumulate_row_impl<false>(job, out);
}
static void accumulate_row_cross(const RowJob& job, RowSums& out) noexcept {
  accumulate_row_impl<true>(job, out);
}

static void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                          int radius, const EdgeRule& rule, float* out) noexcept {
  for (int u = 0; u < width; u += 8) {
    const F8 c = load(in + u);
    const F8 edge = splat(rule.base) + splat(rule.per_m) * c + splat(rule.per_m2) * c * c;
    const F8 inv = splat(1.0F) / (edge * edge);
    F8 sum = splat(0), total = splat(*weight);
    const float* w = weight + 1;
    for (int dv = 0; dv <= radius; ++dv) {
      const float* after = in + dv * stride + u;
      const float* before = in - dv * stride + u;
      for (int du = dv == 0 ? 1 : -radius; du <= radius; ++du, ++w) {
        const F8 za = load(after + du), zb = load(before - du);
        const F8 a = za - c, b = zb - c;
        const F8 a2 = a * a, b2 = b * b;
        F8 k = splat(1.0F) - (a2 < b2 ? b2 : a2) * inv;
        k = keep((k > splat(0)) & (za > splat(0)) & (zb > splat(0)), k * k * splat(*w));
        sum += k * (a + b);  // around the centre: no digits lost
        total += k + k;
      }
    }
    store(out + u, keep(c > splat(0), c + sum / total));
  }
}

static void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                       const float* y_factor, const EdgeRule& rule, float* out_x, float* out_y,
                       float* out_z) noexcept {
  for (int u = 0; u < width; u += 8) {
    const F8 c = load(z + u);
    const F8 l = load(z + u - 1), r = load(z + u + 1);
    const F8 t = load(z + u - stride), b = load(z + u + stride);
    const F8 noise = splat(rule.base) + splat(rule.per_m2) * c * c;
    const F8 step = noise + splat(rule.per_m) * c;
    I8 ok = (c > splat(0)) & (l > splat(0)) & (r > splat(0)) & (t > splat(0)) & (b > splat(0));
    ok &= (magnitude(l - c) < step) & (magnitude(r - c) < step) & (magnitude(t - c) < step) &
          (magnitude(b - c) < step);
    ok &= (magnitude(l + r - c - c) < noise) & (magnitude(t + b - c - c) < noise);
    const F8 xl = load(x_factor + u - 1), xc = load(x_factor + u), xr = load(x_factor + u + 1);
    const F8 ax = xr * r - xl * l, ay = splat(y_factor[0]) * (r - l), az = r - l;
    const F8 bx = xc * (b - t), by = splat(y_factor[1]) * b - splat(y_factor[-1]) * t, bz = b - t;
    const F8 nx = by * az - bz * ay, ny = bz * ax - bx * az, nz = bx * ay - by * ax;
    const F8 l2 = nx * nx + ny * ny + nz * nz;
    ok &= l2 > splat(0);
    const F8 inv = splat(1.0F) / root(ok ? l2 : splat(1.0F));
    store(out_x + u, keep(ok, nx * inv));
    store(out_y + u, keep(ok, ny * inv));
    store(out_z + u, keep(ok, nz * inv));
  }
}

static void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m,
                          float* out) noexcept {
  for (int u = 0; u < width; ++u) {
    const float z = static_cast<float>(mm[u]) / 1000.0F;
    out[u] = (z >= min_m && z <= max_m) ? z : 0.0F;
  }
}

static void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule,
                     float* out) noexcept {
  for (int u = 0; u < width; ++u) {
    const float* p = in + 2 * u;
    const float c = *p;
    const float noise = rule.base + rule.per_m2 * c * c;
    const float step = noise + rule.per_m * c;
    float sum = 0, n = 1;
    const std::ptrdiff_t pair[4] = {1, stride, stride + 1, stride - 1};
    for (const std::ptrdiff_t d : pair) {
      const float a = p[d] - c, b = p[-d] - c;
      const bool same = (a < step) & (a > -step) & (b < step) & (b > -step) & (a + b < noise) &
                        (a + b > -noise) & (p[d] > 0) & (p[-d] > 0);
      sum += same ? a + b : 0.0F;
      n += same ? 2.0F : 0.0F;
    }
    out[u] = c > 0 ? c + sum / n : 0.0F;
  }
}
