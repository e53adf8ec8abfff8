#include "tools/measure/accuracy/clutter_scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "rt/random.hpp"

namespace teletact {
namespace {

using perception::Rgb;
using perception::Vec3;

constexpr int kW = 640, kH = 480, kLeastSeen = 400;
const perception::Intrinsics kCamera{560, 560, 319.5, 239.5, kW, kH};

enum class Kind { kBox, kCan, kBall, kCup };

// Upright, turned about z by `turn`; `half`: half its size, of round things x is the radius.
struct Thing {
  Kind kind;
  Vec3 centre, half;
  double turn;
  std::array<Rgb, 2> colours;
  double pattern_m;  // edge of a square of its pattern; 0: plain
};

struct Hit {
  double t = 1e9;
  int thing = 0;                         // 0: table
  double slant = 1;                      // cosine of the angle at which the surface is seen
  Vec3 local{0, 0, 0}, normal{0, 0, 1};  // in the thing's frame
};

// o, d in the thing's frame, its centre at the origin.
void hit_box(const Thing& s, const Vec3& o, const Vec3& d, Hit& best) {
  double in = 0, out = 1e9;
  int axis = 0;
  for (int k = 0; k < 3; ++k) {
    const double a = (-s.half[k] - o[k]) / d[k], b = (s.half[k] - o[k]) / d[k];
    if (std::min(a, b) > in) in = std::min(a, b), axis = k;
    out = std::min(out, std::max(a, b));
  }
  if (!(in < out) || in <= 0 || in >= best.t) return;
  best.t = in, best.local = o + in * d;
  best.normal = Vec3::Zero();
  best.normal[axis] = d[axis] > 0 ? -1 : 1;
}

void hit_ball(const Thing& s, const Vec3& o, const Vec3& d, Hit& best) {
  const double a = d.squaredNorm(), b = o.dot(d);
  const double root2 = b * b - a * (o.squaredNorm() - s.half.x() * s.half.x());
  if (root2 <= 0) return;
  const double t = (-b - std::sqrt(root2)) / a;
  if (t <= 0 || t >= best.t) return;
  best.t = t, best.local = o + t * d, best.normal = best.local.normalized();
}

// A can has a lid; a cup is open and shows its inside and bottom.
void hit_round(const Thing& s, const Vec3& o, const Vec3& d, Hit& best) {
  const double r = s.half.x(), h = s.half.z();
  const double a = d.x() * d.x() + d.y() * d.y(), b = o.x() * d.x() + o.y() * d.y();
  const double root2 = b * b - a * (o.x() * o.x() + o.y() * o.y() - r * r);
  if (root2 <= 0) return;
  const auto take = [&](double t, const Vec3& n) {
    if (t <= 0 || t >= best.t) return;
    best.t = t, best.local = o + t * d, best.normal = n;
  };
  const double near = (-b - std::sqrt(root2)) / a, far = (-b + std::sqrt(root2)) / a;
  const auto side = [&](double t, double sign) {
    const Vec3 p = o + t * d;
    if (std::abs(p.z()) <= h) take(t, sign * Vec3(p.x() / r, p.y() / r, 0));
  };
  side(near, 1);
  const double lid = ((s.kind == Kind::kCan ? h : -h + 0.004) - o.z()) / d.z();
  const Vec3 p = o + lid * d;
  if (p.x() * p.x() + p.y() * p.y() < r * r) take(lid, Vec3(0, 0, 1));
  if (s.kind == Kind::kCup) side(far, -1);
}

class World {
 public:
  explicit World(std::uint64_t seed) : random_(seed, 1) {
    table_ = {colour(), colour()};
    yaw_ = random_.uniform(-0.5, 0.5);
    const double tilt = random_.uniform(0.5, 0.9), far = random_.uniform(0.75, 1.05);
    ahead_ =
        Vec3(std::sin(yaw_) * std::cos(tilt), std::cos(yaw_) * std::cos(tilt), -std::sin(tilt));
    eye_ = Vec3(0, 0, 0.05) - far * ahead_;
    right_ = Vec3(std::cos(yaw_), -std::sin(yaw_), 0);
    down_ = ahead_.cross(right_);
    place();
  }
  [[nodiscard]] const std::vector<Thing>& things() const { return things_; }
  [[nodiscard]] Hit look(double u, double v) const {
    const Vec3 d =
        ahead_ + right_ * ((u - kCamera.cx) / kCamera.fx) + down_ * ((v - kCamera.cy) / kCamera.fy);
    Hit best;
    if (d.z() < 0) best.t = -eye_.z() / d.z();
    best.local = eye_ + std::min(best.t, 50.0) * d;
    for (std::size_t k = 0; k < things_.size(); ++k) {
      const Thing& s = things_[k];
      const double c = std::cos(s.turn), n = std::sin(s.turn);
      const auto turned = [&](const Vec3& p) {
        return Vec3(c * p.x() + n * p.y(), -n * p.x() + c * p.y(), p.z());
      };
      const Vec3 o = turned(eye_ - s.centre), e = turned(d);
      const double before = best.t;
      if (s.kind == Kind::kBox) hit_box(s, o, e, best);
      if (s.kind == Kind::kBall) hit_ball(s, o, e, best);
      if (s.kind == Kind::kCan || s.kind == Kind::kCup) hit_round(s, o, e, best);
      if (best.t < before) {
        best.thing = static_cast<int>(k) + 1;
        best.slant = -best.normal.dot(e) / e.norm();
      }
    }
    if (best.thing == 0) best.slant = -d.z() / d.norm();
    return best;
  }
  [[nodiscard]] Rgb colour_at(const Hit& h) const {
    const auto& colours =
        h.thing == 0 ? table_ : things_[static_cast<std::size_t>(h.thing - 1)].colours;
    const double edge =
        h.thing == 0 ? 0.11 : things_[static_cast<std::size_t>(h.thing - 1)].pattern_m;
    std::size_t which = 0;
    if (edge > 0) {
      const Vec3 q = h.local / edge;
      const auto sum = static_cast<long>(std::floor(q.x() + 0.3)) +
                       static_cast<long>(std::floor(q.y() + 0.3)) +
                       static_cast<long>(std::floor(q.z() + 0.3));
      which = static_cast<std::size_t>(sum & 1);
    }
    return colours[which];
  }

 private:
  Rgb colour() {
    const auto c = [&] { return static_cast<std::uint8_t>(random_.integer(30, 220)); };
    const std::uint8_t r = c(), g = c(), b = c();
    return {r, g, b};
  }
  // On the table, flush beside the last one, on top of it, or before it.
  void place() {
    const auto count = random_.integer(6, 10);
    for (std::int64_t i = 0; i < count; ++i) {
      Thing s{};
      s.kind = static_cast<Kind>(random_.integer(0, 3));
      s.half = Vec3(random_.uniform(0.025, 0.06), random_.uniform(0.025, 0.06),
                    random_.uniform(0.02, 0.08));
      if (s.kind == Kind::kBox && random_.uniform() < 0.2) s.half = Vec3(0.010, 0.010, 0.12);
      if (s.kind == Kind::kBall) s.half = Vec3::Constant(s.half.x());
      s.turn = random_.uniform(-1.5, 1.5);
      s.colours = {colour(), colour()};
      s.pattern_m = random_.uniform() < 0.5 ? 0 : random_.uniform(0.015, 0.05);
      s.centre = Vec3(random_.uniform(-0.22, 0.22), random_.uniform(-0.18, 0.18), s.half.z());
      const double how = random_.uniform();
      if (!things_.empty() && things_.back().kind != Kind::kBall) {
        const Thing& last = things_.back();
        const double top = last.centre.z() + last.half.z();
        if (how < 0.3 && last.kind != Kind::kCup && last.half.x() > 0.02 && top < 0.25) {
          s.centre = Vec3(last.centre.x() + random_.uniform(-0.01, 0.01),
                          last.centre.y() + random_.uniform(-0.01, 0.01), top + s.half.z());
        } else if (how < 0.6) {
          const double apart = how < 0.45 ? 0.001 : random_.uniform(0.005, 0.03);
          s.turn = last.turn;
          const double x = last.half.x() + s.half.x() + apart;
          s.centre.x() = last.centre.x() + x * std::cos(s.turn);
          s.centre.y() = last.centre.y() + x * std::sin(s.turn);
          if (random_.uniform() < 0.4) s.colours = last.colours;
        }
      }
      const bool free = std::none_of(things_.begin(), things_.end(), [&](const Thing& o) {
        const Vec3 d = (o.centre - s.centre).cwiseAbs();
        const double r = std::max(s.half.x(), s.half.y()), q = std::max(o.half.x(), o.half.y());
        const bool beside = how < 0.6 && &o == &things_.back();
        return !beside && std::hypot(d.x(), d.y()) < r + q && d.z() < s.half.z() + o.half.z();
      });
      if (free) things_.push_back(s);
    }
  }
  rt::Random random_;
  std::vector<Thing> things_;
  std::array<Rgb, 2> table_;
  double yaw_ = 0;
  Vec3 eye_, ahead_, right_, down_;
};

// What the depth camera makes of a pixel, mm; 0: no reading.
std::uint16_t reading(const World& world, int u, int v, rt::Random& random) {
  const Hit h = world.look(u + 0.4 * random.normal(), v + 0.4 * random.normal());
  if (h.t > 4) return 0;
  const Hit left = world.look(u - 3, v), right = world.look(u + 3, v);
  const bool edge = std::abs(left.t - right.t) > 0.03;
  // The projector stands to the right of the camera: what is in front casts a shadow to its left.
  const bool shadow = world.look(u + 7, v).t < h.t - 0.04;
  if (shadow || (edge && random.uniform() < 0.25) || h.slant < 0.12) return 0;
  return static_cast<std::uint16_t>(1000 * h.t + 1.6 * h.t * h.t * random.normal() + 0.5);
}

}  // namespace

ClutterScene clutter_scene(std::uint64_t seed) {
  const World world(seed);
  rt::Random random(seed, 2);
  ClutterScene out{{{kW, kH}, {kW, kH}, {kW, kH}}, kCamera};
  std::vector<int> seen(world.things().size() + 1, 0);
  for (int v = 0; v < kH; ++v) {
    for (int u = 0; u < kW; ++u) {
      const Hit h = world.look(u, v);
      out.frame.label.at(u, v) = static_cast<std::uint16_t>(h.thing);
      ++seen[static_cast<std::size_t>(h.thing)];
      out.frame.depth.at(u, v) = reading(world, u, v, random);
      const Rgb c = world.colour_at(h);
      const double shade = 0.45 + 0.55 * std::clamp(h.slant, 0.0, 1.0);
      const auto n = [&](std::uint8_t value) {
        return static_cast<std::uint8_t>(
            std::clamp(shade * value + 4 * random.normal(), 1.0, 255.0));
      };
      out.frame.rgb.at(u, v) = {n(c.r), n(c.g), n(c.b)};
    }
  }
  // Holes: a gloss that gives no depth.
  for (int hole = 0; hole < 25; ++hole) {
    const auto cu = random.integer(0, kW - 1), cv = random.integer(0, kH - 1),
               r = random.integer(2, 7);
    for (auto v = std::max<std::int64_t>(0, cv - r); v <= std::min<std::int64_t>(kH - 1, cv + r);
         ++v)
      for (auto u = std::max<std::int64_t>(0, cu - r); u <= std::min<std::int64_t>(kW - 1, cu + r);
           ++u)
        if ((u - cu) * (u - cu) + (v - cv) * (v - cv) <= r * r)
          out.frame.depth.at(static_cast<int>(u), static_cast<int>(v)) = 0;
  }
  for (int i = 0; i < kW * kH; ++i) {
    std::uint16_t& l = out.frame.label.data()[i];
    if (l != 0 && seen[l] < kLeastSeen) l = kUnlabelled;
  }
  return out;
}

}  // namespace teletact
