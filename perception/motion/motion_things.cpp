// Which things move: what evidence is grown to (motion_watch.hpp).
#include <algorithm>
#include <cmath>

#include "perception/motion/evidence.hpp"
#include "perception/motion/motion_watch.hpp"

namespace perception {

namespace {

// chosen on: not recorded; judged on: moving 606, moving 707
constexpr int kYoungPercent = 3;
constexpr std::uint32_t kRestGap = 5;  // frames that a cell may go unseen
constexpr std::uint32_t kProbes = 4;   // of the table of places
constexpr float kConcave = 0.4F;       // bend over two pixels either side that ends a thing
// chosen on: moving 101 (11, 150, 203, 227, 239), moving 54 (17); judged on: moving 606, moving 707
constexpr float kThinStep_m = 0.15F;  // of depth, between neighbours of a thing without an inside
constexpr float kSameThing_m = 0.3F;  // its middle goes so far at most from one image to the next
constexpr int kBorder = 4;            // pixels of the image's border, where nothing has an inside
// What is seen of a person at 1.5 m: its middle goes with the camera.
constexpr float kOfCameraWay = 0.1F;

}  // namespace

// Where last image's masked points are in this one.
void MotionWatch::recall(const DepthLevel& live, const Pose& X_WC) noexcept {
  std::fill_n(recalled_.begin(), width_ * height_, std::uint8_t{0});
  if (remembered_ == 0) return;
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const Intrinsics& k = live.intrinsics;
  for (int n = 0; n < remembered_; ++n) {
    const Vec3 q = X_CW * points_W_[static_cast<std::size_t>(n)].cast<double>();
    if (!(q.z() > 0.1)) continue;
    const int u = static_cast<int>(std::lround(k.fx * q.x() / q.z() + k.cx)),
              v = static_cast<int>(std::lround(k.fy * q.y() / q.z() + k.cy));
    for (int dv = -1; dv <= 1; ++dv) {
      for (int du = -1; du <= 1; ++du) {
        const int x = u + du, y = v + dv;
        if (x < 0 || y < 0 || x >= width_ || y >= height_) continue;
        const auto z = static_cast<double>(live.depth.row(y)[x]);
        if (z > 0 && std::abs(z - q.z()) < 0.15)
          recalled_[static_cast<std::size_t>(y * width_ + x)] = 1;
      }
    }
  }
}

// What a thing may be grown over: pixels whose neighbours go on without a step, and that do not lie in a concave
// crease. On a plane 1/z is linear in the image, so its second difference is the bend, whatever the angle of view.
void MotionWatch::find_core(const DepthLevel& live) noexcept {
  const auto& p = tracker_.preprocess;
  const float base = static_cast<float>(p.edge_base_m), square = static_cast<float>(p.edge_per_m2),
              slope = static_cast<float>(p.edge_slope / live.intrinsics.fx),
              pitch = static_cast<float>(1 / live.intrinsics.fx);
  const std::ptrdiff_t stride = live.depth.stride();
  for (int v = 0; v < height_; ++v) {
    const float* z = live.depth.row(v);
    for (int u = 0; u < width_; ++u) {
      const float c = z[u];
      std::uint8_t& core = core_[static_cast<std::size_t>(v * width_ + u)];
      core = 0;
      if (!(c > 0)) continue;
      const float step = base + square * c * c + slope * c;
      const float beyond = std::max(c - static_cast<float>(tracker_.noise_from_m), 0.0F);
      const float sigma = 0.5F * static_cast<float>(tracker_.noise_m) +
                          0.25F * static_cast<float>(tracker_.noise_per_m2) * beyond * beyond;
      const float limit = kConcave * 2 * pitch * c + 4 * sigma;
      bool ok = true;
      for (const std::ptrdiff_t d : {std::ptrdiff_t{1}, stride}) {
        for (const float n : {z[u - d], z[u + d]}) ok = ok && n > 0 && std::abs(n - c) < step;
        const float l = z[u - 2 * d], r = z[u + 2 * d];
        ok = ok && l > 0 && r > 0 && c * c * (1 / l + 1 / r - 2 / c) < limit;
      }
      core = ok ? 1 : 0;
    }
  }
  // No way through a gap of a pixel or two.
  for (int v = 0; v < height_; ++v) {
    for (int u = 0; u < width_; ++u) {
      const int i = v * width_ + u;
      std::uint8_t& core = core_[static_cast<std::size_t>(i)];
      if (core == 0 || u == 0 || v == 0 || u + 1 == width_ || v + 1 == height_) continue;
      int about = -1;
      for (int k = 0; k < 9; ++k)
        about += core_[static_cast<std::size_t>(i + (k / 3 - 1) * width_ + k % 3 - 1)] != 0 ? 1 : 0;
      if (about >= 7) core = 2;
    }
  }
}

void MotionWatch::grow(const DepthLevel& live) noexcept {
  const int n = width_ * height_;
  std::fill_n(mask_.begin(), n, std::uint8_t{0});
  std::fill_n(visited_.begin(), n, std::uint8_t{0});
  int first = 0;
  find_core(live);
  for (int s = 0; s < n; ++s) {
    if ((seed_[static_cast<std::size_t>(s)] == 0 && recalled_[static_cast<std::size_t>(s)] == 0) ||
        visited_[static_cast<std::size_t>(s)] != 0 || core_[static_cast<std::size_t>(s)] < 2)
      continue;
    int end = first;
    Thing thing;
    queue_[static_cast<std::size_t>(end++)] = s;
    visited_[static_cast<std::size_t>(s)] = 1;
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      thing.evidence += seed_[static_cast<std::size_t>(i)];
      thing.remembered += recalled_[static_cast<std::size_t>(i)];
      const std::uint8_t e = evidence_[static_cast<std::size_t>(i)];
      thing.young += e == kFree || e == kYoung || e == kOff ? 1 : 0;
      thing.old += evidence_[static_cast<std::size_t>(i)] == kRested ? 1 : 0;
      thing.agrees += evidence_[static_cast<std::size_t>(i)] == kAgrees ? 1 : 0;
      const int u = i % width_, v = i / width_;
      thing.misfits += consensus_.fits(cell_of(u, v)) ? 0 : 1;
      const int next[4] = {u > 0 ? i - 1 : -1, u + 1 < width_ ? i + 1 : -1, v > 0 ? i - width_ : -1,
                           v + 1 < height_ ? i + width_ : -1};
      for (const int b : next) {
        if (b < 0 || visited_[static_cast<std::size_t>(b)] != 0 ||
            core_[static_cast<std::size_t>(b)] < 2)
          continue;
        visited_[static_cast<std::size_t>(b)] = 1;
        queue_[static_cast<std::size_t>(end++)] = b;
      }
    }
    judge_thing(live, first, end, thing);
    first = end;
  }
}

// What is too thin to have an inside: its evidence alone, after fringe().
void MotionWatch::grow_thin(const DepthLevel& live) noexcept {
  const float slope = static_cast<float>(tracker_.preprocess.edge_slope / live.intrinsics.fx);
  int first = 0;
  for (int s = width_; s < (height_ - 1) * width_; ++s) {
    if (seed_[static_cast<std::size_t>(s)] == 0 || visited_[static_cast<std::size_t>(s)] != 0 ||
        mask_[static_cast<std::size_t>(s)] != 0)
      continue;
    int end = first;
    Thing thing;
    queue_[static_cast<std::size_t>(end++)] = s;
    visited_[static_cast<std::size_t>(s)] = 1;
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      const std::uint8_t e = evidence_[static_cast<std::size_t>(i)];
      thing.evidence += 1;
      thing.young += e == kFree || e == kYoung || e == kOff ? 1 : 0;
      const float z = live.depth.row(i / width_)[i % width_];
      for (int k = 0; k < 9; ++k) {  // seeds do not lie on the image's border
        const int b = i + (k / 3 - 1) * width_ + k % 3 - 1;
        if (visited_[static_cast<std::size_t>(b)] != 0 || seed_[static_cast<std::size_t>(b)] == 0 ||
            std::abs(live.depth.row(b / width_)[b % width_] - z) > kThinStep_m)
          continue;
        visited_[static_cast<std::size_t>(b)] = 1;
        queue_[static_cast<std::size_t>(end++)] = b;
      }
    }
    judge_thing(live, first, end, thing);
    // And its outline, of which too few about speak.
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      if (mask_[static_cast<std::size_t>(i)] == 0) continue;
      const float z = live.depth.row(i / width_)[i % width_];
      for (const int d : {-1, 1, -width_, width_}) {
        const auto b = static_cast<std::size_t>(i + d);
        const float beside = live.depth.row((i + d) / width_)[(i + d) % width_];
        if (core_[b] < 2 && beside > 0 && std::abs(beside - z) < 0.02F + slope * z) mask_[b] = 1;
      }
    }
    first = end;
  }
}

// Has its middle gone some way in the last images? One that turns round goes back over places that it has filled.
bool MotionWatch::wanders(const DepthLevel& live, int first, int end) noexcept {
  Vec3f middle = Vec3f::Zero();
  bool cut = false;  // by the image's border: what is seen of it goes with the camera
  for (int at = first; at < end; ++at) {
    const int i = queue_[static_cast<std::size_t>(at)];
    const int u = i % width_, v = i / width_;
    cut = cut || u < kBorder || v < kBorder || u >= width_ - kBorder || v >= height_ - kBorder;
    middle += point_W(live, i);
  }
  middle /= static_cast<float>(end - first);
  const auto now = static_cast<std::uint32_t>(frame_);
  Trail* trail = nullptr;
  Trail* oldest = trails_.data();
  float nearest = kSameThing_m;
  for (Trail& t : trails_) {
    if (t.seen < oldest->seen) oldest = &t;
    if (t.count == 0 || t.seen + 1 != now) continue;
    const float way = (t.middle_W[(t.count - 1) % Trail::kLength] - middle).norm();
    if (way < nearest) nearest = way, trail = &t;
  }
  if (trail == nullptr) trail = oldest, trail->count = 0;
  const Vec3f camera = agree_.t_W[0] * Vec3f::UnitX() + agree_.t_W[1] * Vec3f::UnitY() +
                       agree_.t_W[2] * Vec3f::UnitZ();
  bool gone = false;
  for (std::uint32_t k = 0; k < std::min(trail->count, Trail::kLength); ++k) {
    const float limit = static_cast<float>(config_.rest_cell_m / 2) +
                        (cut ? 1.0F : kOfCameraWay) * (trail->camera_W[k] - camera).norm();
    gone = gone || (trail->middle_W[k] - middle).norm() > limit;
  }
  const auto at = static_cast<std::size_t>(trail->count++ % Trail::kLength);
  trail->middle_W[at] = middle, trail->camera_W[at] = camera;
  trail->seen = now;
  return gone;
}

// The place that a point lies in. A table of places, hashed: where all that it may lie at are taken it is not kept.
MotionWatch::Place* MotionWatch::place_of(const Vec3f& p_W, bool make, bool seen) noexcept {
  const auto inv = static_cast<float>(1 / config_.rest_cell_m);
  const auto x = static_cast<std::int32_t>(std::floor(p_W.x() * inv)),
             y = static_cast<std::int32_t>(std::floor(p_W.y() * inv)),
             z = static_cast<std::int32_t>(std::floor(p_W.z() * inv));
  const auto now = static_cast<std::uint32_t>(frame_);
  const std::uint32_t home = motion::place_slot(x, y, z);
  Place* empty = nullptr;
  bool any = false;  // of those that may be of this home
  for (std::uint32_t n = 0; n < kProbes; ++n) {
    Place& r = places_[(home + n) % motion::kPlaceSlots];
    const bool kept = r.last != 0 && r.last + kRestGap >= now;
    if (kept && r.x == x && r.y == y && r.z == z) {
      if (seen) r.last = now;
      return &r;
    }
    any = any || kept;
    if (!kept && empty == nullptr) empty = &r;
  }
  std::uint32_t& taken = taken_[home / 32];
  if (!any) taken &= ~(1U << home % 32);
  if (empty == nullptr || !make) return nullptr;
  taken |= 1U << home % 32;
  *empty = {x, y, z, now, now};
  return empty;
}

// Seen at a flat angle by a camera that drives, a surface is met in other places each time.
bool MotionWatch::grazed(const DepthLevel& live, int i) const noexcept {
  const Vec3f p_W = point_W(live, i);
  float least = 1e9F, most = 0;
  for (const int d : {-1, 1, -width_, width_}) {  // all have depth: it is of a core
    const float step_m = (point_W(live, i + d) - p_W).norm();
    least = std::min(least, step_m), most = std::max(most, step_m);
  }
  return most > std::max(2 * least, static_cast<float>(config_.rest_cell_m));
}

// By noise a point of a thing that stands lies now in one place, now in the next.
bool MotionWatch::beside_rested(const Vec3f& p_W) noexcept {
  const auto half = static_cast<float>(config_.rest_cell_m / 2);
  for (int k = 0; k < 6; ++k) {
    Vec3f q_W = p_W;
    q_W[k / 2] += k % 2 == 0 ? half : -half;
    const Place* place = place_of(q_W, false, false);
    if (place != nullptr && static_cast<int>(place->last - place->first) >= config_.rest_frames)
      return true;
  }
  return false;
}

void MotionWatch::judge_thing(const DepthLevel& live, int first, int end,
                              const Thing& thing) noexcept {
  const int size = end - first;
  if (size < config_.least_pixels) return;
  // The place itself is large, and fits: a wrong pose must not make it a thing.
  const bool apart = size < width_ * height_ / 2 || thing.misfits >= size / 2;
  const bool moves =
      thing.evidence >= config_.least_pixels && thing.evidence >= config_.least_share * size;
  // It moved in the last image, and goes on, or is nowhere that the map knows.
  const bool goes_on =
      thing.remembered >= size / 3 && thing.evidence >= std::max(config_.least_pixels, size / 33);
  const bool elsewhere =
      thing.remembered >= size / 2 && thing.agrees < size / 2 && thing.old < size / 2;
  if (!moves && !(apart && (goes_on || elsewhere))) return;
  // Nothing of it is where nothing was a moment ago: it stands.
  const int few = std::max(config_.least_pixels, size * kYoungPercent / 100);
  int young = thing.young;
  for (int at = first; at < end && !moves && young >= few; ++at) {
    const auto i = static_cast<std::size_t>(queue_[static_cast<std::size_t>(at)]);
    if (evidence_[i] != kYoung && evidence_[i] != kFree) continue;
    const int pixel = queue_[static_cast<std::size_t>(at)];
    if (grazed(live, pixel) || beside_rested(point_W(live, pixel))) --young;
  }
  const bool wandering = wanders(live, first, end) && thing.old < size / 2;
  const bool stands = young < few && !wandering;
  if (stands) {
    for (int at = first; at < end; ++at) {
      const auto i = static_cast<std::size_t>(queue_[static_cast<std::size_t>(at)]);
      Place* place =
          evidence_[i] > kRested ? place_of(point_W(live, static_cast<int>(i)), true) : nullptr;
      if (place != nullptr)
        place->first =
            place->last - std::min(place->last, static_cast<std::uint32_t>(config_.rest_frames));
    }
    return;
  }
  for (int at = first; at < end; ++at) {
    const auto i = static_cast<std::size_t>(queue_[static_cast<std::size_t>(at)]);
    mask_[i] = apart || seed_[i] != 0 ? 1 : 0;
    if (mask_[i] != 0 && evidence_[i] != kAgrees)
      static_cast<void>(place_of(point_W(live, static_cast<int>(i)), true));
  }
}

// What was left out about a thing, for lying on an edge: it goes with its neighbour at the same depth.
void MotionWatch::fringe(const DepthLevel& live) noexcept {
  const auto& p = tracker_.preprocess;
  const float slope = static_cast<float>(p.edge_slope / live.intrinsics.fx);
  for (int round = 0; round < 3; ++round) {
    const auto mark = static_cast<std::uint8_t>(round + 2);
    for (int v = 1; v + 1 < height_; ++v) {
      for (int u = 1; u + 1 < width_; ++u) {
        const int i = v * width_ + u;
        const float z = live.depth.row(v)[u];
        if (mask_[static_cast<std::size_t>(i)] != 0 || core_[static_cast<std::size_t>(i)] == 2 ||
            !(z > 0))
          continue;
        for (const int d : {-1, 1, -width_, width_}) {
          const int j = i + d;
          const std::uint8_t m = mask_[static_cast<std::size_t>(j)];
          if (m == 0 || m >= mark) continue;
          if (std::abs(live.depth.row(j / width_)[j % width_] - z) < 0.02F + slope * z)
            mask_[static_cast<std::size_t>(i)] = mark;
        }
      }
    }
  }
  for (int i = 0; i < width_ * height_; ++i)
    mask_[static_cast<std::size_t>(i)] = mask_[static_cast<std::size_t>(i)] != 0 ? 1 : 0;
}

}  // namespace perception
