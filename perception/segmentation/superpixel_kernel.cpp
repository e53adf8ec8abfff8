#include "perception/segmentation/superpixel_kernel.hpp"

#include <cmath>

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/segmentation/superpixel_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef TELETACT_SUPERPIXEL_KERNEL_ONCE
#define TELETACT_SUPERPIXEL_KERNEL_ONCE
namespace perception {
namespace {

constexpr int kColours = 3;  // planes

// Pixels u0 to u1 of row v.
void try_pixels(const SeedWindow& w, int v, int u0, int u1) noexcept {
  const float dv = static_cast<float>(v) - w.v, dv2 = dv * dv;
  const std::ptrdiff_t row = v * w.stride;
  for (int u = u0; u < u1; ++u) {
    float c2 = 0;
    for (int k = 0; k < w.plane_count; ++k) {
      const float e = w.planes[k][row + u] - w.plane[k];
      c2 += e * e;
      if (k == kColours - 1 && w.known != nullptr) c2 *= w.known[row + u] * w.seed_known;
    }
    const float du = static_cast<float>(u) - w.u;
    const float d = std::sqrt(c2) + w.beta * std::sqrt(du * du + dv2);
    if (!(d < w.best[row + u])) continue;
    w.best[row + u] = d;
    w.nearest[row + u] = w.id;
  }
}

}  // namespace
}  // namespace perception
#endif

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
// A window is some twenty pixels wide: wider vectors would mostly be tail.
using DF = hn::CappedTag<float, 8>;
using DI = hn::RebindToSigned<DF>;
using VF = hn::Vec<DF>;

template <int N, bool kAllKnown>
void try_rows(const SeedWindow& w) {
  const DF df;
  const DI di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  if (w.u1 - w.u0 < lanes) {
    for (int v = w.v0; v < w.v1; ++v) try_pixels(w, v, w.u0, w.u1);
    return;
  }
  VF seed[N];
  for (int k = 0; k < N; ++k) seed[k] = hn::Set(df, w.plane[k]);
  const VF seed_known = hn::Set(df, w.seed_known);
  const VF seed_u = hn::Set(df, w.u), beta = hn::Set(df, w.beta), count = hn::Iota(df, 0.0F);
  const auto id = hn::Set(di, w.id);
  for (int v = w.v0; v < w.v1; ++v) {
    const float dv = static_cast<float>(v) - w.v;
    const VF dv2 = hn::Set(df, dv * dv);
    const std::ptrdiff_t row = v * w.stride;
    // The last vector begins early: to try a seed twice changes nothing.
    for (int at = w.u0;; at += lanes) {
      const int u = at + lanes <= w.u1 ? at : w.u1 - lanes;
      VF c2 = hn::Zero(df);
      for (int k = 0; k < N; ++k) {
        const VF e = hn::Sub(hn::LoadU(df, w.planes[k] + row + u), seed[k]);
        c2 = hn::Add(c2, hn::Mul(e, e));
        if (!kAllKnown && k == kColours - 1)
          c2 = hn::Mul(c2, hn::Mul(hn::LoadU(df, w.known + row + u), seed_known));
      }
      const VF du = hn::Sub(hn::Add(hn::Set(df, static_cast<float>(u)), count), seed_u);
      const VF away = hn::Sqrt(hn::Add(hn::Mul(du, du), dv2));
      const VF d = hn::Add(hn::Sqrt(c2), hn::Mul(beta, away));
      const VF best = hn::LoadU(df, w.best + row + u);
      const auto nearer = hn::Lt(d, best);
      hn::StoreU(hn::IfThenElse(nearer, d, best), df, w.best + row + u);
      const auto nearest = hn::LoadU(di, w.nearest + row + u);
      hn::StoreU(hn::IfThenElse(hn::RebindMask(di, nearer), id, nearest), di, w.nearest + row + u);
      if (at + lanes >= w.u1) break;
    }
  }
}

void try_seed_rows(const SeedWindow& w) {
  const bool all = w.known == nullptr;
  if (w.plane_count == 3)
    all ? try_rows<3, true>(w) : try_rows<3, false>(w);
  else
    all ? try_rows<4, true>(w) : try_rows<4, false>(w);
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {
HWY_EXPORT(try_seed_rows);
}  // namespace

void try_seed_scalar(const SeedWindow& w) noexcept {
  for (int v = w.v0; v < w.v1; ++v) try_pixels(w, v, w.u0, w.u1);
}

void try_seed(const SeedWindow& w) noexcept {
  if (simd::chosen() == simd::Isa::kScalar) return try_seed_scalar(w);
  HWY_DYNAMIC_DISPATCH(try_seed_rows)(w);
}

}  // namespace perception
#endif
