#include "perception/segmentation/lab_kernel.hpp"

#include <cstddef>

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/segmentation/lab_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/simd/vectors-inl.hpp"

#ifndef TELETACT_LAB_KERNEL_ONCE
#define TELETACT_LAB_KERNEL_ONCE
namespace perception {
namespace {

constexpr float share_of(int row, int channel) noexcept {
  return static_cast<float>(kLabXyz[row][channel]);
}

void convert_pixel(const float* curve, const LabRow& row, int i) noexcept {
  float f[3];
  for (int k = 0; k < 3; ++k) {
    const float t =
        share_of(k, 0) * row.red[i] + share_of(k, 1) * row.green[i] + share_of(k, 2) * row.blue[i];
    const float x = (t < 1 ? t : 1.0F) * kLabCurveSteps;
    const int n = static_cast<int>(x);
    const float share = x - static_cast<float>(n), c = curve[n];
    f[k] = c + share * (curve[n + 1] - c);
  }
  row.L[i] = 116 * f[1] - 16;
  row.a[i] = 500 * (f[0] - f[1]);
  row.b[i] = 200 * (f[1] - f[2]);
}

}  // namespace
}  // namespace perception
#endif

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

HWY_INLINE VF set(float x) { return hn::Set(DF(), x); }

void convert_rows(const float* curve, const LabRow& row) {
  const DF df;
  const DI di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  if (row.count < lanes) {
    for (int i = 0; i < row.count; ++i) convert_pixel(curve, row, i);
    return;
  }
  // The last vector begins early and converts some pixels again.
  for (int at = 0;; at += lanes) {
    const int i = at + lanes <= row.count ? at : row.count - lanes;
    const VF r = hn::LoadU(df, row.red + i), g = hn::LoadU(df, row.green + i),
             b = hn::LoadU(df, row.blue + i);
    VF f[3];
    for (int k = 0; k < 3; ++k) {
      const VF t =
          hn::Add(hn::Add(hn::Mul(set(share_of(k, 0)), r), hn::Mul(set(share_of(k, 1)), g)),
                  hn::Mul(set(share_of(k, 2)), b));
      const VF x = hn::Mul(hn::Min(t, set(1.0F)), set(static_cast<float>(kLabCurveSteps)));
      const auto n = hn::ConvertTo(di, x);
      const VF share = hn::Sub(x, hn::ConvertTo(df, n));
      const VF c = hn::GatherIndex(df, curve, n), next = hn::GatherIndex(df, curve + 1, n);
      f[k] = hn::Add(c, hn::Mul(share, hn::Sub(next, c)));
    }
    hn::StoreU(hn::Sub(hn::Mul(set(116.0F), f[1]), set(16.0F)), df, row.L + i);
    hn::StoreU(hn::Mul(set(500.0F), hn::Sub(f[0], f[1])), df, row.a + i);
    hn::StoreU(hn::Mul(set(200.0F), hn::Sub(f[1], f[2])), df, row.b + i);
    if (at + lanes >= row.count) break;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {
HWY_EXPORT(convert_rows);
}  // namespace

void convert_light_scalar(const float* curve, const LabRow& row) noexcept {
  for (int i = 0; i < row.count; ++i) convert_pixel(curve, row, i);
}

void convert_light(const float* curve, const LabRow& row) noexcept {
  if (simd::chosen() == simd::Isa::kScalar) return convert_light_scalar(curve, row);
  HWY_DYNAMIC_DISPATCH(convert_rows)(curve, row);
}

}  // namespace perception
#endif
