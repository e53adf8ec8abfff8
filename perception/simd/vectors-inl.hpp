// Names for vectors of up to 16 lanes, shared by the kernels of map, ray cast and colour.
// Included once per instruction set (Highway's way: no guard but the toggle).
#include <cstdint>

#if defined(TELETACT_VECTORS_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_VECTORS_TOGGLE
#undef TELETACT_VECTORS_TOGGLE
#else
#define TELETACT_VECTORS_TOGGLE
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace perception {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using MF = hn::Mask<DF>;

// Bit n: lane n.
HWY_INLINE unsigned bits_of(MF m) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(DF(), m, bytes);
  return static_cast<unsigned>(bytes[0]) | static_cast<unsigned>(bytes[1]) << 8U;
}

// Towards zero, of values within int range: what Highway adds for others is left out.
HWY_INLINE VI truncated(VF x) {
#if HWY_TARGET == HWY_AVX3
  return VI{_mm512_cvttps_epi32(x.raw)};
#elif HWY_TARGET == HWY_AVX2
  return VI{_mm256_cvttps_epi32(x.raw)};
#elif HWY_TARGET == HWY_SSE4
  return VI{_mm_cvttps_epi32(x.raw)};
#else
  return hn::ConvertTo(DI(), x);
#endif
}

HWY_INLINE VI floor_of(VF x) { return truncated(hn::Floor(x)); }

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
