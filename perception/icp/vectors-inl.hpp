// Short names for the vectors of ICP's kernels; none where the reference runs instead.
// Included once per instruction set (Highway's way: no guard but the toggle).

#if defined(TELETACT_ICP_VECTORS_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_ICP_VECTORS_TOGGLE
#undef TELETACT_ICP_VECTORS_TOGGLE
#else
#define TELETACT_ICP_VECTORS_TOGGLE
#endif

#include <hwy/highway.h>

#include "perception/icp/kernels.hpp"
#include "perception/simd/vectors-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace perception::icp {
namespace HWY_NAMESPACE {

#if HWY_TARGET != HWY_SCALAR
namespace hn = hwy::HWY_NAMESPACE;
using perception::HWY_NAMESPACE::truncated;
using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using DH = hn::Half<DF>;
using DD = hn::Rebind<double, DH>;
using D4 = hn::FixedTag<float, 4>;
using V = hn::Vec<DF>;
using M = hn::Mask<DF>;
constexpr int kWidth = static_cast<int>(hn::MaxLanes(DF()));  // lanes of a vector
static_assert(kLanes % kWidth == 0);

HWY_INLINE V set(float x) { return hn::Set(DF(), x); }
HWY_INLINE V zero() { return hn::Zero(DF()); }
HWY_INLINE V load(const float* p) { return hn::LoadU(DF(), p); }
HWY_INLINE V add(V a, V b) { return hn::Add(a, b); }
HWY_INLINE V sub(V a, V b) { return hn::Sub(a, b); }
HWY_INLINE V mul(V a, V b) { return hn::Mul(a, b); }
HWY_INLINE V keep(M m, V v) { return hn::IfThenElseZero(m, v); }
HWY_INLINE int count(M m) { return static_cast<int>(hn::CountTrue(DF(), m)); }
#endif

}  // namespace HWY_NAMESPACE
}  // namespace perception::icp
HWY_AFTER_NAMESPACE();

#endif
