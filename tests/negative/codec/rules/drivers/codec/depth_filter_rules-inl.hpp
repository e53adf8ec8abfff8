// False rules in the place of the product's: deviations to one side count as noise, and a value
// stays as long as the widest bound lets it. A pixel then lags behind a surface that moves.
// Included once per instruction set (Highway's way: no guard but the toggle).

#if defined(TELETACT_FILTER_RULES_TOGGLE) == defined(HWY_TARGET_TOGGLE)
#ifdef TELETACT_FILTER_RULES_TOGGLE
#undef TELETACT_FILTER_RULES_TOGGLE
#else
#define TELETACT_FILTER_RULES_TOGGLE
#endif

#include <hwy/highway.h>

#include "drivers/codec/depth_lattice.hpp"

HWY_BEFORE_NAMESPACE();
namespace drivers::codec {
namespace HWY_NAMESPACE {

constexpr int kGateQuarters = 21;

template <class V>
HWY_INLINE V spread_of(V above, V below) {
  return hwy::HWY_NAMESPACE::Add(above, below);
}

template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V stays_within(D d, V, V, V most) {
  namespace hn = hwy::HWY_NAMESPACE;
  return hn::Add(most, hn::Set(d, 16));
}

}  // namespace HWY_NAMESPACE
}  // namespace drivers::codec
HWY_AFTER_NAMESPACE();

#endif
