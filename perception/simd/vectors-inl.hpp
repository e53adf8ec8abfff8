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

HWY_INLINE VI floor_of(VF x) {
  const DI di;
  const DF df;
  const VI i = hn::ConvertTo(di, x);
  return hn::IfThenElse(hn::RebindMask(di, hn::Gt(hn::ConvertTo(df, i), x)),
                        hn::Sub(i, hn::Set(di, 1)), i);
}

}  // namespace HWY_NAMESPACE
}  // namespace perception
HWY_AFTER_NAMESPACE();

#endif
