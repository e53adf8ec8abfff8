#include "perception/motion/motion_evidence.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace perception::motion {

namespace {

// chosen on: not recorded; judged on: moving 606, moving 707
constexpr int kYoungFrames = 8;
constexpr int kLeastAbout = 5;  // of the 8 neighbours, in a patch
// chosen on: moving 303 (43), moving 101 (78, 116); judged on: moving 606, moving 707
constexpr float kMostRecede_m =
    0.2F;  // behind the surface it left: the way that pairs are looked for in
// chosen on: moving 101, moving 404 (movers from the first frame on, share >= .12), moving 1 (9), moving 505 (ten at level 2), recording; judged on: moving 606
constexpr int kLeastShown = 3;  // of 3 x 3 pixels of the view
// chosen on: moving 51 (3, 22), moving 7 (6), moving 53 (5), recording backwards; judged on: moving 606, moving 707
// A map that has drifted misses what stands still by more than noise: RMS of the tracker's
// residuals over some frames, at most so much; five of what is beyond the first, which noise and
// voxels make (.6 to .8 mm in rendered rooms, 2 to 5 in the recording), are no motion yet.
constexpr float kFreeMapError_m = 0.001F, kMostMapError_m = 0.005F, kOfMapError = 5,
                kMapErrorGain = 1.0F / 16;

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
Seen3 seen_at(const MapView& map, MapReader& reader, const Vec3f& p_W, float inv_voxel,
              float enough_m) noexcept {
  Seen3 s;
  const int i = static_cast<int>(std::lround(p_W.x() * inv_voxel)),
            j = static_cast<int>(std::lround(p_W.y() * inv_voxel)),
            k = static_cast<int>(std::lround(p_W.z() * inv_voxel));
  const std::uint32_t word = reader.word(i, j, k);
  if (reader.known(word)) {
    s.known = true;
    s.distance_m = static_cast<float>(MapLayout::word_distance(word)) * map.metres_per_unit();
    if (std::abs(s.distance_m) < enough_m) return s;
    const auto sample = reader.sample(p_W.cast<double>());
    if (sample.valid) s.distance_m = sample.distance_m;
    return s;
  }
  const MapLayout::Chunk* chunk = reader.chunk_of(i >> 6, j >> 6, k >> 6);
  if (chunk == nullptr) return s;
  const auto at = static_cast<std::size_t>(MapLayout::in_chunk(i >> 3, j >> 3, k >> 3));
  const std::int32_t b = chunk->block[at];
  if (b == MapLayout::kNoBlock) {
    const int bit = (((i & 7) >> 1) * 4 + ((j & 7) >> 1)) * 4 + ((k & 7) >> 1);
    s.free = ((chunk->free[at] >> bit) & 1U) != 0;
  } else {
    s.free = ((map.block_free(b)[i & 7] >> ((j & 7) * 8 + (k & 7))) & 1U) != 0;
  }
  return s;
}

}  // namespace

MotionEvidence::MotionEvidence(const MotionConfig& config, const TrackerConfig& tracker,
                               const WatchedImage& image, const Consensus& consensus,
                               PlaceMemory& places)
    : config_(config),
      tracker_(tracker),
      image_(image),
      consensus_(consensus),
      places_(places),
      evidence_(WatchedImage::kMost + 16),  // read eight at a time
      seed_(WatchedImage::kMost) {}

void MotionEvidence::compare_with(const ModelView& model) noexcept {
  model_ = model, X_FW_ = model.X_WF.inverse(Eigen::Isometry);
}

void MotionEvidence::settle(double residual_m) noexcept {
  map_error_m_ +=
      kMapErrorGain * (std::min(static_cast<float>(residual_m), kMostMapError_m) - map_error_m_);
}

float MotionEvidence::front_limit(float z) const noexcept {
  const float beyond = std::max(z - static_cast<float>(tracker_.noise_from_m), 0.0F);
  const float sigma =
      0.5F * static_cast<float>(tracker_.noise_m +
                                tracker_.noise_per_m2 * static_cast<double>(beyond * beyond));
  return static_cast<float>(config_.front_m) +
         kOfMapError * std::max(0.0F, map_error_m_ - kFreeMapError_m) +
         static_cast<float>(config_.front_voxel) * image_.voxel_m +
         static_cast<float>(config_.front_sigma) * sigma;
}

void MotionEvidence::start(const MapView& map, const Pose& X_WC) noexcept {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) agree_.R_W[3 * i + j] = static_cast<float>(X_WC.linear()(i, j));
    agree_.t_W[i] = static_cast<float>(X_WC.translation()(i));
  }
  agree_.inv_voxel = static_cast<float>(1 / map.voxel_size());
  agree_.metres_per_unit = map.metres_per_unit();
  // front_limit() less a voxel, and what its digits may differ by.
  constexpr float kDigits_m = 1e-6F;
  agree_.base_m = front_limit(0) - image_.voxel_m - kDigits_m;
  agree_.from_m = static_cast<float>(tracker_.noise_from_m);
  agree_.per_m2 = 0.499999F * static_cast<float>(config_.front_sigma) *
                  static_cast<float>(tracker_.noise_per_m2);
  agree_.places = image_.recent > 0 ? places_.taken() : nullptr;
  agree_.inv_place = static_cast<float>(1 / config_.rest_cell_m);
  clear_m_ = static_cast<float>(0.8 * map.truncation());
  marked_.fill(0);
  std::fill_n(evidence_.begin(), image_.size() + 16, std::uint8_t{kNone});
}

// A point where nobody has looked yet, because a surface was before it: is that surface on the ray
// to it? Then what was there has gone, or has gone back to where the point is. The last image's
// model says where to ask; whether the ray meets it, and does not pass beside, the map does.
bool MotionEvidence::seen_through(const MapView& map, MapReader& reader, const Vec3f& p_C,
                                  const Vec3f& p_W, float limit_m) noexcept {
  const Vec3 p_F = X_FW_ * p_W.cast<double>();
  const Intrinsics& k = model_.intrinsics;
  if (!(p_F.z() > 0.1)) return false;
  const Eigen::Vector2d px = k.project(p_F) + Eigen::Vector2d(0.5, 0.5);
  if (!(px.x() >= 0 && px.y() >= 0 && px.x() < k.width && px.y() < k.height)) return false;
  const float shown = model_.at(static_cast<int>(px.x()), static_cast<int>(px.y()))[3];
  const auto z = static_cast<float>(p_F.z());
  if (!(shown > 0) || shown > z - limit_m - clear_m_ || shown < z - kMostRecede_m) return false;
  const float about = p_C.z() * shown / z, step = image_.voxel_m;
  bool outside = false;
  for (float d = about - 2 * clear_m_; d < std::min(about + 2 * clear_m_, p_C.z() - limit_m);
       d += step) {
    const Seen3 s = seen_at(map, reader, turned_W(p_C * (d / p_C.z())), agree_.inv_voxel,
                            0.5F * image_.voxel_m);
    if (outside && s.known && s.distance_m < 0.25F * image_.voxel_m) return true;
    outside = s.free || (s.known && s.distance_m > 0) || (outside && !s.known);
  }
  return false;
}

// What a pixel says, of a cell that fits its noise or does not.
std::uint8_t MotionEvidence::evidence_at(const MapView& map, MapReader& reader,
                                         const DepthLevel& live, int i, bool fits) noexcept {
  const Vec3f p_C = image_.point_C(live, i);
  const Vec3f p_W = turned_W(p_C);
  const float limit = front_limit(p_C.z());
  const Seen3 s = seen_at(map, reader, p_W, agree_.inv_voxel, fits ? limit - image_.voxel_m : 0);
  bool front = s.known && s.distance_m > limit;
  if (s.free && limit < clear_m_) {
    front = true;
  } else if (s.free) {  // and not just before what the noise may have moved
    const Vec3f behind_W = turned_W(p_C * (1 + limit / p_C.z()));
    const Seen3 b = seen_at(map, reader, behind_W, agree_.inv_voxel, 0);
    front = b.free || (b.known && b.distance_m > 0);
  }
  // A place that was free and is not any more is evidence until it has been so for long.
  const PlaceMemory::Place* place = image_.recent > 0 ? places_.find(p_W, false) : nullptr;
  if (place != nullptr) {
    const int age = place->age();
    return age < kYoungFrames ? kYoung : age < config_.rest_frames ? kOld : kRested;
  }
  if (front || (!s.known && !s.free && seen_through(map, reader, p_C, p_W, limit))) return kFree;
  if (s.known && !fits && std::abs(s.distance_m) > 0.5F * limit) return kOff;
  return s.known && std::abs(s.distance_m) < limit ? kAgrees : kNone;
}

// Marks the pixels of some rows of a cell that agree, and those that have to be asked.
void MotionEvidence::mark_cell(MapReader& reader, const DepthLevel& live, int c,
                               unsigned rows) noexcept {
  constexpr int kEdge = CellSums::kEdge;
  static_assert(kEdge == kAcross);
  auto& marked = marked_[static_cast<std::size_t>(c)];
  const int columns = consensus_.sums().columns;
  const int u0 = c % columns * kEdge, v0 = c / columns * kEdge;
  AgreeJob& job = agree_;
  job.rows = rows & ~static_cast<unsigned>(marked) &
             ((1U << static_cast<unsigned>(std::min(kEdge, image_.height - v0))) - 1);
  if (job.rows == 0) return;
  marked |= static_cast<std::uint8_t>(job.rows);
  job.z = live.depth.row(v0) + u0;
  job.stride = live.depth.stride();
  job.x_factor = live.x_factor.data() + u0 + PaddedImage::kMargin;
  job.y_factor = live.y_factor.data() + v0 + PaddedImage::kMargin;
  RowBits found[kEdge];
  // What lies on the surface agrees where the cell fits; where it does not, its distance is asked
  // for.
  if (consensus_.fits_noise(c))
    find_agreeing(job, reader, found);
  else
    find_readings(job, found);
  const auto across = static_cast<std::size_t>(std::min(kEdge, image_.width - u0));
  for (unsigned left = job.rows; left != 0; left &= left - 1) {
    const int r = std::countr_zero(left);
    const std::uint64_t row =
        kAgrees * kBytesOf.bytes[found[r].agrees] | kUnasked * kBytesOf.bytes[found[r].others];
    std::uint8_t* to = evidence_.data() + (v0 + r) * image_.width + u0;
    if (across == kEdge)
      std::memcpy(to, &row, kEdge);
    else
      std::memcpy(to, &row, across);
  }
}

bool MotionEvidence::ask(const MapView& map, MapReader& reader, const DepthLevel& live,
                         int i) noexcept {
  std::uint8_t& e = evidence_[static_cast<std::size_t>(i)];
  if (e == kUnasked)
    e = evidence_at(map, reader, live, i,
                    consensus_.fits_noise(image_.cell_of(i % image_.width, i / image_.width)));
  return e >= kFree;
}

// Cells that may hold something: those that do not fit, or do not meet their surface.
bool MotionEvidence::may_hold(int c) const noexcept {
  const auto cell = static_cast<std::size_t>(c);
  const CellSums& sums = consensus_.sums();
  return sums.live[cell] > 0 &&
         !(consensus_.fits_noise(c) && sums.pairs[cell] >= 0.85F * sums.live[cell]);
}

bool MotionEvidence::glimpse(const MapView& map, MapReader& reader, const DepthLevel& live,
                             int least) noexcept {
  constexpr int kEdge = CellSums::kEdge;
  const int columns = consensus_.sums().columns;
  for (int c = 0, count = 0; c < consensus_.sums().size(); ++c) {
    if (!may_hold(c)) continue;
    mark_cell(reader, live, c, kEvenRows);
    const int u0 = c % columns * kEdge, v0 = c / columns * kEdge;
    for (int v = v0; v < std::min(v0 + kEdge, image_.height); v += 2) {
      const auto beyond = static_cast<unsigned>(8 * std::max(0, u0 + kEdge - image_.width));
      std::uint64_t speak = speaking_at(v * image_.width + u0) & (kEvenBytes >> beyond);
      for (; speak != 0; speak &= speak - 1)
        count +=
            ask(map, reader, live, v * image_.width + u0 + std::countr_zero(speak) / 8) ? 1 : 0;
    }
    if (count >= least) return true;
  }
  return least <= 0;
}

// Does a pixel above or below a cell's row speak for motion, or may it, or of the two either side?
bool MotionEvidence::speaks_beside(int u0, int v) const noexcept {
  const int above = std::max((v - 1) * image_.width + u0 - 2, 0), below = above + 2 * image_.width;
  std::uint64_t speak = speaking_at(above) | speaking_at(above + 6);
  if (v + 1 < image_.height) speak |= speaking_at(below) | speaking_at(below + 6);
  return speak != 0;
}

// Of cells that may hold something their even rows, and of the odd ones those beside something. (A
// patch is five about one: three of them, or the one, are in an even row.)
void MotionEvidence::gather(const MapView& map, MapReader& reader, const DepthLevel& live,
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
    for (int r = 1; r < std::min(kEdge, image_.height - v0); r += 2)
      rows |= (speaks_beside(u0, v0 + r) ? 1U : 0U) << static_cast<unsigned>(r);
    mark_cell(reader, live, c, rows);
  }
  for (int i = 0; all && i < image_.size(); i += 8) {
    for (std::uint64_t speak = speaking_at(i); speak != 0; speak &= speak - 1)
      static_cast<void>(ask(map, reader, live, i + std::countr_zero(speak) / 8));
  }
}

int MotionEvidence::patches(const MapView& map, MapReader& reader,
                            const DepthLevel& live) noexcept {
  static_assert(kFree == 3);  // speaking_at()
  int count = 0;
  std::fill_n(seed_.begin(), image_.size(), std::uint8_t{0});
  const auto about = [&](int i) {  // of the eight neighbours
    std::uint32_t speak = 0;       // a byte a column
    for (int v = -1; v <= 1; ++v) {
      std::uint32_t row = 0;
      std::memcpy(&row, evidence_.data() + i + v * image_.width - 1, sizeof row);
      speak += (row + 0x7d7d7dU) >> 7U & 0x010101U;
    }
    return static_cast<int>((speak + (speak >> 8U) + (speak >> 16U)) & 0xffU) - 1;
  };
  const int end = (image_.height - 1) * image_.width;
  for (int first = image_.width; first < end; first += 8) {
    for (std::uint64_t speak = speaking_at(first); speak != 0; speak &= speak - 1) {
      const int i = first + std::countr_zero(speak) / 8, u = i % image_.width;
      if (u == 0 || u + 1 == image_.width || i >= end || about(i) < kLeastAbout) continue;
      if (!ask(map, reader, live, i)) continue;
      for (int k = 0; k < 9; ++k)
        static_cast<void>(ask(map, reader, live, i + (k / 3 - 1) * image_.width + k % 3 - 1));
      if (about(i) < kLeastAbout) continue;
      seed_[static_cast<std::size_t>(i)] = 1;
      if (evidence_[static_cast<std::size_t>(i)] == kFree)
        static_cast<void>(places_.find(point_W(live, i), true));
      ++count;
    }
  }
  return count;
}

bool MotionEvidence::shows_nothing(MapReader& reader, const Pose& X_FC,
                                   const Vec3f& p_C) const noexcept {
  const Vec3 p_F = X_FC * p_C.cast<double>();
  const Intrinsics& k = model_.intrinsics;
  if (!(p_F.z() > 0)) return false;
  const Eigen::Vector2d px = k.project(p_F) + Eigen::Vector2d(0.5, 0.5);
  if (!(px.x() >= 1 && px.y() >= 1 && px.x() < k.width - 1 && px.y() < k.height - 1)) return false;
  int shown = 0;
  for (int n = 0; n < 9; ++n)
    shown += model_.at(static_cast<int>(px.x()) + n % 3 - 1,
                       static_cast<int>(px.y()) + n / 3 - 1)[3] > 0;
  if (shown >= kLeastShown) return false;
  const Vec3 node = (model_.X_WF * p_F) / static_cast<double>(image_.voxel_m);
  return reader.known(reader.word(static_cast<int>(std::lround(node.x())),
                                  static_cast<int>(std::lround(node.y())),
                                  static_cast<int>(std::lround(node.z()))));
}

}  // namespace perception::motion
