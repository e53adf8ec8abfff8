#include "tools/measure/accuracy/press_error.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "rt/random.hpp"
#include "tools/measure/support/haptic_rig.hpp"

namespace teletact {

using perception::Pose;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

// Out of the solid, at a point outside it.
Vec3 normal_at(const drivers::World& world, const Vec3& p_W) {
  constexpr double kStep_m = 1e-5;
  Vec3 n;
  for (int a = 0; a < 3; ++a) {
    const Vec3 d = kStep_m * Vec3::Unit(a);
    n[a] = world.signed_distance(p_W + d) - world.signed_distance(p_W - d);
  }
  return n.normalized();
}

// In the frame of the map, N.
Vec3 pressed(FusionFeed& map, const Vec3& p_M, const Vec3& n_M, const PressOptions& o) {
  rig::Scene scene;
  scene.voxel = o.voxel_m, scene.truncation = o.truncation_m;
  scene.config.stiffness_N_per_m = o.stiffness_N_per_m;
  scene.config.tip_radius_m = 0;
  rig::Rig* hand = nullptr;
  scene.window = [&](const Vec3&, int, double, SurfacePatch& out) {
    const std::uint64_t seq = out.seq;
    const rt::Time fused = out.fused;
    map.in.hand = hand->out().state;
    if (map.in.hand.seq == 0) {
      map.in.hand.seq = 1;
      map.in.hand.p_WH = map.in.hand.p_WP = p_M + o.off_m * n_M;
    }
    map.look(out);
    out.seq = seq, out.fused = fused;
  };
  rig::Rig r(std::move(scene));
  hand = &r;
  const double way_m = o.off_m + o.depth_m, end_s = way_m / o.speed_m_per_s + o.hold_s;
  const auto path = [&](double t) -> Vec3 {
    return p_M + (o.off_m - std::min(way_m, o.speed_m_per_s * t)) * n_M;
  };
  return r.run(path, 0, end_s).back().f;
}

}  // namespace

std::vector<double> press_errors_N(FusionFeed& map, const Pose& X_WM, const drivers::World& world,
                                   std::span<const Vec3> surface_W, const PressOptions& o) {
  std::vector<std::size_t> order(surface_W.size());
  std::iota(order.begin(), order.end(), 0);
  rt::Random random(o.seed);
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1],
              order[static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(i) - 1))]);
  const Pose X_MW = X_WM.inverse(Eigen::Isometry);
  std::vector<double> errors;
  for (const std::size_t i : order) {
    if (std::ssize(errors) >= o.places) break;
    const Vec3& p_W = surface_W[i];
    const Vec3 n_W = normal_at(world, p_W);
    if (!n_W.allFinite() || world.signed_distance(p_W + o.off_m * n_W) < 0.9 * o.off_m) continue;
    const Vec3 end_W = p_W - o.depth_m * n_W;
    const Vec3 right_W = o.stiffness_N_per_m * std::max(0.0, -world.signed_distance(end_W)) * n_W;
    const Vec3 f_M = pressed(map, X_MW * p_W, X_MW.linear() * n_W, o);
    errors.push_back((X_WM.linear() * f_M - right_W).norm());
  }
  return errors;
}

}  // namespace teletact
