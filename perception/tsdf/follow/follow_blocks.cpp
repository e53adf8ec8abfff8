#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "perception/tsdf/follow/follow_frame.hpp"

namespace perception {
namespace {

using namespace follow;

// chosen on: follow 1000; judged on: follow 2000
constexpr double kScatter = 5;  // scatters of the image's tiles that a block must be off by
// The limits for a block that was moved in the last kStill frames.
constexpr double kLeastMoving_m = 0.25e-3, kErrorsMoving = 2.5;
constexpr double kFast_m = 0.015;     // across the surface in a frame: no slow motion
constexpr double kOfExplained = 0.3;  // of what the camera's error explains may be wrong
constexpr double kNoiseOfFew = 1.5;   // of the sensor's: their slant is not known
constexpr std::uint32_t kMoved = 12 * MapLayout::kWeightOne, kEnds = 2 * MapLayout::kWeightOne;

}  // namespace

// Offset of a node by the image, m along the ray as in the update. NaN: no reading, or beyond the
// band (seen through, or hidden).
double FollowFrame::node_off(const UpdateCamera& cam, const float (&p0)[3], int n,
                             double* z) const noexcept {
  float p[3];
  for (int a = 0; a < 3; ++a) p[a] = p0[a] + cam.node[a][n];
  if (!(p[2] >= CameraBoxes::kLeastZ)) return std::nan("");
  const float inverse = 1.0F / p[2], x = p[0] * inverse, y = p[1] * inverse;
  const float u = x * cam.fx + cam.cx_plus_half, v = y * cam.fy + cam.cy_plus_half;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(cam.width) &&
        v < static_cast<float>(cam.height)))
    return std::nan("");
  const std::uint32_t pixel = cam.pixels[static_cast<int>(v) * cam.width + static_cast<int>(u)];
  if (((pixel >> 16U) & 0xffU) == 0) return std::nan("");
  const float depth = static_cast<float>(pixel & 0xffffU) * 0.001F;
  *z = static_cast<double>(depth);
  return static_cast<double>((depth - p[2]) * std::sqrt((1.0F + x * x) + y * y));
}

// Offset of the block's surface and its standard error; error 0: too few nodes to tell. False: no
// judgement is possible.
bool FollowFrame::look(const UpdateCamera& cam, std::int32_t block, Looked& out,
                       Vec3& slope) const noexcept {
  float p0[3];
  first_node_C(view_.X_CW, store_.voxel, store_.blocks.coord(block), p0);
  const double unit = static_cast<double>(store_.metres_per_unit);
  const std::uint32_t* words = store_.blocks.words(block);
  const auto sure = [words](int n) {
    return MapLayout::word_weight(words[n]) >= MapLayout::kObservedWeight &&
           std::abs(MapLayout::word_distance(words[n])) < kAtTheEnd;
  };
  std::array<double, MapLayout::kBlockVoxels> offs, room;
  std::size_t count = 0;
  double z_sum = 0;
  int slopes = 0;
  slope.setZero();
  for (int n = 0; n < MapLayout::kBlockVoxels; ++n) {
    if (!sure(n)) continue;
    double z = 0;
    const int d = MapLayout::word_distance(words[n]);
    const double off = node_off(cam, p0, n, &z) - unit * d;
    if (!(std::abs(off) < kSlowReach * store_.truncation)) continue;
    offs[count++] = off;
    z_sum += z;
    if ((n & 7) == 7 || ((n >> 3) & 7) == 7 || (n >> 6) == 7) continue;
    if (!sure(n + 64) || !sure(n + 8) || !sure(n + 1)) continue;
    slope += Vec3(MapLayout::word_distance(words[n + 64]) - d,
                  MapLayout::word_distance(words[n + 8]) - d,
                  MapLayout::word_distance(words[n + 1]) - d);
    ++slopes;
  }
  out.block = block;
  if (count < kFewNodes || slopes == 0) {
    out = {.block = block,
           .noise_m = kNoiseOfFew * sigma_m(count > 0 ? z_sum / static_cast<double>(count) : 1.0),
           .part = true};
    return count > 0;
  }
  slope *= unit / (store_.voxel * slopes);
  const double z = z_sum / static_cast<double>(count);
  // Of a reading along its ray: at a slant more.
  const double axial = sigma_m(z), lateral = 0.4 * z / static_cast<double>(cam.fx);
  const double slant = std::max(0.0, slope.squaredNorm() - 1);
  const double noise = std::sqrt(axial * axial + lateral * lateral * slant);
  Middle of = middle_of({offs.data(), count}, room);
  out.part = of.scatter > kAgree * noise + kTilt * std::abs(of.value);
  if (out.part && !apart_from_standing({offs.data(), count}, room, noise, count, of)) return false;
  if (std::abs(of.value) > kFast_m * slope.norm()) return false;
  // Nodes behind each other share a reading unless the ray is slanted; at most the block's pixels.
  const double px = store_.voxel * static_cast<double>(cam.fx) / z;
  const double slope2 = std::max(1.0, slope.squaredNorm());
  const double step_px = px * std::sqrt(1 - 1 / slope2);  // from node to node along the normal
  const double deep = std::clamp(2 * store_.truncation / store_.voxel, 1.0, 8.0);
  const double shared = std::clamp(1 / std::max(step_px, 1e-3), 1.0, deep);
  const double readings = std::max(
      4.0, std::min(static_cast<double>(count) / shared, 64 * px * px / std::sqrt(slope2)));
  out.off_m = of.value;
  out.noise_m = std::max(noise, of.scatter);
  out.error_m = 1.25 * out.noise_m / std::sqrt(readings);  // of a median
  return true;
}

// True if the block's offset exceeds noise, the camera's error, and the possible difference between
// views.
bool FollowFrame::is_off(Looked& it, const Vec3& slope, double view_doubt) noexcept {
  // A block that moves is kept where it is seen until it has been still for a while.
  const bool moving = moves(store_.blocks.past(it.block));
  const double least =
      moving ? std::max(kLeastMoving_m, kErrorsMoving * it.error_m) : threshold_m(it.error_m);
  // The camera's error is fitted only where something is off without it.
  if (!moving && std::abs(it.off_m) < least + view_doubt) return false;
  if (!asked_camera_) camera_error();
  if (!camera_.told) return false;
  const Vec3 middle(8 * it.at[0] + 3.5, 8 * it.at[1] + 3.5, 8 * it.at[2] + 3.5);
  const double explained = camera_.row(slope, middle).dot(camera_.twist);
  const double beyond = it.off_m - explained;
  const double scattered = std::max(1.0, kScatter * camera_.scatter),
               doubt = kOfExplained * std::abs(explained) + view_doubt;
  it.moves = std::abs(it.off_m) >= scattered * least + view_doubt &&
             (it.off_m > 0) == (beyond > 0) && std::abs(beyond) >= scattered * least + doubt;
  it.beyond_m = beyond;
  return it.moves || (moving && std::abs(beyond) > doubt);
}

// The block and those beside it, each once; whether any is off.
bool FollowFrame::look_round(const UpdateCamera& cam, std::int32_t block) noexcept {
  const BlockCoord c = store_.blocks.coord(block);
  bool any = false;
  for (int n = 0; n < 27; ++n) {
    const BlockCoord at{c.x + n / 9 - 1, c.y + n / 3 % 3 - 1, c.z + n % 3 - 1};
    const std::int32_t b = store_.blocks.find_block(at);
    if (b == MapLayout::kNoBlock || s_.looked_count == FollowScratch::kMostLooked) continue;
    std::uint32_t& asked = s_.asked[static_cast<std::size_t>(b)];
    if (asked == frame_) continue;
    asked = frame_;
    counts_.tests += MapLayout::kBlockVoxels;
    Looked& it = s_.looked[static_cast<std::size_t>(s_.looked_count)];
    Vec3 slope;
    if (!look(cam, b, it, slope)) continue;
    it.at = {at.x, at.y, at.z};
    if (it.error_m == 0) {
      it.moves = false;
      ++s_.looked_count;
      continue;
    }
    const BlockPast& own = store_.blocks.past(b);
    const BlockPast& seen = own.frame == frame_ ? own : store_.blocks.past(block);
    if (!is_off(it, slope, slope.norm() * view_doubt_m(b, seen))) continue;
    any = true;
    ++s_.looked_count;
  }
  return any;
}

// Each block moves by the mean of its own offset and those of its neighbours that agree; a block
// with few nodes by theirs alone.
void FollowFrame::smooth() noexcept {
  for (int n = 0; n < s_.looked_count; ++n) {
    Looked& it = s_.looked[static_cast<std::size_t>(n)];
    const bool few = it.error_m == 0;
    double weight = 0, sum = 0;
    for (int m = 0; m < s_.looked_count; ++m) {
      const Looked& other = s_.looked[static_cast<std::size_t>(m)];
      bool beside = other.error_m > 0;
      for (std::size_t a = 0; a < 3; ++a) beside = beside && std::abs(other.at[a] - it.at[a]) <= 1;
      const double apart = other.beyond_m - it.beyond_m,
                   known2 = other.error_m * other.error_m + it.error_m * it.error_m;
      if (!beside || (!few && apart * apart > 9 * known2)) continue;
      const double w = 1 / (other.error_m * other.error_m);
      weight += w, sum += w * other.beyond_m;
    }
    if (weight == 0) continue;
    // Less what of it may be noise (the positive part of James and Stein's).
    const double mean = sum / weight;
    it.by_m = mean * std::max(0.0, 1 - 1 / (weight * mean * mean));
    if (few) it.off_m = it.by_m;
  }
}

void FollowFrame::move(const UpdateCamera& cam, const Looked& it) noexcept {
  float p0[3];
  first_node_C(view_.X_CW, store_.voxel, store_.blocks.coord(it.block), p0);
  const double unit = static_cast<double>(store_.metres_per_unit), gate = 4 * it.noise_m;
  const int by = static_cast<int>(std::lround(it.by_m / unit));
  std::uint32_t* words = store_.blocks.words(it.block);
  for (int n = 0; n < MapLayout::kBlockVoxels; ++n) {
    const int d = MapLayout::word_distance(words[n]);
    const std::uint32_t w = MapLayout::word_weight(words[n]);
    if (w == 0) continue;
    if (std::abs(d) >= kAtTheEnd) continue;
    double z = 0;
    const double off = node_off(cam, p0, n, &z) - unit * d;
    const double apart = std::abs(off - it.off_m);  // NaN: nothing is said of it
    if (apart > gate || (it.part && !(apart < std::abs(off)))) continue;
    const int moved = std::clamp(d + by, -MapLayout::kDistanceOne, MapLayout::kDistanceOne);
    words[n] = MapLayout::make_word(moved, static_cast<int>(std::min(w, kMoved)));
  }
  store_.blocks.mark_changed(it.block);
  BlockPast& m = store_.blocks.past(it.block);
  m.now = m.before = {};
  m.eyes = std::min(m.eyes, static_cast<float>(kMoved) / MapLayout::kWeightOne);
  if (it.moves) m.moved = frame_;
}

// What lies at the ends of the band there and beside it is where the surface comes to next.
void FollowFrame::loosen_round(const Looked& it) noexcept {
  for (int n = 0; n < 27; ++n) {
    const std::int32_t b = store_.blocks.find_block(
        {it.at[0] + n / 9 - 1, it.at[1] + n / 3 % 3 - 1, it.at[2] + n % 3 - 1});
    if (b == MapLayout::kNoBlock) continue;
    std::uint32_t& loosened = s_.loosened[static_cast<std::size_t>(b)];
    if (loosened == frame_) continue;
    loosened = frame_;
    std::uint32_t* words = store_.blocks.words(b);
    for (int i = 0; i < MapLayout::kBlockVoxels; ++i) {
      const int d = MapLayout::word_distance(words[i]);
      if (std::abs(d) >= kAtTheEnd && MapLayout::word_weight(words[i]) > kEnds)
        words[i] = MapLayout::make_word(d, static_cast<int>(kEnds));
    }
  }
}

}  // namespace perception
