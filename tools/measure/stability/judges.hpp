// Judges of the hard cases: figures of a trace, made of hand, proxy, force and field alone, without
// anything the renderer says of itself but its gain and the share of its blend.
//
// Frames: S of the solid, W of the grid.  SI.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "tools/measure/stability/cases.hpp"

namespace stability {

// RMS of the force above 100 Hz, N: Butterworth high-pass of second order, 1 kHz, its first 50
// ticks left out.
[[nodiscard]] double chatter_N(std::span<const rig::Vec3> force);
[[nodiscard]] std::vector<rig::Vec3> forces_of(std::span<const rig::Row> rows);

// The greatest of a figure over the run, and over the field optimum's places of the same run; and
// row by row, beside the optimum's greatest from shortly before to shortly after: 1 mm of the
// hand's way, and before it also the ticks that the slew guard may be behind. On fused fields only
// where the optimum judges: what is unknown holds no surface. NaN: nothing there.
struct Worst {
  double ours = 0, optimum = 0;
  std::vector<Pair> each;  // empty: there is no optimum
};
using Figure = std::function<double(const rig::Vec3& h, const rig::Vec3& p, const rig::Vec3& f)>;
[[nodiscard]] Worst worst_of(const Run& run, const Setting& s, const Figure& figure);
void add(Run& run, std::string name, const Worst& worst, double limit);
// The one that is farthest over the limit of those where the optimum is not as far.
[[nodiscard]] Pair farthest_alone(std::span<const Pair> each, double limit);

// Pop-through by the checker that shares nothing with the renderer. `side`: a single surface is
// touched, so the pull may not turn to its other side either; round a corner of 90 degrees and more
// it may.
void add_pops(Run& run, const rig::Rig& r, bool side);

// Most ticks in a row with the proxy, a tip of this radius, in the blended surface.
[[nodiscard]] int longest_inside(std::span<const rig::Row> rows, double radius_m);

// What is put into the spring by anything but the hand, from hand, proxy and gain of the trace:
// S(k) - S(k-1) + (F(k) + F(k-1)) . dh / 2, S the spring's energy with the force cut at 12 N. An
// event is one window's blend, and the fades while it lasts.
struct Injected {
  double sum_J = 0;     // of what came in
  double booked_J = 0;  // of what the renderer booked of it
  // The most of an event, and of 100 ms, up to any tick in which blend or fade went on at their
  // full rate: beyond the limits they have to be slower, at most half of it.
  double event_J = 0, power_J = 0;
  double whole_event_J = 0;
};
[[nodiscard]] Injected injected(std::span<const rig::Row> rows, double stiffness_N_per_m);
// 1 W over 100 ms, 50 mJ an event, and nothing of it left out of the books.
void add_injected(Run& run, double stiffness_N_per_m);

// Ticks in which the force before the guard turns by more than 90 degrees from one tick to the
// next, above 0.1 N. The optimum: from one of its places to the next.
[[nodiscard]] Worst reversals(const Run& run);

// Buzz under a slow hand: ticks in which the force before the guard goes back by more than
// `least_N` along the way that it went by as much in the tick before, within 60 degrees.
[[nodiscard]] int buzz_ticks(std::span<const rig::Row> rows, double least_N);

// How far a place is from where the samples are `radius_m` from the solid, m, at most 3 mm: the
// nearest change of side in 96 directions, steps of 0.05 mm. W.
[[nodiscard]] double off_zero_set_m(const support::ReferenceField& field, const rig::Vec3& p_W,
                                    double radius_m);
[[nodiscard]] double off_zero_set_m(const rig::Rig& r, const std::vector<rig::Row>& rows,
                                    std::size_t stride);

// The free place nearest to p_W on the samples, at most 3 mm off: the best of 400 directions, then
// closed in on to 0.002 rad. p_W itself where it is free, or nothing there is. W.
[[nodiscard]] rig::Vec3 nearest_free(const support::ReferenceField& field, const rig::Vec3& p_W,
                                     double radius_m);

// The groove line of the samples: in each plane across the groove, every mm along y, the lowest
// place that a tip reaches from above, by flooding free space in steps of 0.25 mm. S.
[[nodiscard]] std::vector<rig::Vec3> groove_line(const rig::Rig& r,
                                                 const std::vector<rig::Row>& rows, double top_m);
[[nodiscard]] double off_line_m(const std::vector<rig::Vec3>& line, const rig::Vec3& p);

// Ticks of case 4 in which a proxy of so many descent steps a tick is not where one is that takes
// all it needs.
[[nodiscard]] int groove_ticks_over(int iterations, const Setting& s);

// A force that comes back after forces were off: from rows.front() on it has to rise along +z
// within 30 to 100 ms to `full_N`, on that side.
void add_fade_in(Run& run, double full_N);

// Where a proxy with friction rests for a frictionless one at p_c, by the definition alone: circle
// on the plane across the
// pull, stick while |t| <= mu_s d, slip at mu_d d, stick again when the hand comes back.
class FrictionModel {
 public:
  FrictionModel(double mu_static, double mu_dynamic) : mu_s_(mu_static), mu_d_(mu_dynamic) {}
  [[nodiscard]] rig::Vec3 follow(const rig::Vec3& p_c, const rig::Vec3& h);
  void leave() { touching_ = slipping_ = false; }

 private:
  double mu_s_, mu_d_;
  bool touching_ = false, slipping_ = false;
  rig::Vec3 anchor_ = rig::Vec3::Zero();
};

}  // namespace stability
