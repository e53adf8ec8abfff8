#include "tools/desk/intents/desk_bounds.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace teletact {

using perception::CostMap;
using perception::Vec3;

namespace {

// Of what a base on the floor can be asked to go to, and of what may stand there, above the floor.
constexpr double kHighest_m = 3, kLowest_m = -0.5;

std::string outside(const CostMap& map) {
  const double x_m = map.width * map.resolution, y_m = map.height * map.resolution;
  Eigen::AlignedBox3d box;
  for (const Vec3& corner : {Vec3(0, 0, 0), Vec3(x_m, 0, 0), Vec3(0, y_m, 0), Vec3(x_m, y_m, 0)})
    box.extend(map.X_WM * corner);
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(),
                "outside the map of the floor, which reaches x %.1f to %.1f, y %.1f to %.1f m",
                box.min().x(), box.max().x(), box.min().y(), box.max().y());
  return text.data();
}

bool known(const CostMap& map) { return map.seq != 0 && map.ground_found; }

bool over_map(const CostMap& map, const Vec3& p_M) {
  return p_M.x() >= 0 && p_M.y() >= 0 && p_M.x() < map.width * map.resolution &&
         p_M.y() < map.height * map.resolution;
}

std::string too_high(double above_m) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.1f m %s the floor", std::abs(above_m),
                above_m > 0 ? "above" : "below");
  return text.data();
}

}  // namespace

std::string beyond_map(const CostMap& map, std::span<const Vec3> places_W) {
  if (!known(map)) return {};
  const perception::Pose X_MW = map.X_WM.inverse();
  for (const Vec3& p_W : places_W) {
    const Vec3 p_M = X_MW * p_W;
    if (!over_map(map, p_M)) return outside(map);
    if (p_M.z() > kHighest_m || p_M.z() < kLowest_m) return too_high(p_M.z());
  }
  return {};
}

std::string beyond_floor(const CostMap& map, double x_W, double y_W) {
  if (!known(map)) return {};
  // The place on the floor above or below it.
  const Vec3 n_W = map.X_WM.linear().col(2), o_W = map.X_WM.translation();
  const double z =
      std::abs(n_W.z()) < 1e-6
          ? o_W.z()
          : o_W.z() - (n_W.x() * (x_W - o_W.x()) + n_W.y() * (y_W - o_W.y())) / n_W.z();
  const Vec3 p_M = map.X_WM.inverse() * Vec3(x_W, y_W, z);
  return over_map(map, p_M) ? std::string() : outside(map);
}

std::string beyond_map(const CostMap& map, const DrawnObstacle& o) {
  if (!known(map)) return {};
  const Vec3 p_M = map.X_WM.inverse() * o.centre_W;
  if (!over_map(map, p_M)) return outside(map);
  const double low = p_M.z() - o.half_m.z(), high = p_M.z() + o.half_m.z();
  if (low > kHighest_m || high < kLowest_m) return too_high(p_M.z());
  const double most = map.resolution * std::max(map.width, map.height) / 2;
  const double half = o.box ? std::max(o.half_m.x(), o.half_m.y()) : o.half_m.x();
  return half > most ? "larger than the map of the floor" : std::string();
}

std::optional<perception::Pose2> base_in_world(const OperatorView& seen) {
  const auto& r = seen.robot;
  const auto& w = seen.world;
  if (r.seq == 0 || !w.known) return std::nullopt;
  return perception::compose({w.X_WO[0], w.X_WO[1], w.X_WO[2]}, {r.x_m, r.y_m, r.yaw_rad});
}

std::uint16_t reaches_into(const std::map<std::uint16_t, DrawnObstacle>& drawn, double x_W,
                           double y_W, double radius_m) {
  for (const auto& [id, o] : drawn) {
    const double dx = x_W - o.centre_W.x(), dy = y_W - o.centre_W.y();
    double apart_m = std::hypot(dx, dy) - o.half_m.x();
    if (o.box) {
      const double c = std::cos(o.yaw_rad), s = std::sin(o.yaw_rad);
      apart_m = std::hypot(std::max(0.0, std::abs(c * dx + s * dy) - o.half_m.x()),
                           std::max(0.0, std::abs(c * dy - s * dx) - o.half_m.y()));
    }
    if (apart_m < radius_m) return id;
  }
  return 0;
}

bool KeepOutWatch::look(const std::map<std::uint16_t, DrawnObstacle>& drawn,
                        const perception::Pose2& base_W, const perception::Twist2& asked,
                        double radius_m) {
  const perception::Pose2 ahead_W =
      perception::compose(base_W, {asked.vx * kAhead_s, asked.vy * kAhead_s, asked.wz * kAhead_s});
  std::string text;
  if (const auto in = reaches_into(drawn, base_W.x, base_W.y, radius_m); in != 0)
    text = "The base is in keep-out " + std::to_string(in) + ".";
  else if (const auto next = reaches_into(drawn, ahead_W.x, ahead_W.y, radius_m); next != 0)
    text =
        "Keep-out " + std::to_string(next) + " is ahead: driven by hand, nothing stops the base.";
  const bool fresh = !text.empty() && text != text_;
  text_ = std::move(text);
  return fresh;
}

}  // namespace teletact
