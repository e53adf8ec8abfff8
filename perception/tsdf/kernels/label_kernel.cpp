#include "perception/tsdf/kernels/label_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

#include "perception/simd/isa.hpp"
#include "perception/simd/targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perception/tsdf/kernels/label_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "perception/tsdf/kernels/project_block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

using DH = hn::Rebind<std::uint16_t, DU>;
using MU = hn::Mask<DU>;

static_assert(sizeof(LabelVoxel) == 2);

// What the pixels of `near` say; kNoVote in the other lanes.
HWY_INLINE VU votes_of(const LabelImage& image, MF near, const std::uint32_t* pixel) {
  HWY_ALIGN std::uint32_t said[16];
  const DU du;
  hn::Store(hn::Set(du, static_cast<std::uint32_t>(kNoVote)), du, said);
  for (std::uint64_t m = bits_of(near); m != 0; m &= m - 1) {
    const auto n = static_cast<std::size_t>(__builtin_ctzll(m));
    const auto row = static_cast<std::ptrdiff_t>(pixel[n] >> 16U);
    said[n] = image.data[row * image.stride_px + static_cast<std::ptrdiff_t>(pixel[n] & 0xffffU)];
  }
  return hn::Load(du, said);
}

// One vector of voxels, the first of them number n.
HWY_INLINE void vote_group(const LabelImage& image, const Projected& seen_at, std::size_t n,
                           LabelVoxel* labels) {
  const DF df;
  const DU du;
  const DH dh;
  const auto u = [du](std::uint32_t x) { return hn::Set(du, x); };
  const VU reading = hn::Load(du, seen_at.reading + n);
  const VU depth = hn::And(reading, u(0xffffU));
  const MF seen = non_zero(depth);
  const VF dz = hn::Sub(mul(to_float(depth), set(0.001F)), hn::Load(df, seen_at.z + n));
  const VF sdf = mul(dz, hn::Sqrt(hn::Load(df, seen_at.stretch2 + n)));
  const VF reach = mul(to_float(hn::ShiftRight<24>(reading)), set(0.03125F));
  const VF band = mul(set(kLabelBand_m), hn::Min(reach, set(image.most_reach)));
  const MF fused = non_zero(hn::And(hn::ShiftRight<16>(reading), u(0xffU)));
  const MF near =
      hn::And(hn::And(seen, fused), hn::And(hn::Le(sdf, band), hn::Ge(sdf, hn::Neg(band))));
  const MF free_f = hn::And(seen, hn::Gt(sdf, mul(set(kLabelBand_m), reach)));
  if (hn::AllFalse(df, hn::Or(near, free_f))) return;

  auto* words = reinterpret_cast<std::uint16_t*>(labels + n);
  const VU old = hn::PromoteTo(du, hn::LoadU(dh, words));
  const VU label = hn::And(old, u(0xffU)), weight = hn::ShiftRight<8>(old);
  const VU said = votes_of(image, hn::Or(near, free_f), seen_at.pixel + n);
  const MU says = hn::Lt(said, u(kMostLabel + 1U));
  const MU votes = hn::And(says, hn::RebindMask(du, near));
  const VU zero = hn::Zero(du), one = u(1);
  const MU unlabelled = hn::Eq(label, zero), background = hn::Eq(said, zero);
  const MU front = hn::RebindMask(du, hn::Gt(sdf, set(kInFront_m)));
  const MU again =
      hn::And(hn::And(background, front), hn::And(hn::Gt(weight, one), hn::Not(unlabelled)));
  const MU touched =
      hn::And(hn::And(unlabelled, hn::Eq(said, u(image.fresh))), hn::Not(background));
  const VU w0 = hn::IfThenZeroElse(touched, weight);
  const VU w = hn::IfThenElse(again, hn::Sub(w0, one), w0);
  const MU none = hn::Eq(w, zero), same = hn::Eq(label, said);
  const MU flips = hn::Or(none, hn::AndNot(same, hn::Eq(w, one)));
  const VU more = hn::Min(hn::Add(w, one), u(kLabelWeightCap));
  const VU kept = hn::IfThenElse(same, more, hn::Sub(w, one));
  const VU voted_w = hn::IfThenElse(flips, one, kept);
  const VU voted_l = hn::IfThenElse(flips, said, label);
  const VU step = u(kFreeStep);
  const MU stays = hn::Gt(weight, step);
  const VU freed_w = hn::IfThenElseZero(stays, hn::Sub(weight, step));
  const VU freed_l = hn::IfThenElseZero(stays, label);
  const MU through = hn::RebindMask(du, hn::Gt(sdf, mul(set(kThrough_m), reach)));
  const MU free = hn::And(hn::RebindMask(du, free_f), hn::Or(through, hn::AndNot(same, says)));
  const VU new_w = hn::IfThenElse(free, freed_w, hn::IfThenElse(votes, voted_w, weight));
  const VU new_l = hn::IfThenElse(free, freed_l, hn::IfThenElse(votes, voted_l, label));
  const VU out = hn::Or(new_l, hn::ShiftLeft<8>(new_w));
  hn::StoreU(hn::DemoteTo(dh, hn::BitCast(DI(), out)), dh, words);
}

std::uint32_t vote_block_words(const UpdateCamera& c, const LabelImage& image, const float (&p0)[3],
                               LabelVoxel* labels) {
  Projected seen_at;
  VU any = hn::Zero(DU());
  project<false>(c, p0, seen_at, [&any](VU reading, std::size_t) { any = hn::Or(any, reading); });
  if (!hn::AllTrue(DU(), hn::Eq(any, hn::Zero(DU())))) {
    const std::size_t lanes = hn::Lanes(DF());
    for (std::size_t n = 0; n < 512; n += lanes) vote_group(image, seen_at, n, labels);
  }
  return labels_in(labels);
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace perception {
namespace {

HWY_EXPORT(vote_block_words);

}  // namespace

std::uint32_t labels_in(const LabelVoxel* labels) noexcept {
  // Four voxels at once: most are unlabelled, or labelled as those before them.
  constexpr std::uint64_t kLabels = 0x00ff00ff00ff00ffULL;
  static_assert(offsetof(LabelVoxel, label) == 0 && sizeof(LabelVoxel) == 2);
  std::uint64_t before = 0;
  std::uint32_t bits = 0;
  for (std::size_t n = 0; n < 512; n += 4) {
    std::uint64_t four = 0;
    std::memcpy(&four, labels + n, sizeof four);
    four &= kLabels;
    if (four == before) continue;
    before = four;
    for (std::size_t i = 0; i < 4; ++i) bits |= 1U << (labels[n + i].label & 31U);
  }
  return bits & ~1U;
}

std::uint32_t vote_block_scalar(const UpdateCamera& c, const LabelImage& image,
                                const float (&p0)[3], LabelVoxel* labels) noexcept {
  const ImageView<const std::uint8_t> view{image.data, c.width, c.height,
                                           static_cast<int>(image.stride_px)};
  for (std::size_t n = 0; n < 512; ++n) {
    float p[3];
    for (int a = 0; a < 3; ++a) p[a] = p0[a] + c.node[a][n];
    if (!(p[2] >= kLeastZ)) continue;
    const float inv = 1.0F / p[2], px = p[0] * inv, py = p[1] * inv;
    const float u = px * c.fx + c.cx_plus_half, v = py * c.fy + c.cy_plus_half;
    if (!(u >= 0 && v >= 0 && u < static_cast<float>(c.width) && v < static_cast<float>(c.height)))
      continue;
    const auto iu = static_cast<int>(u), iv = static_cast<int>(v);
    const std::uint32_t reading = c.pixels[iv * c.width + iu];
    const std::uint32_t depth_mm = reading & 0xffffU;
    if (depth_mm == 0) continue;
    const float sdf =
        (static_cast<float>(depth_mm) * 0.001F - p[2]) * std::sqrt((1.0F + px * px) + py * py);
    const bool fused = ((reading >> 16U) & 0xffU) != 0;
    const float reach = static_cast<float>(reading >> 24U) * 0.03125F;
    if (!fused && sdf <= kLabelBand_m) continue;
    const bool near = std::fabs(sdf) <= kLabelBand_m * std::min(reach, image.most_reach);
    const float within = near ? std::clamp(sdf, -kLabelBand_m, kLabelBand_m) : sdf;
    vote_at(labels[n], view, iu, iv, within, reach, image.fresh);
  }
  return labels_in(labels);
}

std::uint32_t vote_block(const UpdateCamera& c, const LabelImage& image, const float (&p0)[3],
                         LabelVoxel* labels) noexcept {
  if (simd::chosen() == simd::Isa::kScalar) return vote_block_scalar(c, image, p0, labels);
  return HWY_DYNAMIC_DISPATCH(vote_block_words)(c, image, p0, labels);
}

}  // namespace perception
#endif
