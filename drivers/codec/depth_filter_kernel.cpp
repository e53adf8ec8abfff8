#include "drivers/codec/depth_filter_kernel.hpp"

#include <array>

// The same targets as perception/simd/targets.hpp: highway's choice is one for the program.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "drivers/codec/depth_filter_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "drivers/codec/depth_filter_rules-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace drivers::codec {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// The rules of depth_filter.hpp for as many pixels as D has lanes, all branches computed and then
// chosen from. U: points and the like, without sign; I: differences of such.
template <class D, bool kQuiet>
class Judge {
 public:
  using DI = hn::RebindToSigned<D>;
  using U = hn::Vec<D>;
  using I = hn::Vec<DI>;
  using M = hn::Mask<DI>;

  HWY_INLINE Judge(const FilterRow& row, const FilterLaw& law) : r_(row), law_(law) {}

  // From pixel i on; a lane for each, 1: restless.
  HWY_INLINE U pixels(std::size_t i) const {
    const U x = load(r_.reading + i), y = load(r_.points + i), age = load(r_.age + i);
    const U most = load(r_.most + i), mean = load(r_.mean + i);
    const I zero = hn::Zero(DI());
    const M absent = hn::Eq(as_signed(x), zero), was_absent = hn::Eq(as_signed(y), zero);
    const M unknown = hn::Eq(as_signed(age), zero);
    const M new_here = hn::And(unknown, was_absent);
    const U a = select(new_here, set(kUnknownDeviation), load(r_.above + i));
    const U b = select(new_here, set(kUnknownDeviation), load(r_.below + i));
    const I off = hn::Sub(as_signed(x), as_signed(mean));
    const U gate = gate_of(a, b, most);
    const M jumps = hn::Or(unknown, hn::Gt(hn::Abs(off), as_signed(gate)));

    const U older = hn::Min(hn::Add(age, set(1)), set(kMostAge));
    const Mean now = moved({mean, load(r_.fraction + i)}, off, share_of(older));
    const U level = hn::Add(now.point, hn::ShiftRight<kFilterFraction - 1>(now.fraction));
    const U bound = kQuiet ? stays_within(D(), age, gate, most) : set(law_.bound);
    const I debt = hn::LoadU(DI(), r_.debt + i);
    const Goal goal = goal_of(i, x, y, was_absent, level, bound, older, debt);
    const I within = as_signed(hn::SaturatedSub(bound, set(law_.half_step)));
    const I shown = hn::IfThenElse(goal.holds, as_signed(y), goal.point);
    const I wanted = hn::Max(
        hn::Min(hn::Max(shown, hn::Sub(as_signed(x), within)), hn::Add(as_signed(x), within)),
        hn::Set(DI(), 1));

    const M keeps = hn::Or(absent, jumps);
    store(select(keeps, a, followed(a, hn::Max(off, zero))), r_.above + i);
    store(select(keeps, b, followed(b, hn::Max(hn::Neg(off), zero))), r_.below + i);
    store(select(jumps, x, now.point), r_.mean + i);
    store(clear_where(jumps, now.fraction), r_.fraction + i);
    hn::StoreU(hn::IfThenZeroElse(jumps, debt), DI(), r_.debt + i);
    store(clear_where(absent, select(jumps, set(1), older)), r_.age + i);
    store(clear_where(absent, select(jumps, x, hn::BitCast(D(), wanted))), r_.target + i);
    const I due = hn::IfThenZeroElse(absent, one_where(hn::Or(jumps, hn::Not(goal.holds))));
    const hn::Rebind<std::uint8_t, DI> bytes;
    hn::StoreU(hn::DemoteTo(bytes, due), bytes, r_.due + i);
    const I restless = hn::IfThenElse(absent, one_where(hn::Not(was_absent)), one_where(jumps));
    return hn::BitCast(D(), restless);
  }

 private:
  struct Mean {
    U point, fraction;
  };
  struct Goal {
    I point;
    M holds;  // what was shown before stays
  };

  static HWY_INLINE U load(const std::uint16_t* p) { return hn::LoadU(D(), p); }
  static HWY_INLINE void store(U v, std::uint16_t* p) { hn::StoreU(v, D(), p); }
  static HWY_INLINE U set(int v) { return hn::Set(D(), static_cast<std::uint16_t>(v)); }
  static HWY_INLINE I as_signed(U v) { return hn::BitCast(DI(), v); }
  static HWY_INLINE U select(M m, U yes, U no) {
    return hn::IfThenElse(hn::RebindMask(D(), m), yes, no);
  }
  static HWY_INLINE U clear_where(M m, U v) {
    return hn::IfThenZeroElse(hn::RebindMask(D(), m), v);
  }
  static HWY_INLINE I one_where(M m) { return hn::IfThenElseZero(m, hn::Set(DI(), 1)); }
  static HWY_INLINE U distance(U a, U b) {
    return hn::BitCast(D(), hn::Abs(hn::Sub(as_signed(a), as_signed(b))));
  }

  HWY_INLINE U gate_of(U above, U below, U most) const {
    // From kEnough on the gate is the bound whatever the rules say.
    constexpr int kEnough = (1 << 14) - 1;
    const U spread = spread_of(hn::Min(above, set(kEnough)), hn::Min(below, set(kEnough)));
    const U own = hn::MulHigh(spread, set(kGateQuarters << (16 - kFilterFraction - 2)));
    return hn::Min(hn::Max(own, set(law_.least_gate)), most);
  }

  // A mean deviation moved by a part towards `seen` points, rounded down.
  static HWY_INLINE U followed(U deviation, I seen) {
    const U to = hn::ShiftLeft<kFilterFraction>(hn::BitCast(D(), seen));
    const U up = hn::ShiftRight<kFollow>(hn::SaturatedSub(to, deviation));
    const U down =
        hn::ShiftRight<kFollow>(hn::Add(hn::SaturatedSub(deviation, to), set((1 << kFollow) - 1)));
    return hn::Sub(hn::Add(deviation, up), down);
  }

  // 65536 / age, rounded down, for ages from 2 on: of an age of 1 the mean is the reading.
  static HWY_INLINE U share_of(U age) {
    if (hn::AllTrue(D(), hn::Eq(age, set(kMostAge)))) return set(65536 / kMostAge);
    static constexpr std::array<std::uint16_t, kMostAge + 1> kShare = [] {
      std::array<std::uint16_t, kMostAge + 1> t{};
      for (int n = 2; n <= kMostAge; ++n)
        t[static_cast<std::size_t>(n)] = static_cast<std::uint16_t>(65536 / n);
      return t;
    }();
    HWY_ALIGN std::uint16_t lanes[hn::MaxLanes(D())];
    hn::Store(age, D(), lanes);
    for (std::uint16_t& lane : lanes) lane = kShare[lane];
    return hn::Load(D(), lanes);
  }

  // The mean with one reading more that lies `off` points above mean.point, at most kMostBound. It
  // moves by (off - fraction) * share, rounded down; the factor's size is taken apart from its sign
  // so that both factors fit 16 bits. The bias keeps the sum positive.
  static HWY_INLINE Mean moved(Mean mean, I off, U share) {
    constexpr int kBias = 127, kOne = 1 << kFilterFraction;
    static_assert(kMostBound * kOne / 2 + kOne < kBias * kOne);
    const M rises = hn::Gt(off, hn::Zero(DI()));
    const U size = hn::ShiftLeft<kFilterFraction>(hn::BitCast(D(), hn::Abs(off)));
    const U way = select(rises, hn::Sub(size, mean.fraction), hn::Add(size, mean.fraction));
    const U whole = hn::MulHigh(way, share);
    const M exact = hn::Eq(as_signed(hn::Mul(way, share)), hn::Zero(DI()));
    const I rounded_up = hn::Add(as_signed(whole), hn::IfThenZeroElse(exact, hn::Set(DI(), 1)));
    const U by = select(rises, whole, hn::BitCast(D(), hn::Neg(rounded_up)));
    const U sum = hn::Add(hn::Add(mean.fraction, set(kBias * kOne)), by);
    return {hn::Sub(hn::Add(mean.point, hn::ShiftRight<kFilterFraction>(sum)), set(kBias)),
            hn::And(sum, set(kOne - 1))};
  }

  HWY_INLINE Goal goal_of(std::size_t i, U x, U y, M was_absent, U level, U bound, U older,
                          I debt_before) const {
    const M near = hn::Not(hn::Gt(as_signed(distance(x, y)), as_signed(bound)));
    const M stays = hn::AndNot(was_absent, near);
    if constexpr (!kQuiet) return {as_signed(level), stays};
    const M old = hn::Eq(as_signed(older), hn::Set(DI(), kMostAge));
    const I debt = hn::Sub(hn::Add(debt_before, as_signed(x)), as_signed(level));
    const auto part = [&](auto log2) {
      constexpr int kLog2 = decltype(log2)::value;
      return hn::ShiftRight<kLog2>(hn::Add(debt, hn::Set(DI(), 1 << kLog2 >> 1)));
    };
    const I share = hn::IfThenElse(old, part(std::integral_constant<int, kOldPeriod>()),
                                   part(std::integral_constant<int, kYoungPeriod>()));
    const I goal = hn::Add(as_signed(level), share);
    const U others = select(old, set((1 << kOldPeriod) - 1), set((1 << kYoungPeriod) - 1));
    const M turn = hn::Eq(as_signed(hn::And(load(r_.turns + i), others)), hn::Zero(DI()));
    const M waits = hn::Lt(hn::Abs(hn::Sub(goal, as_signed(y))), as_signed(set(law_.waits)));
    return {goal, hn::And(stays, hn::Or(hn::Not(turn), waits))};
  }

  const FilterRow& r_;
  const FilterLaw& law_;
};

template <class D, bool kQuiet>
HWY_INLINE std::size_t judge_from(std::size_t at, std::size_t width, const FilterRow& row,
                                  const FilterLaw& law, std::uint32_t& restless) {
  constexpr D d;
  const Judge<D, kQuiet> judge(row, law);
  auto sum = hn::Zero(d);
  for (; at + hn::Lanes(d) <= width; at += hn::Lanes(d)) sum = hn::Add(sum, judge.pixels(at));
  HWY_ALIGN std::uint16_t lanes[hn::MaxLanes(d)];
  hn::Store(sum, d, lanes);
  for (const std::uint16_t lane : lanes) restless += lane;
  return at;
}

// A vector is 8 pixels or more; what is left of a row is blocks of 8.
template <bool kQuiet>
HWY_INLINE std::uint32_t judge_row(const FilterRow& row, const FilterLaw& law, int width) {
  std::uint32_t restless = 0;
  const auto n = static_cast<std::size_t>(width);
  const std::size_t at =
      judge_from<hn::CappedTag<std::uint16_t, 32>, kQuiet>(0, n, row, law, restless);
  static_cast<void>(
      judge_from<hn::CappedTag<std::uint16_t, kBlock>, kQuiet>(at, n, row, law, restless));
  return restless;
}

std::uint32_t quiet_job(const FilterRow& row, const FilterLaw& law, int width) {
  return judge_row<true>(row, law, width);
}
std::uint32_t faithful_job(const FilterRow& row, const FilterLaw& law, int width) {
  return judge_row<false>(row, law, width);
}

}  // namespace HWY_NAMESPACE
}  // namespace drivers::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace drivers::codec {
namespace {
HWY_EXPORT(quiet_job);
HWY_EXPORT(faithful_job);
}  // namespace

std::uint32_t judge_quiet(const FilterRow& row, const FilterLaw& law, int width) noexcept {
  return HWY_DYNAMIC_DISPATCH(quiet_job)(row, law, width);
}
std::uint32_t judge_faithful(const FilterRow& row, const FilterLaw& law, int width) noexcept {
  return HWY_DYNAMIC_DISPATCH(faithful_job)(row, law, width);
}

}  // namespace drivers::codec
#endif
