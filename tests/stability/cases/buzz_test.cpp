// A proxy beside unknown space rests under a slow hand: it does not go to and fro between two
// places every tick. The field optimum judges nothing there, so the cases leave it out. On fused
// fields, at grazing views, where what is in front of a sheet is unknown and the projective field
// overstates a round tip most.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"

namespace {

using stability::Setting;

struct View {
  double incidence_deg, tip_radius_m;
  bool noise;
  std::size_t place;  // of rig::placements()
  int known = 0;      // ticks that it is known to buzz with all of a Kinect's noise
};

constexpr double kSlow_m_per_s = 0.02;  // 0.02 N a tick at 1 N/mm
constexpr double kLeast_N = 0.06;
// A rest that is found anew may turn back once.
constexpr int kMost = 2;

void judge(std::vector<stability::Run> (*runs)(const Setting&), const View& v, bool axial_alone,
           int& contact) {
  stability::FusedView view;
  view.axial_alone = axial_alone;
  view.incidence_deg = v.incidence_deg;
  view.noise = v.noise;
  Setting s{rig::placements()[v.place], kSlow_m_per_s};
  s.fused = &view;
  s.tip_radius_m = v.tip_radius_m;
  s.judged = false;
  for (const stability::Run& run : runs(s)) {
    const int buzz = stability::buzz_ticks(run.rows, kLeast_N);
    int touching = 0, held = 0;
    for (const rig::Row& row : run.rows) {
      touching += row.telemetry.in_contact ? 1 : 0;
      held += row.telemetry.held ? 1 : 0;
    }
    std::printf("  %d%s: %d of %d ticks, %d held\n", run.id, run.name.c_str(), buzz, touching,
                held);
    const int known = axial_alone ? 0 : v.known;
    EXPECT_LE(buzz, std::max(kMost, known)) << run.id << run.name;
    if (known > 0) {
      EXPECT_GT(buzz, kMost) << "met now, take it off: " << run.id << run.name;
    }
    contact += touching;
  }
}

// With axial noise alone, and with lateral noise, drop-outs and flying pixels besides.
void judge(std::vector<stability::Run> (*runs)(const Setting&), const View& v, int& contact) {
  judge(runs, v, true, contact);
  if (v.noise) judge(runs, v, false, contact);
}

TEST(Buzz, NoneOnASaddleBesideUnknownSpace) {
  constexpr View kViews[] = {
      {70, 0.003, false, 3}, {70, 0.003, true, 0, 49}, {60, 0.003, false, 7},
      {60, 0.003, true, 3},  {60, 0.0015, false, 3},   {80, 0.003, true, 3},
      {80, 0.003, false, 5}, {60, 0.003, false, 1},    {80, 0.0015, true, 5},
      {60, 0, true, 7},      {45, 0.003, false, 7},
  };
  int contact = 0;
  for (const View& v : kViews) judge(stability::case_saddle, v, contact);
  EXPECT_GT(contact, 40000);
}

TEST(Buzz, NoneOnEdgesAndCorners) {
  int contact = 0;
  for (const View& v : {View{70, 0.003, false, 3}, View{80, 0.0015, true, 5}}) {
    judge(stability::case_concave_corner, v, contact);
    judge(stability::case_room_corner, v, contact);
    judge(stability::case_convex_edge, v, contact);
    judge(stability::case_rim_press, v, contact);
  }
  EXPECT_GT(contact, 30000);
}

}  // namespace
