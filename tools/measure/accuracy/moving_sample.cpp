#include "tools/measure/accuracy/moving_sample.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "drivers/camera/render.hpp"
#include "perception/icp/degeneracy.hpp"
#include "tools/measure/accuracy/moving_plan.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr int kTries = 2000, kTriesOfOne = 500;
constexpr double kRobotFree_m = 0.35;  // round the camera: no furniture
constexpr double kMoverFree_m = 0.28;  // and no mover
constexpr double kSmallest_m = 0.06, kLargest_m = 2.0;
constexpr int kCoarse = 8;  // pixels, for the share

// Points of a solid, its own frame: a lattice of 5 x 5 x 5 on a box; of round ones the outline.
std::vector<Vec3> points_of(const drivers::Shape& s) {
  std::vector<Vec3> points;
  for (int i = 0; i < 125; ++i) {
    const int a = i % 5 - 2, b = i / 5 % 5 - 2, c = i / 25 - 2;
    Vec3 p(a, b, c);
    p /= 2;
    if (s.kind == drivers::Shape::Kind::kSphere && p.norm() > 0) p /= std::max(1.0, p.norm());
    if (s.kind == drivers::Shape::Kind::kCylinder) {
      p.head<2>() /= std::max(1.0, p.head<2>().norm());
    }
    points.push_back(p.cwiseProduct(s.half));
  }
  return points;
}

// Do two solids meet? By their points, to 20 mm.
bool meet(const drivers::World& w, int a, int b, rt::Time t) {
  const auto near = [&](int of, int to) {
    const Pose X_WS = w.X_WS_at(of, t);
    for (const Vec3& p_S : points_of(w.shapes()[static_cast<std::size_t>(of)])) {
      if (w.signed_distance(X_WS * p_S, to, t) < 0.02) return true;
    }
    return false;
  };
  const auto& sa = w.shapes()[static_cast<std::size_t>(a)];
  const auto& sb = w.shapes()[static_cast<std::size_t>(b)];
  const double apart = (w.X_WS_at(a, t).translation() - sb.X_WS.translation()).norm();
  if (apart > sa.bound_radius_m + sb.bound_radius_m + 0.02) return false;
  return near(a, b) || near(b, a);
}

template <class List>
void leave_out(const std::vector<std::string>& names, List& list) {
  std::erase_if(list, [&](const auto& shape) {
    return std::find(names.begin(), names.end(), shape.name) != names.end();
  });
}

}  // namespace

const char* name_of(MoverKind kind) {
  static constexpr std::array<const char*, kMoverKinds> names{"box",  "ball",   "person",
                                                              "door", "drawer", "arm"};
  return names[static_cast<std::size_t>(kind)];
}
const char* name_of(Carry carry) {
  static constexpr std::array<const char*, 3> names{"at rest", "by hand", "driving"};
  return names[static_cast<std::size_t>(carry)];
}
const char* name_of(MoverEnd end) {
  static constexpr std::array<const char*, 3> names{"goes out", "comes to rest", "back and forth"};
  return names[static_cast<std::size_t>(end)];
}

perception::Intrinsics MovingSample::camera() const {
  if (half_images) return {182.5, 182.5, 127.5, 105.5, 256, 212};
  return {365, 365, 255.5, 211.5, 512, 424};
}
drivers::DepthNoiseConfig moving_noise() { return {1.0, 0.3, 0.5, 0.02}; }

std::string MovingSample::text() const {
  const bool angular = kind == MoverKind::kDoor || kind == MoverKind::kArm;
  char line[200];
  std::snprintf(line, sizeof line,
                "%d: %s, %s of %.2f m at %.2f m, share %.3f, %.3g %s a frame %s, %s; camera %s; %d "
                "frames",
                index, room.c_str(), name_of(kind), size_m, distance_m, share, step,
                angular ? "deg" : "mm", from_rest ? "after rest" : "from the first", name_of(end),
                name_of(carry), frames);
  return line;
}

double mover_share(const drivers::World& world, const MovingSample& sample, int frame,
                   int pixel_step) {
  thread_local auto image = std::make_unique<perception::RgbdFrame>();
  rt::Startup startup;
  thread_local drivers::RenderScratch scratch(startup.token(), 256);
  scratch.shape.resize(perception::RgbdFrame::kMaxPixels);
  scratch.colour = false;
  const auto k = sample.camera().subsampled(pixel_step);
  drivers::render(world, k, sample.way.X_WC(frame * MovingSample::kFrame_s),
                  {kMovingNear_m, kMovingFar_m}, {}, 0, 0, scratch, *image,
                  MovingSample::time_of(frame));
  int valid = 0, mover = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(k.width * k.height); ++i) {
    if (image->depth_mm[i] == 0) continue;
    ++valid;
    mover += world.shapes()[static_cast<std::size_t>(scratch.shape[i])].mover >= 0 ? 1 : 0;
  }
  return valid > 0 ? static_cast<double>(mover) / valid : 0;
}

bool rest_constrains(const drivers::World& world, const MovingSample& sample, int frame) {
  constexpr int kStep = 12;
  const auto k = sample.camera();
  const Pose X_WC = sample.way.X_WC(frame * MovingSample::kFrame_s);
  const rt::Time t = MovingSample::time_of(frame);
  Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
  double weight = 0, depth = 0;
  for (int v = kStep / 2; v < k.height; v += kStep) {
    for (int u = kStep / 2; u < k.width; u += kStep) {
      const Vec3 ray = k.unproject(u, v, 1.0);
      const auto hit = world.ray_cast(X_WC.translation(), X_WC.linear() * ray, t);
      if (!hit || hit.t < kMovingNear_m || hit.t > kMovingFar_m) continue;
      if (world.shapes()[static_cast<std::size_t>(hit.shape)].mover >= 0) continue;
      const Vec3 n = X_WC.linear().transpose() * hit.normal_W, p = hit.t * ray;
      Eigen::Matrix<double, 6, 1> J;
      J << n, p.cross(n);
      H += J * J.transpose();
      weight += 1;
      depth += hit.t;
    }
  }
  if (!(weight > 100)) return false;
  perception::DegeneracyConfig config;
  config.min_information *= 3;
  return perception::analyse(H, H, weight, depth / weight, config).degenerate_count == 0;
}

bool make_way(rt::NonRealtime& nrt, const MovingSample& s, drivers::WorldConfig& room) {
  const drivers::World world(nrt, s.world, MovingSample::kBegin);
  std::vector<int> movers, fixed;
  std::vector<std::string> in_the_way;
  for (std::size_t i = 0; i < world.shapes().size(); ++i) {
    const auto& shape = world.shapes()[i];
    if (shape.mover >= 0) movers.push_back(static_cast<int>(i));
    if (shape.mover < 0 && shape.name.rfind("mover_", 0) != 0) fixed.push_back(static_cast<int>(i));
  }
  const int stride = std::clamp(static_cast<int>(100 / (s.step + 1)), 1, 10);
  for (int f = 0; f < s.frames; f += stride) {
    const rt::Time t = MovingSample::time_of(f);
    const Vec3 eye = s.way.X_WC(f * MovingSample::kFrame_s).translation();
    for (const int m : movers) {
      if (world.signed_distance(eye, m, t) < kMoverFree_m) return false;
    }
    for (const int i : fixed) {
      const auto& shape = world.shapes()[static_cast<std::size_t>(i)];
      const bool wall = shape.kind == drivers::Shape::Kind::kPlane;
      bool blocked = world.signed_distance(eye, i, t) < kRobotFree_m;
      for (const int m : movers) {
        if (wall) {
          const auto& mover = world.shapes()[static_cast<std::size_t>(m)];
          const Pose X_WS = world.X_WS_at(m, t);
          for (const Vec3& p_S : points_of(mover)) {
            if (world.signed_distance(X_WS * p_S, i, t) < 0) return false;
          }
        } else {
          blocked |= meet(world, m, i, t);
        }
      }
      if (blocked && wall) return false;
      if (blocked) in_the_way.push_back(shape.name);
    }
  }
  leave_out(in_the_way, room.boxes);
  leave_out(in_the_way, room.cylinders);
  leave_out(in_the_way, room.spheres);
  return true;
}

namespace {

double largest_share(rt::NonRealtime& nrt, const MovingSample& s, int frame_step, int pixel_step) {
  const drivers::World world(nrt, s.world, MovingSample::kBegin);
  double most = 0;
  for (int f = 0; f < s.frames; f += frame_step) {
    if (f > 0 && f + frame_step < s.first_moving && s.carry == Carry::kAtRest) continue;
    most = std::max(most, mover_share(world, s, f, pixel_step));
  }
  return most;
}

// The size at which the share is the plan's, of a person the distance; < 0: none.
double size_for(rt::NonRealtime& nrt, MovingPlan& plan, const drivers::WorldConfig& room) {
  const bool person = plan.kind == MoverKind::kPerson;
  const auto share = [&](double x) {
    if (person) plan.distance_m = x;
    return largest_share(nrt, build_sample(plan, room, person ? plan.person_m : x), 8, kCoarse);
  };
  double few = person ? 3.0 : kSmallest_m, many = person ? 0.5 : kLargest_m;
  if (share(many) < plan.share || (person && share(few) > plan.share)) return -1;
  for (int i = 0; i < 7; ++i) {
    const double middle = std::sqrt(few * many);
    (share(middle) < plan.share ? few : many) = middle;
  }
  if (person) plan.distance_m = many;
  return person ? plan.person_m : many;
}

bool acceptable(rt::NonRealtime& nrt, const MovingPlan& plan, bool low, MovingSample& s) {
  if (s.frames > 185 || s.last_moving < s.first_moving) return false;
  s.share = largest_share(nrt, s, 1, 6);
  if (!(s.share >= 0.02 && s.share <= 0.60) || low != s.low()) return false;
  if (std::abs(s.share - plan.share) > 0.12 * plan.share + 0.01) return false;
  const drivers::World world(nrt, s.world, MovingSample::kBegin);
  if (plan.end == MoverEnd::kGoesOut && mover_share(world, s, s.frames - 1, kCoarse) > 0) {
    return false;
  }
  if (plan.end == MoverEnd::kComesToRest && mover_share(world, s, s.frames - 1, kCoarse) < 0.01) {
    return false;
  }
  for (int f = 0; f < s.frames; f += 6) {
    if (!rest_constrains(world, s, f)) return false;
  }
  return true;
}

}  // namespace

MovingSample draw_moving_sample(rt::NonRealtime& nrt, std::uint64_t seed, int index) {
  rt::Random rng(seed, rt::mix64(0x6d6f76696e67ULL, static_cast<std::uint64_t>(index)));
  const auto kind = static_cast<MoverKind>(index % kMoverKinds);
  const bool low = (index / kMoverKinds + index) % 2 == 0;
  MovingKind of = draw_kind(rng, kind, low);
  for (int k = 1; k <= kTries; ++k) {
    if (k % kTriesOfOne == 0) of = draw_kind(rng, kind, low);
    MovingPlan plan = draw_plan(rng, of);
    std::string name;
    drivers::WorldConfig room = draw_room(rng, name);
    double size = size_for(nrt, plan, room);
    if (size < 0) continue;
    // What stood in the way may have hidden some of it.
    if (!make_way(nrt, build_sample(plan, room, size), room)) continue;
    size = size_for(nrt, plan, room);
    if (size < 0 || !make_way(nrt, build_sample(plan, room, size), room)) continue;
    MovingSample s = build_sample(plan, room, size);
    s.index = index, s.seed = seed, s.room = name;
    if (acceptable(nrt, plan, low, s)) return s;
  }
  throw std::runtime_error("moving sample " + std::to_string(index) + " of seed " +
                           std::to_string(seed) + ": none could be drawn");
}

}  // namespace teletact
