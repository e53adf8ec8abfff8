// What the filter in time takes for noise of a pixel, and how near to a reading it shows it. These
// rules keep a pixel from lagging behind a surface that moves. A header of its own, so that a test
// can put false rules in its place. Vectors of 16 bits, one pixel a lane.
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

// A gate is so many quarters of the spread.
// chosen on: teletact bench codec seed 1; judged on: seeds 2, 3, 21 to 24
constexpr int kGateQuarters = 21;

// Of mean deviations up and down, any unit, below 2^14. Noise goes both ways: what exceeds the
// other side three times is motion.
template <class V>
HWY_INLINE V spread_of(V above, V below) {
  namespace hn = hwy::HWY_NAMESPACE;
  return hn::Min(hn::Add(above, below), hn::ShiftLeft<2>(hn::Min(above, below)));
}

// Quiet: most that a value shown before may lie off the reading, points. `age` readings are in the
// mean: a value that comes from few is replaced sooner.
template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V stays_within(D d, V age, V gate, V most) {
  namespace hn = hwy::HWY_NAMESPACE;
  const V quarter = hn::ShiftRight<2>(hn::Add(gate, hn::Set(d, 3)));  // rounded up
  const V young = hn::Sub(gate, quarter), grown = hn::Add(gate, hn::Set(d, kPointsPerSigma));
  return hn::Min(hn::IfThenElse(hn::Lt(age, hn::Set(d, 8)), young, grown), most);
}

}  // namespace HWY_NAMESPACE
}  // namespace drivers::codec
HWY_AFTER_NAMESPACE();

#endif
