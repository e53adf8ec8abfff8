#include "perception/motion/motion_things.hpp"

#include <algorithm>
#include <cmath>

#include "perception/motion/evidence.hpp"

namespace perception::motion {

namespace {

// chosen on: not recorded; judged on: moving 606, moving 707
constexpr int kYoungPercent = 3;
constexpr float kConcave = 0.4F;  // bend over two pixels either side that ends a thing
// chosen on: moving 101 (11, 150, 203, 227, 239), moving 54 (17); judged on: moving 606, moving 707
constexpr float kThinStep_m = 0.15F;  // of depth, between neighbours of a thing without an inside
constexpr float kSameThing_m = 0.3F;  // its middle goes so far at most from one image to the next
constexpr int kBorder = 4;            // pixels of the image's border, where nothing has an inside
// What is seen of a person at 1.5 m: its middle goes with the camera.
constexpr float kOfCameraWay = 0.1F;

}  // namespace

MotionThings::MotionThings(const MotionConfig& config, const TrackerConfig& tracker,
                           const WatchedImage& image, const Consensus& consensus,
                           const MotionEvidence& evidence, PlaceMemory& places)
    : config_(config),
      tracker_(tracker),
      image_(image),
      consensus_(consensus),
      evidence_(evidence),
      places_(places),
      mask_(WatchedImage::kMost),
      recalled_(WatchedImage::kMost),
      visited_(WatchedImage::kMost),
      core_(WatchedImage::kMost),
      queue_(WatchedImage::kMost),
      points_W_(WatchedImage::kMost),
      now_W_(WatchedImage::kMost) {}

void MotionThings::forget() noexcept {
  remembered_ = 0;
  had_ = false;
  std::fill(mask_.begin(), mask_.end(), std::uint8_t{0});
  trails_.forget();
}

void MotionThings::clear() noexcept {
  std::fill_n(mask_.begin(), std::min(image_.size(), WatchedImage::kMost), std::uint8_t{0});
}

void MotionThings::grow(const DepthLevel& live, const Pose& X_WC, bool thin) noexcept {
  if (had_)
    recall(live, X_WC);
  else
    std::fill_n(recalled_.begin(), image_.size(), std::uint8_t{0});
  grow_whole(live);
  fringe(live);
  if (thin) grow_thin(live);
}

int MotionThings::note_points(const DepthLevel& live) noexcept {
  int masked = 0;
  for (int i = 0; i < image_.size(); ++i)
    if (mask_[static_cast<std::size_t>(i)] != 0)
      ++masked, now_W_[static_cast<std::size_t>(i)] = evidence_.point_W(live, i);
  return masked;
}

int MotionThings::settle() noexcept {
  int masked = 0;
  for (int i = 0; image_.recent > 0 && i < image_.size(); ++i)
    if (mask_[static_cast<std::size_t>(i)] != 0)
      points_W_[static_cast<std::size_t>(masked++)] = now_W_[static_cast<std::size_t>(i)];
  // What has just come back to where the map shows it is masked no more, and may leave again: for a
  // while it is remembered where it was.
  since_masked_ = masked > 0 ? 0 : since_masked_ + 1;
  if (masked > 0 || since_masked_ >= config_.rest_frames) remembered_ = masked;
  had_ = remembered_ > 0;
  return masked;
}

// Where last image's masked points are in this one.
void MotionThings::recall(const DepthLevel& live, const Pose& X_WC) noexcept {
  std::fill_n(recalled_.begin(), image_.size(), std::uint8_t{0});
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
        if (x < 0 || y < 0 || x >= image_.width || y >= image_.height) continue;
        const auto z = static_cast<double>(live.depth.row(y)[x]);
        if (z > 0 && std::abs(z - q.z()) < 0.15)
          recalled_[static_cast<std::size_t>(y * image_.width + x)] = 1;
      }
    }
  }
}

// Cells of which a quarter moved in the last image may not be static.
void MotionThings::remember_cells(const DepthLevel& live, const Pose& X_WC,
                                  Consensus::Cells& out) noexcept {
  out.fill(1);
  if (!had_) return;
  recall(live, X_WC);
  const int columns = image_.columns(),
            rows = (image_.height + CellSums::kEdge - 1) / CellSums::kEdge;
  for (int c = 0; c < columns * rows; ++c) {
    const int u0 = c % columns * CellSums::kEdge, v0 = c / columns * CellSums::kEdge;
    int n = 0, m = 0;
    for (int v = v0; v < std::min(v0 + CellSums::kEdge, image_.height); ++v)
      for (int u = u0; u < std::min(u0 + CellSums::kEdge, image_.width); ++u, ++n)
        m += recalled_[static_cast<std::size_t>(v * image_.width + u)];
    if (m > n / 4) out[static_cast<std::size_t>(c)] = 0;
  }
}

// What a thing may be grown over: pixels whose neighbours go on without a step, and that do not lie
// in a concave crease. On a plane 1/z is linear in the image, so its second difference is the bend,
// whatever the angle of view.
void MotionThings::find_core(const DepthLevel& live) noexcept {
  const auto& p = tracker_.preprocess;
  const float base = static_cast<float>(p.edge_base_m), square = static_cast<float>(p.edge_per_m2),
              slope = static_cast<float>(p.edge_slope / live.intrinsics.fx),
              pitch = static_cast<float>(1 / live.intrinsics.fx);
  const std::ptrdiff_t stride = live.depth.stride();
  for (int v = 0; v < image_.height; ++v) {
    const float* z = live.depth.row(v);
    for (int u = 0; u < image_.width; ++u) {
      const float c = z[u];
      std::uint8_t& core = core_[static_cast<std::size_t>(v * image_.width + u)];
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
  for (int v = 0; v < image_.height; ++v) {
    for (int u = 0; u < image_.width; ++u) {
      const int i = v * image_.width + u;
      std::uint8_t& core = core_[static_cast<std::size_t>(i)];
      if (core == 0 || u == 0 || v == 0 || u + 1 == image_.width || v + 1 == image_.height)
        continue;
      int about = -1;
      for (int k = 0; k < 9; ++k)
        about += core_[static_cast<std::size_t>(i + (k / 3 - 1) * image_.width + k % 3 - 1)] != 0
                     ? 1
                     : 0;
      if (about >= 7) core = 2;
    }
  }
}

void MotionThings::grow_whole(const DepthLevel& live) noexcept {
  const int n = image_.size();
  std::fill_n(mask_.begin(), n, std::uint8_t{0});
  std::fill_n(visited_.begin(), n, std::uint8_t{0});
  int first = 0;
  find_core(live);
  for (int s = 0; s < n; ++s) {
    if ((evidence_.seed(s) == 0 && recalled_[static_cast<std::size_t>(s)] == 0) ||
        visited_[static_cast<std::size_t>(s)] != 0 || core_[static_cast<std::size_t>(s)] < 2)
      continue;
    int end = first;
    Thing thing;
    queue_[static_cast<std::size_t>(end++)] = s;
    visited_[static_cast<std::size_t>(s)] = 1;
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      thing.evidence += evidence_.seed(i);
      thing.remembered += recalled_[static_cast<std::size_t>(i)];
      const std::uint8_t e = evidence_.at(i);
      thing.young += e == kFree || e == kYoung || e == kOff ? 1 : 0;
      thing.old += evidence_.at(i) == kRested ? 1 : 0;
      thing.agrees += evidence_.at(i) == kAgrees ? 1 : 0;
      const int u = i % image_.width, v = i / image_.width;
      thing.misfits += consensus_.fits(image_.cell_of(u, v)) ? 0 : 1;
      const int next[4] = {u > 0 ? i - 1 : -1, u + 1 < image_.width ? i + 1 : -1,
                           v > 0 ? i - image_.width : -1,
                           v + 1 < image_.height ? i + image_.width : -1};
      for (const int b : next) {
        if (b < 0 || visited_[static_cast<std::size_t>(b)] != 0 ||
            core_[static_cast<std::size_t>(b)] < 2)
          continue;
        visited_[static_cast<std::size_t>(b)] = 1;
        queue_[static_cast<std::size_t>(end++)] = b;
      }
    }
    judge(live, first, end, thing);
    first = end;
  }
}

// What is too thin to have an inside: its evidence alone, after fringe().
void MotionThings::grow_thin(const DepthLevel& live) noexcept {
  const float slope = static_cast<float>(tracker_.preprocess.edge_slope / live.intrinsics.fx);
  int first = 0;
  for (int s = image_.width; s < (image_.height - 1) * image_.width; ++s) {
    if (evidence_.seed(s) == 0 || visited_[static_cast<std::size_t>(s)] != 0 ||
        mask_[static_cast<std::size_t>(s)] != 0)
      continue;
    int end = first;
    Thing thing;
    queue_[static_cast<std::size_t>(end++)] = s;
    visited_[static_cast<std::size_t>(s)] = 1;
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      const std::uint8_t e = evidence_.at(i);
      thing.evidence += 1;
      thing.young += e == kFree || e == kYoung || e == kOff ? 1 : 0;
      const float z = live.depth.row(i / image_.width)[i % image_.width];
      for (int k = 0; k < 9; ++k) {  // seeds do not lie on the image's border
        const int b = i + (k / 3 - 1) * image_.width + k % 3 - 1;
        if (visited_[static_cast<std::size_t>(b)] != 0 || evidence_.seed(b) == 0 ||
            std::abs(live.depth.row(b / image_.width)[b % image_.width] - z) > kThinStep_m)
          continue;
        visited_[static_cast<std::size_t>(b)] = 1;
        queue_[static_cast<std::size_t>(end++)] = b;
      }
    }
    judge(live, first, end, thing);
    // And its outline, of which too few about speak.
    for (int at = first; at < end; ++at) {
      const int i = queue_[static_cast<std::size_t>(at)];
      if (mask_[static_cast<std::size_t>(i)] == 0) continue;
      const float z = live.depth.row(i / image_.width)[i % image_.width];
      for (const int d : {-1, 1, -image_.width, image_.width}) {
        const auto b = static_cast<std::size_t>(i + d);
        const float beside = live.depth.row((i + d) / image_.width)[(i + d) % image_.width];
        if (core_[b] < 2 && beside > 0 && std::abs(beside - z) < 0.02F + slope * z) mask_[b] = 1;
      }
    }
    first = end;
  }
}

bool ThingTrails::wanders(const Vec3f& middle_W, const Vec3f& camera_W, std::uint64_t frame,
                          float slack_m, float of_camera) noexcept {
  const auto now = static_cast<std::uint32_t>(frame);
  Trail* trail = nullptr;
  Trail* oldest = trails_.data();
  float nearest = kSameThing_m;
  for (Trail& t : trails_) {
    if (t.seen < oldest->seen) oldest = &t;
    if (t.count == 0 || t.seen + 1 != now) continue;
    const float way = (t.middle_W[(t.count - 1) % Trail::kLength] - middle_W).norm();
    if (way < nearest) nearest = way, trail = &t;
  }
  if (trail == nullptr) trail = oldest, trail->count = 0;
  bool gone = false;
  for (std::uint32_t k = 0; k < std::min(trail->count, Trail::kLength); ++k) {
    const float limit = slack_m + of_camera * (trail->camera_W[k] - camera_W).norm();
    gone = gone || (trail->middle_W[k] - middle_W).norm() > limit;
  }
  const auto at = static_cast<std::size_t>(trail->count++ % Trail::kLength);
  trail->middle_W[at] = middle_W, trail->camera_W[at] = camera_W;
  trail->seen = now;
  return gone;
}

bool MotionThings::wanders(const DepthLevel& live, int first, int end) noexcept {
  Vec3f middle = Vec3f::Zero();
  bool cut = false;  // by the image's border: what is seen of it goes with the camera
  for (int at = first; at < end; ++at) {
    const int i = queue_[static_cast<std::size_t>(at)];
    const int u = i % image_.width, v = i / image_.width;
    cut = cut || u < kBorder || v < kBorder || u >= image_.width - kBorder ||
          v >= image_.height - kBorder;
    middle += evidence_.point_W(live, i);
  }
  middle /= static_cast<float>(end - first);
  return trails_.wanders(middle, evidence_.camera_W(), image_.frame,
                         static_cast<float>(config_.rest_cell_m / 2), cut ? 1.0F : kOfCameraWay);
}

// Seen at a flat angle by a camera that drives, a surface is met in other places each time.
bool MotionThings::grazed(const DepthLevel& live, int i) const noexcept {
  const Vec3f p_W = evidence_.point_W(live, i);
  float least = 1e9F, most = 0;
  for (const int d : {-1, 1, -image_.width, image_.width}) {  // all have depth: it is of a core
    const float step_m = (evidence_.point_W(live, i + d) - p_W).norm();
    least = std::min(least, step_m), most = std::max(most, step_m);
  }
  return most > std::max(2 * least, static_cast<float>(config_.rest_cell_m));
}

void MotionThings::judge(const DepthLevel& live, int first, int end, const Thing& thing) noexcept {
  const int size = end - first;
  if (size < config_.least_pixels) return;
  // The place itself is large, and fits: a wrong pose must not make it a thing.
  const bool apart = size < image_.size() / 2 || thing.misfits >= size / 2;
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
    const int i = queue_[static_cast<std::size_t>(at)];
    if (evidence_.at(i) != kYoung && evidence_.at(i) != kFree) continue;
    if (grazed(live, i) || places_.rested_beside(evidence_.point_W(live, i), config_.rest_frames))
      --young;
  }
  const bool wandering = wanders(live, first, end) && thing.old < size / 2;
  const bool stands = young < few && !wandering;
  if (stands) return let_stand(live, first, end);
  for (int at = first; at < end; ++at) {
    const int i = queue_[static_cast<std::size_t>(at)];
    std::uint8_t& masked = mask_[static_cast<std::size_t>(i)];
    masked = apart || evidence_.seed(i) != 0 ? 1 : 0;
    if (masked != 0 && evidence_.at(i) != kAgrees)
      static_cast<void>(places_.find(evidence_.point_W(live, i), true));
  }
}

// What the thing fills is part of the scene from now on.
void MotionThings::let_stand(const DepthLevel& live, int first, int end) noexcept {
  for (int at = first; at < end; ++at) {
    const int i = queue_[static_cast<std::size_t>(at)];
    PlaceMemory::Place* place =
        evidence_.at(i) > kRested ? places_.find(evidence_.point_W(live, i), true) : nullptr;
    if (place != nullptr)
      place->first =
          place->last - std::min(place->last, static_cast<std::uint32_t>(config_.rest_frames));
  }
}

// What was left out about a thing, for lying on an edge: it goes with its neighbour at the same
// depth.
void MotionThings::fringe(const DepthLevel& live) noexcept {
  const auto& p = tracker_.preprocess;
  const float slope = static_cast<float>(p.edge_slope / live.intrinsics.fx);
  for (int round = 0; round < 3; ++round) {
    const auto mark = static_cast<std::uint8_t>(round + 2);
    for (int v = 1; v + 1 < image_.height; ++v) {
      for (int u = 1; u + 1 < image_.width; ++u) {
        const int i = v * image_.width + u;
        const float z = live.depth.row(v)[u];
        if (mask_[static_cast<std::size_t>(i)] != 0 || core_[static_cast<std::size_t>(i)] == 2 ||
            !(z > 0))
          continue;
        for (const int d : {-1, 1, -image_.width, image_.width}) {
          const int j = i + d;
          const std::uint8_t m = mask_[static_cast<std::size_t>(j)];
          if (m == 0 || m >= mark) continue;
          if (std::abs(live.depth.row(j / image_.width)[j % image_.width] - z) < 0.02F + slope * z)
            mask_[static_cast<std::size_t>(i)] = mark;
        }
      }
    }
  }
  for (int i = 0; i < image_.size(); ++i)
    mask_[static_cast<std::size_t>(i)] = mask_[static_cast<std::size_t>(i)] != 0 ? 1 : 0;
}

}  // namespace perception::motion
