#include "perception/icp/kernels.hpp"

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/icp/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/icp/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception::icp {
namespace HWY_NAMESPACE {

// Without vectors of 16 bytes at least (a processor older than SSE4): the reference itself.
#if HWY_TARGET == HWY_SCALAR
void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                   int radius, const EdgeRule& rule, float* out) {
  kScalarKernels.bilateral_row(in, stride, width, weight, radius, rule, out);
}
void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x, const float* y,
                const EdgeRule& rule, float* nx, float* ny, float* nz) {
  kScalarKernels.normal_row(z, stride, width, x, y, rule, nx, ny, nz);
}
void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
  kScalarKernels.to_metres_row(mm, width, min_m, max_m, out);
}
void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
  kScalarKernels.half_row(in, stride, width, rule, out);
}
#else

// The filter of one vector. kMissing: neighbours without a reading must be excluded; otherwise they
// are beyond the depth edge of every pixel here.
template <bool kMissing>
HWY_INLINE V bilateral(const float* in, std::ptrdiff_t stride, const float* weight, int radius, V c,
                       V inv) {
  V sum = zero(), half = set(0.5F * *weight);  // half of the weights: twice that is exact
  const float* w = weight + 1;
  for (int dv = 0; dv <= radius; ++dv) {
    const float* after = in + dv * stride;
    const float* before = in - dv * stride;
    for (int du = dv == 0 ? 1 : -radius; du <= radius; ++du, ++w) {
      const V za = load(after + du), zb = load(before - du);
      const V a = sub(za, c), b = sub(zb, c);
      const V k = hn::Max(sub(set(1.0F), mul(hn::Max(mul(a, a), mul(b, b)), inv)), zero());
      V share = mul(mul(k, k), set(*w));
      if constexpr (kMissing) share = keep(hn::And(hn::Gt(za, zero()), hn::Gt(zb, zero())), share);
      sum = add(sum, mul(share, add(a, b)));  // around the centre: no digits lost
      half = add(half, share);
    }
  }
  return add(c, hn::Div(sum, add(half, half)));
}

void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                   int radius, const EdgeRule& rule, float* out) {
  const DF df;
  for (int u = 0; u < width; u += kWidth) {
    const V c = load(in + u);
    const M reading = hn::Gt(c, zero());
    if (hn::AllFalse(df, reading)) {
      hn::StoreU(zero(), df, out + u);
      continue;
    }
    const V edge =
        add(add(set(rule.base), mul(set(rule.per_m), c)), mul(mul(set(rule.per_m2), c), c));
    const V inv = hn::Div(set(1.0F), mul(edge, edge));
    // No reading is 0: from c it differs by c.
    const M far_from_0 = hn::Lt(edge, mul(set(0.9F), c));
    const V z = hn::AllFalse(df, hn::AndNot(far_from_0, reading))
                    ? bilateral<false>(in + u, stride, weight, radius, c, inv)
                    : bilateral<true>(in + u, stride, weight, radius, c, inv);
    hn::StoreU(keep(reading, z), df, out + u);
  }
}

void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                const float* y_factor, const EdgeRule& rule, float* out_x, float* out_y,
                float* out_z) {
  const DF df;
  const auto within = [](V a, V limit) { return hn::Lt(hn::Abs(a), limit); };
  for (int u = 0; u < width; u += kWidth) {
    const V c = load(z + u), l = load(z + u - 1), r = load(z + u + 1);
    const V t = load(z + u - stride), b = load(z + u + stride);
    const V noise = add(set(rule.base), mul(mul(set(rule.per_m2), c), c));
    const V step = add(noise, mul(set(rule.per_m), c));
    M ok = hn::Gt(c, zero());
    for (const V side : {l, r, t, b})
      ok = hn::And(ok, hn::And(hn::Gt(side, zero()), within(sub(side, c), step)));
    ok = hn::And(ok, hn::And(within(sub(sub(add(l, r), c), c), noise),
                             within(sub(sub(add(t, b), c), c), noise)));
    const V xl = load(x_factor + u - 1), xc = load(x_factor + u), xr = load(x_factor + u + 1);
    const V az = sub(r, l), bz = sub(b, t);
    const V ax = sub(mul(xr, r), mul(xl, l)), ay = mul(set(y_factor[0]), az);
    const V bx = mul(xc, bz), by = sub(mul(set(y_factor[1]), b), mul(set(y_factor[-1]), t));
    const V nx = sub(mul(by, az), mul(bz, ay)), ny = sub(mul(bz, ax), mul(bx, az)),
            nz = sub(mul(bx, ay), mul(by, ax));
    const V l2 = add(add(mul(nx, nx), mul(ny, ny)), mul(nz, nz));
    ok = hn::And(ok, hn::Gt(l2, zero()));
    const V inv = hn::Div(set(1.0F), hn::Sqrt(hn::IfThenElse(ok, l2, set(1.0F))));
    hn::StoreU(keep(ok, mul(nx, inv)), df, out_x + u);
    hn::StoreU(keep(ok, mul(ny, inv)), df, out_y + u);
    hn::StoreU(keep(ok, mul(nz, inv)), df, out_z + u);
  }
}

void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
  const DF df;
  const DI di;
  const hn::Rebind<std::uint16_t, DF> dm;
  int u = 0;
  for (; u + kWidth <= width; u += kWidth) {
    const V z = hn::Div(hn::ConvertTo(df, hn::PromoteTo(di, hn::LoadU(dm, mm + u))), set(1000.0F));
    hn::StoreU(keep(hn::And(hn::Ge(z, set(min_m)), hn::Le(z, set(max_m))), z), df, out + u);
  }
  kScalarKernels.to_metres_row(mm + u, width - u, min_m, max_m, out + u);
}

void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
  const DF df;
  int u = 0;
  for (; u + kWidth <= width; u += kWidth) {
    // Columns 2u - 1, 2u, 2u + 1 of the rows above, at and below.
    V left[3], mid[3], right[3], spare;
    for (int r = 0; r < 3; ++r) {
      const float* p = in + (r - 1) * stride + 2 * u;
      hn::LoadInterleaved2(df, p, mid[r], right[r]);
      hn::LoadInterleaved2(df, p - 1, left[r], spare);
    }
    const V c = mid[1];
    const V noise = add(set(rule.base), mul(mul(set(rule.per_m2), c), c));
    const V step = add(noise, mul(set(rule.per_m), c));
    V sum = zero(), n = set(1.0F);
    const V pair[4][2] = {
        {right[1], left[1]}, {mid[2], mid[0]}, {right[2], left[0]}, {left[2], right[0]}};
    for (const auto& p : pair) {
      const V a = sub(p[0], c), b = sub(p[1], c), both = add(a, b);
      const M same = hn::And(hn::And(hn::And(hn::Lt(hn::Abs(a), step), hn::Lt(hn::Abs(b), step)),
                                     hn::Lt(hn::Abs(both), noise)),
                             hn::And(hn::Gt(p[0], zero()), hn::Gt(p[1], zero())));
      sum = add(sum, keep(same, both));
      n = add(n, keep(same, set(2.0F)));
    }
    hn::StoreU(keep(hn::Gt(c, zero()), add(c, hn::Div(sum, n))), df, out + u);
  }
  kScalarKernels.half_row(in + 2 * u, stride, width - u, rule, out + u);
}

#endif  // HWY_TARGET
}  // namespace HWY_NAMESPACE
}  // namespace perception::icp
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception::icp {
namespace {

HWY_EXPORT(bilateral_row);
HWY_EXPORT(normal_row);
HWY_EXPORT(to_metres_row);
HWY_EXPORT(half_row);

const Kernels kVectorKernels{
    accumulate_vectors,
    accumulate_squares_vectors,
    [](const float* in, std::ptrdiff_t stride, int width, const float* weight, int radius,
       const EdgeRule& rule, float* out) {
      HWY_DYNAMIC_DISPATCH(bilateral_row)(in, stride, width, weight, radius, rule, out);
    },
    [](const float* z, std::ptrdiff_t stride, int width, const float* x, const float* y,
       const EdgeRule& rule, float* nx, float* ny, float* nz) {
      HWY_DYNAMIC_DISPATCH(normal_row)(z, stride, width, x, y, rule, nx, ny, nz);
    },
    [](const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
      HWY_DYNAMIC_DISPATCH(to_metres_row)(mm, width, min_m, max_m, out);
    },
    [](const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
      HWY_DYNAMIC_DISPATCH(half_row)(in, stride, width, rule, out);
    }};

}  // namespace

const Kernels& kernels() noexcept {
  return simd::chosen() == simd::Isa::kScalar ? kScalarKernels : kVectorKernels;
}

}  // namespace perception::icp
#endif
