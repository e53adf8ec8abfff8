#include "tools/touch/touch_places.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace teletact {

using perception::Vec3;
using Kind = TouchPlace::Kind;

namespace {

// chosen on: kitchen 1-75, room; judged on: kitchen 1-75, 76-150 and whole backwards, turn, near, corridor, stairs backwards (docs/recordings.md)
constexpr double kSame_m = 0.05;     // two sights of one place
constexpr double kBefore_m = 0.03;   // what hides it is nearer to the eye
constexpr double kBeside_m = 0.08;   // touched there counts as touched here
constexpr double kClear_m = 0.04;    // between the hand on its way and what shows behind it
constexpr double kOff_m = 0.015;     // off its plane it is another surface
constexpr std::size_t kMost = 3000;  // no data
constexpr int kMissed = 2;           // pictures in a row that do not show it: forgotten
constexpr std::array kTurn{Kind::kTop, Kind::kWall, Kind::kTop, Kind::kEdge, Kind::kCorner};

// One of the nine pixels about `uv` shows the place's plane, near the place: at a grazing angle a
// pixel to the side is centimetres off along the ray.
bool shows_there(const tasks::SceneView& view, const TouchPlace& place, const Eigen::Vector2d& uv) {
  const int u0 = static_cast<int>(uv.x() + 0.5), v0 = static_cast<int>(uv.y() + 0.5);
  for (int v = v0 - 1; v <= v0 + 1; ++v) {
    for (int u = u0 - 1; u <= u0 + 1; ++u) {
      const auto& q = view.points[static_cast<std::size_t>(v) *
                                      static_cast<std::size_t>(view.intrinsics.width) +
                                  static_cast<std::size_t>(u)];
      const Vec3 r =
          Vec3(static_cast<double>(q.x), static_cast<double>(q.y), static_cast<double>(q.z)) -
          place.p_W;
      if (q.depth > 0 && std::abs(r.dot(place.n_W)) < kOff_m && r.norm() < kBeside_m) return true;
    }
  }
  return false;
}

// Along each ray what the picture shows is kClear_m behind the straight, as far as it shows the
// straight. Where it does not, the places tell that are known.
bool clear(const TouchPlaces& memory, const tasks::SceneView& view, const perception::Pose& X_VW,
           const Vec3& a, const Vec3& b) {
  const int n = 1 + static_cast<int>((b - a).norm() / 0.025);
  for (int i = 0; i <= n; ++i) {
    const Vec3 p = a + (static_cast<double>(i) / n) * (b - a);
    const Vec3 q = X_VW * p;
    const auto meets = [&](const TouchPlaces::Known& k) {
      const Vec3 r = p - k.place.p_W;
      const double h = r.dot(k.place.n_W);
      return h < 0.025 && h > -0.08 && (r - h * k.place.n_W).norm() < 0.06;
    };
    if (std::any_of(memory.known().begin(), memory.known().end(), meets)) return false;
    const double depth = shown_depth(view, q);
    if (depth > 0 && depth < q.z() + kClear_m) return false;
  }
  return true;
}

// A point between the two from which both are free to go to: half-way, or drawn back along the
// place's normal or towards the eye.
std::optional<Vec3> way(const TouchPlaces& memory, const tasks::SceneView& view, const Reach& reach,
                        const Vec3& a, const Vec3& b, const Vec3& normal) {
  const perception::Pose X_VW = view.X_WV.inverse();
  const Vec3 middle = 0.5 * (a + b), to_eye = (view.X_WV.translation() - middle).normalized();
  for (const double lift : {0.0, 0.06, 0.12, 0.18, 0.24}) {
    for (const Vec3& back : {normal, to_eye}) {
      const Vec3 via = middle + lift * back;
      if (!reach.holds(via)) continue;
      if (clear(memory, view, X_VW, a, via) && clear(memory, view, X_VW, via, b)) return via;
    }
  }
  return std::nullopt;
}

}  // namespace

void TouchPlaces::see(const tasks::SceneView& view, const Vec3& up_W, const Reach* reach) {
  const perception::Pose X_VW = view.X_WV.inverse();
  const auto& k = view.intrinsics;
  for (Known& known : known_) {
    const Vec3 q = X_VW * known.place.p_W;
    if (!(q.z() > 0.1)) continue;
    const auto uv = k.project(q);
    if (!(uv.x() > 1 && uv.y() > 1 && uv.x() < k.width - 2 && uv.y() < k.height - 2)) continue;
    const bool shows = shows_there(view, known.place, uv);
    const double depth = shown_depth(view, q);
    known.hidden = !shows && depth > 0 && depth < q.z() - kBefore_m;
    known.missed = shows || known.hidden ? 0 : known.missed + 1;
    known.looks += known.hidden ? 0 : 1;
  }
  std::erase_if(known_, [](const Known& n) { return n.missed >= kMissed; });
  const auto wanted = [&](const Vec3& p) { return reach->holds(p); };
  std::vector<bool> again(known_.size(), false);
  const std::size_t before = known_.size();
  for (const TouchPlace& found :
       places_in_view(view, up_W, reach != nullptr ? wanted : std::function<bool(const Vec3&)>())) {
    if (reach != nullptr && !reach->holds(found)) continue;
    std::size_t best = before;
    double nearest = kSame_m;
    for (std::size_t i = 0; i < before; ++i) {
      const double off = (known_[i].place.p_W - found.p_W).norm();
      if (again[i] || known_[i].place.flat() != found.flat() || off > nearest) continue;
      nearest = off;
      best = i;
    }
    if (best < before) {
      again[best] = true;
      known_[best].place = found;
      known_[best].hidden = false;
      known_[best].missed = 0;
      ++known_[best].pictures;
    } else if (known_.size() < kMost) {
      known_.push_back({found});
    }
  }
}

const TouchPlaces::Known* TouchPlaces::at(const Vec3& p_W) const noexcept {
  const Known* best = nullptr;
  double nearest = kBeside_m;
  for (const Known& k : known_) {
    const Vec3 r = p_W - k.place.p_W;
    if (!k.sure() || r.norm() > nearest || std::abs(r.dot(k.place.n_W)) > kOff_m) continue;
    nearest = r.norm();
    best = &k;
  }
  return best;
}

Vec3 up_of(const perception::CostMap& map, const TouchPlaces& memory) {
  if (map.seq != 0 && map.ground_found) return map.X_WM.linear().col(2);
  std::vector<Vec3> normals;
  for (const auto& k : memory.known()) {
    if (k.sure() && k.place.flat()) normals.push_back(k.place.n_W);
  }
  const auto fits = [&](const Vec3& up) {
    return std::count_if(normals.begin(), normals.end(), [&](const Vec3& n) {
      const double rise = n.dot(up);
      return rise > 0.97 || std::abs(rise) < 0.08;
    });
  };
  Vec3 best = -Vec3::UnitY();
  auto most = fits(best);
  for (const Vec3& n : normals) {
    if (std::abs(n.x()) > 0.35 || n.y() > -0.26) continue;
    if (const auto now = fits(n); now > most) {
      most = now;
      best = n;
    }
  }
  return best;
}

std::optional<NextPlace> next_place(const TouchPlaces& memory, const tasks::SceneView& view,
                                    const Reach& reach, const Vec3& from_W,
                                    const std::vector<TouchPlace>& touched) {
  struct Choice {
    int other_kind, touched, narrow, rough_mm, far;
    const TouchPlaces::Known* known;
    [[nodiscard]] auto key() const { return std::tie(other_kind, touched, narrow, rough_mm, far); }
  };
  const Kind wanted = kTurn[touched.size() % kTurn.size()];
  std::vector<Choice> choices;
  for (const auto& known : memory.known()) {
    const TouchPlace& p = known.place;
    if (!known.sure() || !reach.holds(p)) continue;
    const auto times = std::count_if(touched.begin(), touched.end(), [&](const TouchPlace& t) {
      return (t.p_W - p.p_W).norm() < kBeside_m;
    });
    choices.push_back({p.kind == wanted ? 0
                       : p.flat()       ? 1
                                        : 2,
                       static_cast<int>(times), p.wide ? 0 : 1, static_cast<int>(1e3 * p.rough_m),
                       static_cast<int>((p.p_W - from_W).norm() / 0.1), &known});
  }
  std::stable_sort(choices.begin(), choices.end(),
                   [](const Choice& a, const Choice& b) { return a.key() < b.key(); });
  for (const Choice& c : choices) {
    const TouchPlace& p = c.known->place;
    const auto via = way(memory, view, reach, from_W, p.p_W + reach.standoff_m * p.n_W, p.n_W);
    if (via) return NextPlace{p, c.known->pictures, *via};
  }
  if (choices.empty()) return std::nullopt;
  // From where the hand is no way shows (the camera has moved on, say): straight.
  const TouchPlace& p = choices.front().known->place;
  return NextPlace{p, choices.front().known->pictures,
                   0.5 * (from_W + p.p_W + reach.standoff_m * p.n_W)};
}

}  // namespace teletact
