// Which things move: evidence, and what it is grown to (motion_watch.hpp).
#include "perception/motion/motion_watch.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace perception {

namespace {

constexpr int kYoungFrames = 8, kYoungPercent = 3;
constexpr std::uint32_t kRestGap = 5;  // frames that a cell may go unseen
constexpr int kLeastAbout = 5;         // of the 8 neighbours, in a patch
constexpr float kConcave = 0.4F;       // bend over two pixels either side that ends a thing
// Of a coarse pixel. From kFree on it speaks for motion; kUnasked: it may.
enum Evidence : std::uint8_t { kNone, kAgrees, kRested, kFree, kOff, kYoung, kOld, kUnasked };
// By eight bits: a byte of 1 for each.
struct BytesOf {
  std::uint64_t bytes[256] = {};
  constexpr BytesOf() {
    for (std::uint64_t m = 0; m < 256; ++m)
      for (unsigned n = 0; n < 8; ++n) bytes[m] |= (m >> n & 1U) << 8 * n;
  }
};
constexpr BytesOf kBytesOf;
constexpr unsigned kEvenRows = 0x55;
constexpr std::uint64_t kEvenBytes = 0x00ff00ff00ff00ffU;

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

Vec3f MotionWatch::turned_W(const Vec3f& p_C) const noexcept {
  const auto axis = [&](int a) {
    return motion::turned(agree_.R_W + 3 * a, agree_.t_W[a], p_C.x(), p_C.y(), p_C.z());
  };
  return {axis(0), axis(1), axis(2)};
}

// Of the camera at X_WC; nothing has been looked at.
void MotionWatch::start_evidence(const TsdfMap& map, const Pose& X_WC) noexcept {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) agree_.R_W[3 * i + j] = static_cast<float>(X_WC.linear()(i, j));
    agree_.t_W[i] = static_cast<float>(X_WC.translation()(i));
  }
  agree_.inv_voxel = static_cast<float>(1 / map.voxel_size());
  agree_.metres_per_unit = map.metres_per_unit();
  // front_limit() less a voxel, and what its digits may differ by.
  constexpr float kDigits_m = 1e-6F;
  agree_.base_m = front_limit(0) - voxel_m_ - kDigits_m;
  agree_.from_m = static_cast<float>(tracker_.noise_from_m);
  agree_.per_m2 = 0.499999F * static_cast<float>(config_.front_sigma) *
                  static_cast<float>(tracker_.noise_per_m2);
  agree_.places = recent_ > 0 ? taken_.data() : nullptr;
  agree_.inv_place = static_cast<float>(1 / config_.rest_cell_m);
  clear_m_ = static_cast<float>(0.8 * map.truncation());
  marked_.fill(0);
  std::fill_n(evidence_.begin(), width_ * height_ + 16, std::uint8_t{kNone});
}

// What a pixel says, of a cell that fits its noise or does not.
std::uint8_t MotionWatch::evidence_at(const TsdfMap& map, MapReader& reader, const DepthLevel& live,
                                      int i, bool fits) noexcept {
  const Vec3f p_C = point_C(live, i);
  const Vec3f p_W = turned_W(p_C);
  const float limit = front_limit(p_C.z());
  const Seen3 s = seen_at(map, reader, p_W, agree_.inv_voxel, fits ? limit - voxel_m_ : 0);
  bool front = s.known && s.distance_m > limit;
  if (s.free && limit < clear_m_) {
    front = true;
  } else if (s.free) {  // and not just before what the noise may have moved
    const Vec3f behind_W = turned_W(p_C * (1 + limit / p_C.z()));
    const Seen3 b = seen_at(map, reader, behind_W, agree_.inv_voxel, 0);
    front = b.free || (b.known && b.distance_m > 0);
  }
  // A place that was free and is not any more is evidence until it has been so for long.
  const Place* place = recent_ > 0 ? place_of(p_W, false) : nullptr;
  if (place != nullptr) {
    const auto age = static_cast<int>(place->last - place->first);
    return age < kYoungFrames ? kYoung : age < config_.rest_frames ? kOld : kRested;
  }
  if (front) return kFree;
  if (s.known && !fits && std::abs(s.distance_m) > 0.5F * limit) return kOff;
  return s.known && std::abs(s.distance_m) < limit ? kAgrees : kNone;
}

// Marks the pixels of some rows of a cell that agree, and those that have to be asked.
void MotionWatch::mark_cell(MapReader& reader, const DepthLevel& live, int c,
                            unsigned rows) noexcept {
  constexpr int kEdge = CellSums::kEdge;
  static_assert(kEdge == motion::kAcross);
  auto& marked = marked_[static_cast<std::size_t>(c)];
  const int columns = consensus_.sums().columns;
  const int u0 = c % columns * kEdge, v0 = c / columns * kEdge;
  motion::AgreeJob& job = agree_;
  job.rows = rows & ~static_cast<unsigned>(marked) &
             ((1U << static_cast<unsigned>(std::min(kEdge, height_ - v0))) - 1);
  if (job.rows == 0) return;
  marked |= static_cast<std::uint8_t>(job.rows);
  job.z = live.depth.row(v0) + u0;
  job.stride = live.depth.stride();
  job.x_factor = live.x_factor.data() + u0 + PaddedImage::kMargin;
  job.y_factor = live.y_factor.data() + v0 + PaddedImage::kMargin;
  motion::RowBits found[kEdge];
  // What lies on the surface agrees where the cell fits; where it does not, its distance is asked for.
  if (consensus_.fits_noise(c))
    motion::find_agreeing(job, reader, found);
  else
    motion::find_readings(job, found);
  const auto across = static_cast<std::size_t>(std::min(kEdge, width_ - u0));
  for (unsigned left = job.rows; left != 0; left &= left - 1) {
    const int r = std::countr_zero(left);
    const std::uint64_t row =
        kAgrees * kBytesOf.bytes[found[r].agrees] | kUnasked * kBytesOf.bytes[found[r].others];
    std::uint8_t* to = evidence_.data() + (v0 + r) * width_ + u0;
    if (across == kEdge)
      std::memcpy(to, &row, kEdge);
    else
      std::memcpy(to, &row, across);
  }
}

bool MotionWatch::ask(const TsdfMap& map, MapReader& reader, const DepthLevel& live,
                      int i) noexcept {
  std::uint8_t& e = evidence_[static_cast<std::size_t>(i)];
  if (e == kUnasked)
    e = evidence_at(map, reader, live, i, consensus_.fits_noise(cell_of(i % width_, i / width_)));
  return e >= kFree;
}

// Cells that may hold something: those that do not fit, or do not meet their surface.
bool MotionWatch::may_hold(int c) const noexcept {
  const auto cell = static_cast<std::size_t>(c);
  const CellSums& sums = consensus_.sums();
  return sums.live[cell] > 0 &&
         !(consensus_.fits_noise(c) && sums.pairs[cell] >= 0.85F * sums.live[cell]);
}

// Of every second pixel of every second row of cells that may hold something: do `least` of them speak for motion?
bool MotionWatch::glimpse(const TsdfMap& map, MapReader& reader, const DepthLevel& live,
                          int least) noexcept {
  constexpr int kEdge = CellSums::kEdge;
  const int columns = consensus_.sums().columns;
  for (int c = 0, count = 0; c < consensus_.sums().size(); ++c) {
    if (!may_hold(c)) continue;
    mark_cell(reader, live, c, kEvenRows);
    const int u0 = c % columns * kEdge, v0 = c / columns * kEdge;
    for (int v = v0; v < std::min(v0 + kEdge, height_); v += 2) {
      const auto beyond = static_cast<unsigned>(8 * std::max(0, u0 + kEdge - width_));
      std::uint64_t speak = speaking_at(v * width_ + u0) & (kEvenBytes >> beyond);
      for (; speak != 0; speak &= speak - 1)
        count += ask(map, reader, live, v * width_ + u0 + std::countr_zero(speak) / 8) ? 1 : 0;
    }
    if (count >= least) return true;
  }
  return least <= 0;
}

// Does a pixel above or below a cell's row speak for motion, or may it, or of the two either side?
bool MotionWatch::speaks_beside(int u0, int v) const noexcept {
  const int above = std::max((v - 1) * width_ + u0 - 2, 0), below = above + 2 * width_;
  std::uint64_t speak = speaking_at(above) | speaking_at(above + 6);
  if (v + 1 < height_) speak |= speaking_at(below) | speaking_at(below + 6);
  return speak != 0;
}

// Marks what may be in a patch, in cells that may hold something: their even rows, and of the odd ones those beside
// something. (A patch is five about one: three of them, or the one, are in an even row.) Or `all`, and asks all of it.
void MotionWatch::gather_evidence(const TsdfMap& map, MapReader& reader, const DepthLevel& live,
                                  bool all) noexcept {
  constexpr int kEdge = CellSums::kEdge;
  const CellSums& sums = consensus_.sums();
  for (int c = 0; c < sums.size(); ++c)
    if (all ? sums.live[static_cast<std::size_t>(c)] > 0 : may_hold(c))
      mark_cell(reader, live, c, all ? 0xffU : kEvenRows);
  for (int c = 0; !all && c < sums.size(); ++c) {
    if (!may_hold(c)) continue;
    const int u0 = c % sums.columns * kEdge, v0 = c / sums.columns * kEdge;
    unsigned rows = 0;
    for (int r = 1; r < std::min(kEdge, height_ - v0); r += 2)
      rows |= (speaks_beside(u0, v0 + r) ? 1U : 0U) << static_cast<unsigned>(r);
    mark_cell(reader, live, c, rows);
  }
  for (int i = 0; all && i < width_ * height_; i += 8) {
    for (std::uint64_t speak = speaking_at(i); speak != 0; speak &= speak - 1)
      static_cast<void>(ask(map, reader, live, i + std::countr_zero(speak) / 8));
  }
}

// Evidence in patches, into seed_. Asked is what may be in one.
int MotionWatch::patches(const TsdfMap& map, MapReader& reader, const DepthLevel& live) noexcept {
  static_assert(kFree == 3);  // speaking_at()
  int count = 0;
  std::fill_n(seed_.begin(), width_ * height_, std::uint8_t{0});
  const auto about = [&](int i) {  // of the eight neighbours
    std::uint32_t speak = 0;       // a byte a column
    for (int v = -1; v <= 1; ++v) {
      std::uint32_t row = 0;
      std::memcpy(&row, evidence_.data() + i + v * width_ - 1, sizeof row);
      speak += (row + 0x7d7d7dU) >> 7U & 0x010101U;
    }
    return static_cast<int>((speak + (speak >> 8U) + (speak >> 16U)) & 0xffU) - 1;
  };
  const int end = (height_ - 1) * width_;
  for (int first = width_; first < end; first += 8) {
    for (std::uint64_t speak = speaking_at(first); speak != 0; speak &= speak - 1) {
      const int i = first + std::countr_zero(speak) / 8, u = i % width_;
      if (u == 0 || u + 1 == width_ || i >= end || about(i) < kLeastAbout) continue;
      if (!ask(map, reader, live, i)) continue;
      for (int k = 0; k < 9; ++k)
        static_cast<void>(ask(map, reader, live, i + (k / 3 - 1) * width_ + k % 3 - 1));
      if (about(i) < kLeastAbout) continue;
      seed_[static_cast<std::size_t>(i)] = 1;
      if (evidence_[static_cast<std::size_t>(i)] == kFree)
        static_cast<void>(place_of(point_W(live, i), true));
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
    judge_thing(live, first, end, thing);
    first = end;
  }
}

// The place that a point lies in. A table of places, hashed: one that is taken by another is not kept.
MotionWatch::Place* MotionWatch::place_of(const Vec3f& p_W, bool make) noexcept {
  const auto inv = static_cast<float>(1 / config_.rest_cell_m);
  const auto x = static_cast<std::int32_t>(std::floor(p_W.x() * inv)),
             y = static_cast<std::int32_t>(std::floor(p_W.y() * inv)),
             z = static_cast<std::int32_t>(std::floor(p_W.z() * inv));
  const std::uint32_t slot = motion::place_slot(x, y, z);
  Place& r = places_[slot];
  const auto now = static_cast<std::uint32_t>(frame_);
  const bool kept = r.last != 0 && r.last + kRestGap >= now;
  if (kept && r.x == x && r.y == y && r.z == z) {
    r.last = now;
    return &r;
  }
  std::uint32_t& taken = taken_[slot / 32];
  if (!kept) taken &= ~(1U << slot % 32);
  if (kept || !make) return nullptr;
  taken |= 1U << slot % 32;
  r = {x, y, z, now, now};
  return &r;
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
  const bool stands = thing.young < std::max(config_.least_pixels, size * kYoungPercent / 100);
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
