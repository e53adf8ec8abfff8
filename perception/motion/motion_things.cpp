// Which things move: evidence, and what it is grown to (motion_watch.hpp).
#include "perception/motion/motion_watch.hpp"

#include <algorithm>
#include <cmath>

namespace perception {

namespace {

constexpr int kYoungFrames = 8, kYoungPercent = 3;
constexpr std::uint32_t kRestGap = 5;  // frames that a cell may go unseen
constexpr std::size_t kProbes = 4;     // of the table of places
constexpr int kLeastAbout = 5;         // of the 8 neighbours, in a patch
constexpr float kConcave = 0.4F;       // bend over two pixels either side that ends a thing
// Of a coarse pixel. From kFree on it speaks for motion.
enum Evidence : std::uint8_t { kNone, kAgrees, kRested, kFree, kOff, kYoung, kOld };

std::size_t hash_of(std::int32_t x, std::int32_t y, std::int32_t z) noexcept {
  const std::uint32_t h = static_cast<std::uint32_t>(x) * 73856093U ^
                          static_cast<std::uint32_t>(y) * 19349663U ^
                          static_cast<std::uint32_t>(z) * 83492791U;
  return h ^ (h >> 15U);
}

// The distance at a point: trilinear where all corners are known, else of the nearest node.
struct Seen3 {
  bool free = false, known = false;
  float distance_m = 0;
};
// `enough_m`: a node this near to the surface says so of all points about it.
Seen3 seen_at(const TsdfMap& map, MapReader& reader, const Vec3f& p_W, float inv_voxel,
              float enough_m) noexcept {
  Seen3 s;
  const int i = static_cast<int>(std::lround(p_W.x() * inv_voxel)),
            j = static_cast<int>(std::lround(p_W.y() * inv_voxel)),
            k = static_cast<int>(std::lround(p_W.z() * inv_voxel));
  const std::uint32_t word = reader.word(i, j, k);
  if (reader.known(word)) {
    s.known = true;
    s.distance_m = static_cast<float>(TsdfMap::word_distance(word)) * map.metres_per_unit();
    if (std::abs(s.distance_m) < enough_m) return s;
    const auto sample = reader.sample(p_W.cast<double>());
    if (sample.valid) s.distance_m = sample.distance_m;
    return s;
  }
  const TsdfMap::Chunk* chunk = reader.chunk_of(i >> 6, j >> 6, k >> 6);
  if (chunk == nullptr) return s;
  const auto at = static_cast<std::size_t>(TsdfMap::in_chunk(i >> 3, j >> 3, k >> 3));
  const std::int32_t b = chunk->block[at];
  if (b == TsdfMap::kNoBlock) {
    const int bit = (((i & 7) >> 1) * 4 + ((j & 7) >> 1)) * 4 + ((k & 7) >> 1);
    s.free = ((chunk->free[at] >> bit) & 1U) != 0;
  } else {
    s.free = ((map.block_free(b)[i & 7] >> ((j & 7) * 8 + (k & 7))) & 1U) != 0;
  }
  return s;
}

}  // namespace

// Of every `step`th pixel. The count of those that speak for motion.
int MotionWatch::gather_evidence(const TsdfMap& map, const DepthLevel& live, const Pose& X_WC,
                                 bool all, int step) noexcept {
  MapReader reader(map, 1.0);
  const CellSums& sums = consensus_.sums();
  const Eigen::Matrix3f R = X_WC.linear().cast<float>();
  const Vec3f t = X_WC.translation().cast<float>();
  const auto inv_voxel = static_cast<float>(1 / map.voxel_size());
  std::fill_n(evidence_.begin(), width_ * height_, std::uint8_t{kNone});
  // What is seen free lies so far before a surface at least.
  const auto clear = static_cast<float>(0.8 * map.truncation());
  int count = 0;
  for (int c = 0; c < sums.size(); ++c) {
    const auto cell = static_cast<std::size_t>(c);
    if (!(sums.live[cell] > 0)) continue;
    const bool fits = consensus_.fits_noise(c);
    if (!all && fits && sums.pairs[cell] >= 0.85F * sums.live[cell]) continue;
    const int u0 = c % sums.columns * CellSums::kEdge, v0 = c / sums.columns * CellSums::kEdge;
    for (int v = v0; v < std::min(v0 + CellSums::kEdge, height_); v += step) {
      for (int u = u0; u < std::min(u0 + CellSums::kEdge, width_); u += step) {
        const int i = v * width_ + u;
        if (!(live.depth.row(v)[u] > 0)) continue;
        const Vec3f p_C = point_C(live, i);
        const Vec3f p_W = R * p_C + t;
        now_W_[static_cast<std::size_t>(i)] = p_W;
        const float limit = front_limit(p_C.z());
        const Seen3 s = seen_at(map, reader, p_W, inv_voxel, fits ? limit - voxel_m_ : 0);
        std::uint8_t& e = evidence_[static_cast<std::size_t>(i)];
        // A place that was free and is not any more is evidence until it has been so for long.
        bool front = s.known && s.distance_m > limit;
        if (s.free && limit < clear) {
          front = true;
        } else if (s.free) {  // and not just before what the noise may have moved
          const Vec3f behind_W = R * (p_C * (1 + limit / p_C.z())) + t;
          const Seen3 b = seen_at(map, reader, behind_W, inv_voxel, 0);
          front = b.free || (b.known && b.distance_m > 0);
        }
        const Place* place = recent_ > 0 ? place_of(p_W, false) : nullptr;
        if (place != nullptr) {
          const auto age = static_cast<int>(place->last - place->first);
          e = age < kYoungFrames ? kYoung : age < config_.rest_frames ? kOld : kRested;
        } else if (front) {
          e = kFree;
        } else if (s.known && !fits && std::abs(s.distance_m) > 0.5F * limit) {
          e = kOff;
        } else if (s.known && std::abs(s.distance_m) < limit) {
          e = kAgrees;
        }
        count += e >= kFree ? 1 : 0;
      }
    }
  }
  return count;
}

// Evidence in patches, into seed_.
int MotionWatch::patches() noexcept {
  int count = 0;
  std::fill_n(seed_.begin(), width_ * height_, std::uint8_t{0});
  for (int v = 1; v + 1 < height_; ++v) {
    for (int u = 1; u + 1 < width_; ++u) {
      const int i = v * width_ + u;
      if (evidence_[static_cast<std::size_t>(i)] < kFree) continue;
      int about = -1;
      for (int k = 0; k < 9; ++k)
        about += evidence_[static_cast<std::size_t>(i + (k / 3 - 1) * width_ + k % 3 - 1)] >= kFree
                     ? 1
                     : 0;
      if (about < kLeastAbout) continue;
      seed_[static_cast<std::size_t>(i)] = 1;
      if (evidence_[static_cast<std::size_t>(i)] == kFree)
        static_cast<void>(place_of(now_W_[static_cast<std::size_t>(i)], true));
      ++count;
    }
  }
  return count;
}

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
    judge_thing(first, end, thing);
    first = end;
  }
}

// The place that a point lies in. A table of places, hashed: where all that it may lie at are taken it is not kept.
MotionWatch::Place* MotionWatch::place_of(const Vec3f& p_W, bool make, bool seen) noexcept {
  const auto inv = static_cast<float>(1 / config_.rest_cell_m);
  const auto x = static_cast<std::int32_t>(std::floor(p_W.x() * inv)),
             y = static_cast<std::int32_t>(std::floor(p_W.y() * inv)),
             z = static_cast<std::int32_t>(std::floor(p_W.z() * inv));
  const auto now = static_cast<std::uint32_t>(frame_);
  const std::size_t home = hash_of(x, y, z);
  Place* empty = nullptr;
  for (std::size_t n = 0; n < kProbes; ++n) {
    Place& r = places_[(home + n) & (kRestTable - 1)];
    const bool kept = r.last != 0 && r.last + kRestGap >= now;
    if (kept && r.x == x && r.y == y && r.z == z) {
      if (seen) r.last = now;
      return &r;
    }
    if (!kept && empty == nullptr) empty = &r;
  }
  if (empty == nullptr || !make) return nullptr;
  *empty = {x, y, z, now, now};
  return empty;
}

// Seen at a flat angle by a camera that drives, a surface is met in other places each time.
bool MotionWatch::grazed(int i) const noexcept {
  const Vec3f& p_W = now_W_[static_cast<std::size_t>(i)];
  float least = 1e9F, most = 0;
  for (const int d : {-1, 1, -width_, width_}) {  // all have depth: it is of a core
    const float step_m = (now_W_[static_cast<std::size_t>(i + d)] - p_W).norm();
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

void MotionWatch::judge_thing(int first, int end, const Thing& thing) noexcept {
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
    if (grazed(queue_[static_cast<std::size_t>(at)]) || beside_rested(now_W_[i])) --young;
  }
  const bool stands = young < few;
  if (stands) {
    for (int at = first; at < end; ++at) {
      const auto i = static_cast<std::size_t>(queue_[static_cast<std::size_t>(at)]);
      Place* place = evidence_[i] > kRested ? place_of(now_W_[i], true) : nullptr;
      if (place != nullptr)
        place->first =
            place->last - std::min(place->last, static_cast<std::uint32_t>(config_.rest_frames));
    }
    return;
  }
  for (int at = first; at < end; ++at) {
    const auto i = static_cast<std::size_t>(queue_[static_cast<std::size_t>(at)]);
    mask_[i] = apart || seed_[i] != 0 ? 1 : 0;
    if (mask_[i] != 0 && evidence_[i] != kAgrees) static_cast<void>(place_of(now_W_[i], true));
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
