// The list of cases, with what they must meet and the published figures of the peers (baseline:
// nearest point by the gradient of a trilinear 10 mm field, 1 / 10 Newton steps, simulated; CHAI3D
// 3.3.0 on meshes of the same shapes, measured).
#include <array>

#include "tools/measure/stability/cases.hpp"

namespace stability {

std::span<const Case> cases() {
  static constexpr std::array kCases{
      Case{1, "flat floor, slide", "J 0.12, tangential 0.03 N, depth 0.05 mm",
           "J 0.10 N, error 0.0 mm", "0.1 N saw-tooth at 500 Hz", &case_floor},
      Case{2, "concave corner", "J 0.15 (crease 0.33); field optimum",
           "J 0.16-0.22 / 0.13-0.14 N; 2.9-3.4 / 2.5 mm off", "0.11 N planes, 1.67-1.90 N meshed",
           &case_concave_corner},
      Case{3, "the same with friction", "J 0.25 (crease 0.33), friction never drops by 0.1 N",
           "no friction", "1.84-1.94 N; 3.73 N meshed with shading", &case_friction_corner},
      Case{4, "V groove 45 deg", "J 0.15 (crease 0.33); field optimum",
           "J 0.14-0.17 / 0.11 N; peak 6.8 / 15.5 N of 5.7", "not run", &case_groove},
      Case{5, "room corner", "J 0.15 (crease 0.33), release 2 ticks",
           "J 0.10-0.12 N; peak 9.3 / 16.3 N of 10.4", "trap of 94 ticks, 17.2 N",
           &case_room_corner},
      Case{6, "convex edge, slide off", "lateral only from 2 mm before, no re-entry",
           "lateral from 17.8-22 mm before; J 0.10-0.24 N", "1.8-7.6 N snaps", &case_convex_edge},
      Case{7, "press inside the rim", "within 5 deg, |F| = min(Kd, 12)",
           "turns sideways from 12 mm; J 0.14-0.37 N", "not run", &case_rim_press},
      Case{8, "plates 20, 10, 6 mm", "no flip, F = K depth; 6 mm may be flagged",
           "jumps 5.4-20 N, 6 mm not felt", "holds (static mesh)", &case_plates},
      Case{9, "slots 10, 5 mm", "bridges or both walls 1.5 mm, J 0.3",
           "3.6 mm off; 5 mm: jumps 3.9-12.5 N", "not run", &case_slots},
      Case{10, "saddle", "J 0.33 (curved), 0.3 mm, loop 0.2 mJ", "J 0.01-0.02 N, 0.1-0.2 mm",
           "0.64-1.9 N", &case_saddle},
      Case{11, "still hand, noisy stream", "1 mm: J 0.1; 3 mm: J 0.3; std 1.2 K sigma_z",
           "J 1.26-2.12; 3.7-6.7 N", "contact lost at the first update", &case_noise},
      Case{12, "surface steps 5 mm", "J 0.3, 50 ms, right side", "J 5.0 N",
           "lost; rigid dynamic 5.0 N", &case_step},
      Case{13, "surface rises 100 mm/s", "J 0.15, lag 40 ms, no loss", "J 3.3 N every 33 ms",
           "lost; rigid dynamic 3.3 N", &case_rise},
      Case{14, "object vanishes", "monotonic in 20-60 ms, J 0.5", "8.0 N in one tick", "not run",
           &case_vanish},
      Case{15, "60 mm deep press", "12 N along the entry normal, J 0.12", "force lost at 49-54 mm",
           "holds by construction", &case_deep_press},
      Case{16, "border of the observed", "lateral 0.2 N, J 0.3", "J 0.49 / 15.5-16.1 N",
           "cracks cured by the sphere", &case_border},
      Case{17, "start or re-enable inside", "J 0.3, full force in 30-100 ms", "8.0 N in one tick",
           "pushes from the start side only", &case_start_inside},
      Case{18, "friction: hold 10 s, slide", "creep 0.05 mm, slip step 0.58 N, reversal J 0.3",
           "none", "p99 jump 1.0 N in a noisy room", &case_friction_hold},
      Case{19, "bump texture", "amplitude 10 %, any loop 0.02 mJ, quiet at 0.3 N/mm", "none",
           "direction only, not conservative", &case_texture},
      Case{20, "closed loop", "quiet to 0.8 b/(T/2+t_d), E + booked >= -1 mJ, step 10 mJ",
           "case 12 injects 52 mJ", "-", &case_closed_loop},
  };
  return kCases;
}

}  // namespace stability
