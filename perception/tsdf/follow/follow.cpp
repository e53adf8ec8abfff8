// A surface that creeps, rises or settles while it is looked at is followed, block by block; what stands keeps the noise of
// its hundred readings.
//
// A running mean of w readings lags w frames behind what moves. How far it lags is seen: readings end off the surface that the
// map has, all of a patch to the same side, and what a mean of a hundred leaves of a slow motion adds up. So:
//
//   1. some readings of the image, on a grid that shifts with the frame, are compared with the map: the field where they end is
//      by how much they are off, along the ray. A block's readings of this and the last frames say how far its surface has
//      moved, and their own scatter how well that is known. Beyond kLeast_m and kErrors standard errors: it may have moved.
//      Nothing did: that was all, and the map is left to the mean.
//   2. an error of the camera's pose is off in the whole image. The small motion that most of the image agrees on is fitted
//      robustly to tiles of it (point to plane); a block has moved only if it is off with and without that motion, by more
//      than the rest of the image scatters. Where no majority agrees nothing is learned.
//   3. such blocks and those beside them are looked at node by node, and what holds is smoothed over neighbours that agree. Their
//      nodes are moved with the surface and count kMoved readings, so that what is left of an error is soon gone; those at the
//      ends of the band, whose distance is a bound, count kEnds.
//
// Distances are along the ray, and so are offsets: over a plane in any direction all nodes of a block move by the same.
// A single place of noise moves nothing: a block's mean has tens of pixels in it.
// Readings that are off by kMost truncations and more are no slow motion: left to the mean, and to the mask of what moves.
// Plain doubles in a fixed order: the same bytes with any instruction set and any number of threads.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/follow/follow_scratch.hpp"
#include "perception/tsdf/follow/follow_statistics.hpp"
#include "perception/tsdf/image/frame_view.hpp"
#include "perception/tsdf/integrate/band_kernel.hpp"
#include "perception/tsdf/kernels/voxel_update.hpp"

namespace perception {
namespace {

using Sums = FollowScratch::Sums;
using Memory = FollowScratch::Memory;
using Looked = FollowScratch::Looked;
using Tile = FollowScratch::Tile;
using namespace follow;

constexpr int kReadings = 3400;  // that are compared in a frame, about
// chosen on: follow 1000; judged on: follow 2000
constexpr double kObservations = 2;
constexpr double kScatter = 5;
// Of a block that was moved in the last kStill frames.
constexpr double kLeastMoving_m = 0.25e-3, kErrorsMoving = 2.5;
constexpr std::uint32_t kStill = 5;
constexpr double kMost = 0.5;      // of the truncation
constexpr double kFast_m = 0.015;  // across the surface in a frame: no slow motion
// From a place that far from the last one, distances along the rays are others, beside edges and at a slant: nothing is followed.
constexpr double kStep_m = 0.04, kTurn_rad = 0.044;
// Of a truncation, times the sine between the rays of now and of then: distances along them differ by that, a band's nodes lying half
// a truncation off their surface.
constexpr double kOfView = 0.5;       // derived
constexpr double kOfExplained = 0.3;  // of what the camera's error explains may be wrong
constexpr double kNoiseOfFew = 1.5;   // of the sensor's: their slant is not known
constexpr float kKept = 0.75F;        // of what earlier frames said, a frame
constexpr std::uint32_t kOne = TsdfMap::kWeightOne, kAs = 12, kMoved = kAs * kOne, kEnds = 2 * kOne;
constexpr int kAtTheEnd = 32000;  // |d|: a bound, not a distance; no data

const Eigen::AlignedBox3d kEverywhere(Vec3::Constant(-1e9), Vec3::Constant(1e9));

// The pixels that are compared.
struct Grid {
  int u0, v0, u1, v1, step;
};
Grid grid_over(int u0, int v0, int u1, int v1, std::uint32_t frame) noexcept {
  const double area = (u1 - u0 + 1.0) * (v1 - v0 + 1.0);
  const int step = std::max(1, static_cast<int>(std::lround(std::sqrt(area / kReadings))));
  const auto shift = [&](std::uint32_t by) {
    return static_cast<int>(by * frame % static_cast<std::uint32_t>(step));
  };
  return {u0 + shift(5), v0 + shift(3), u1, v1, step};
}

}  // namespace

// One frame's look at what may have moved.
class SurfaceFollower {
 public:
  SurfaceFollower(TsdfMap& map, const TsdfMap::View& view) noexcept
      : map_(map), view_(view), s_(*map.follow_), k_(view.frame.intrinsics) {}
  void step(IntegrateStats& stats) noexcept;

 private:
  using Place = std::array<int, 4>;  // of the image: u0, v0, u1, v1
  template <class Fn>
  int compare(const Place& place, const Eigen::AlignedBox3d& box, MapReader& reader,
              Fn&& fn) const noexcept;
  [[nodiscard]] bool compare_blocks(IntegrateStats& stats) noexcept;
  void camera_error() noexcept;
  [[nodiscard]] double node_off(const UpdateCamera& cam, const float (&p0)[3], int n,
                                double* z) const noexcept;
  [[nodiscard]] bool look(const UpdateCamera& cam, std::int32_t block, Looked& out,
                          Vec3& slope) const noexcept;
  [[nodiscard]] bool look_round(const UpdateCamera& cam, std::int32_t block) noexcept;
  [[nodiscard]] bool is_off(Looked& it, const Vec3& slope, double view_doubt) noexcept;
  void smooth() noexcept;
  void move(const UpdateCamera& cam, const Looked& it) noexcept;
  void loosen_round(const Looked& it) noexcept;
  [[nodiscard]] bool moves(const Memory& m) const noexcept {
    return m.moved != 0 && map_.frame_ - m.moved <= kStill;
  }
  void first_node(std::int32_t block, float (&p0)[3]) const noexcept;
  void remember_eye(Memory& m) const noexcept;
  [[nodiscard]] double view_doubt_m(std::int32_t block, const Memory& m) const noexcept;

  TsdfMap& map_;
  const TsdfMap::View& view_;
  FollowScratch& s_;
  const Intrinsics& k_;
  CommonMotion camera_;  // once it is asked for
  bool asked_camera_ = false;
  std::int64_t tests_ = 0;
};

// Readings of the grid that end in the box (voxels), how many; of those that end where the map is known fn(cell, offset along the ray, end in voxels, depth, pixel).
template <class Fn>
int SurfaceFollower::compare(const Place& place, const Eigen::AlignedBox3d& box, MapReader& reader,
                             Fn&& fn) const noexcept {
  const Grid g = grid_over(place[0], place[1], place[2], place[3], map_.frame_);
  const double unit = static_cast<double>(map_.metres_per_unit_), per_voxel = 1 / map_.voxel_;
  const Mat3 R = view_.X_WC.linear() * per_voxel;
  const Vec3 eye = view_.X_WC.translation() * per_voxel;
  int tests = 0;
  for (int v = g.v0; v <= g.v1; v += g.step) {
    const std::uint32_t* row = map_.pyramid_.pixels() + static_cast<std::ptrdiff_t>(v) * k_.width;
    const Vec3 left = R * Vec3(-k_.cx / k_.fx, (v - k_.cy) / k_.fy, 1), right = R.col(0) / k_.fx;
    for (int u = g.u0; u <= g.u1; u += g.step) {
      const std::uint32_t pixel = row[u];
      if (((pixel >> 16U) & 0xffU) == 0) continue;
      const double z = 1e-3 * static_cast<double>(pixel & 0xffffU);
      const Vec3 p = eye + z * (left + u * right);
      if (!box.contains(p)) continue;
      const MapReader::Cell cell = reader.cell(p.x(), p.y(), p.z());
      ++tests;
      if (!cell.valid) continue;
      const double off = -unit * static_cast<double>(cell.value());
      if (std::abs(off) < kMost * map_.truncation_) fn(cell, off, p, z, u, v);
    }
  }
  return tests;
}

// Before the block's frame is told.
void SurfaceFollower::remember_eye(Memory& m) const noexcept {
  if (m.frame == 0 || map_.frame_ - m.frame > kStill) {
    for (int a = 0; a < 3; ++a)
      m.eye_W[static_cast<std::size_t>(a)] = static_cast<float>(s_.eye_W(a));
    m.eyes = static_cast<float>(s_.eyes);
    return;
  }
  m.eyes = std::min(m.eyes + 1, static_cast<float>(map_.config_.max_weight));
  for (int a = 0; a < 3; ++a) {
    float& eye = m.eye_W[static_cast<std::size_t>(a)];
    eye += (static_cast<float>(view_.X_WC.translation()(a)) - eye) / m.eyes;
  }
}

// How far readings from here may be off what was learned from elsewhere though nothing moved, m along a ray on the surface's normal.
double SurfaceFollower::view_doubt_m(std::int32_t block, const Memory& m) const noexcept {
  const BlockCoord c = map_.coords_[static_cast<std::size_t>(block)];
  const Vec3 middle = map_.voxel_ * Vec3(8.0 * c.x + 3.5, 8.0 * c.y + 3.5, 8.0 * c.z + 3.5);
  const Vec3 now = (middle - view_.X_WC.translation()).normalized();
  const Vec3 then = (middle - wide(m.eye_W.data())).normalized();
  return kOfView * map_.truncation_ * now.cross(then).norm();
}

// Sums up what the readings say of their blocks; false: nothing may have moved.
bool SurfaceFollower::compare_blocks(IntegrateStats& stats) noexcept {
  s_.met_count = 0;
  Place place{0, 0, k_.width - 1, k_.height - 1};
  const Eigen::AlignedBox3d& box_W = view_.frame.follow_W;
  Eigen::AlignedBox3d within = kEverywhere;
  if (!box_W.isEmpty()) {
    const Vec3 c = box_W.center();
    const auto half = static_cast<float>(0.5 * box_W.sizes().maxCoeff());
    const BoxView box = view_.boxes.view(c.x(), c.y(), c.z(), half);
    if (!box.visible) return false;
    place = {box.u0, box.v0, box.u1, box.v1};
    within = {box_W.min() / map_.voxel_, box_W.max() / map_.voxel_};
  }
  MapReader reader(map_, kObservations);
  stats.follow_tests += compare(
      place, within, reader, [&](const auto&, double off, const Vec3& p, double z, int, int) {
        const std::uint32_t* words =
            reader.block_of(ifloor(p.x()) >> 3, ifloor(p.y()) >> 3, ifloor(p.z()) >> 3);
        const std::ptrdiff_t block = (words - map_.words_.data()) / TsdfMap::kBlockVoxels;
        Memory& m = s_.memory[static_cast<std::size_t>(block)];
        if (m.frame != map_.frame_) {
          if (m.frame + 1 != map_.frame_) m.before = m.now = {};
          const auto keep = [](float before, float now) { return kKept * (before + now); };
          m.before = {keep(m.before.count, m.now.count), keep(m.before.sum, m.now.sum),
                      keep(m.before.squares, m.now.squares)};
          m.now = {};
          remember_eye(m);
          m.frame = map_.frame_;
          s_.met[static_cast<std::size_t>(s_.met_count++)] = static_cast<std::int32_t>(block);
        }
        m.now.add(static_cast<float>(off));
        m.z_m = static_cast<float>(z);
      });
  int off = 0;
  for (int n = 0; n < s_.met_count; ++n) {
    const std::int32_t block = s_.met[static_cast<std::size_t>(n)];
    const Memory& m = s_.memory[static_cast<std::size_t>(block)];
    const Sums &a = m.now, &b = m.before;
    const double doubt = view_doubt_m(block, m);
    if (moves(m) || stands_out(a, m.z_m, doubt) ||
        stands_out({a.count + b.count, a.sum + b.sum, a.squares + b.squares}, m.z_m, doubt))
      s_.met[static_cast<std::size_t>(off++)] = block;
  }
  s_.met_count = off;
  return off > 0;
}

void SurfaceFollower::camera_error() noexcept {
  asked_camera_ = true;
  CommonMotion& out = camera_;
  s_.tiles.fill({});
  const int edge =
      (std::max(k_.width, k_.height) + FollowScratch::kAcross - 1) / FollowScratch::kAcross;
  // The points' middle, roughly: a metre before the camera.
  out.about = (view_.X_WC.translation() + view_.X_WC.linear().col(2)) / map_.voxel_;
  out.radius = 1 / map_.voxel_;
  const double slope_unit = static_cast<double>(map_.metres_per_unit_) / map_.voxel_;
  MapReader reader(map_, kObservations);
  tests_ += compare(
      {0, 0, k_.width - 1, k_.height - 1}, kEverywhere, reader,
      [&](const MapReader::Cell& cell, double off, const Vec3& p, double z, int u, int v) {
        if (!cell.within(kAtTheEnd)) return;
        float g[3];
        cell.gradient(g);
        Tile& t =
            s_.tiles[static_cast<std::size_t>((v / edge) * FollowScratch::kAcross + u / edge)];
        t.count += 1, t.sum += off, t.squares += off * off, t.z_m = z;
        Eigen::Map<Row>(t.row.data()) += out.row(slope_unit * wide(g), p);
      });
  fit(s_.tiles, s_.room, out);
}

void SurfaceFollower::first_node(std::int32_t block, float (&p0)[3]) const noexcept {
  const BlockCoord c = map_.coords_[static_cast<std::size_t>(block)];
  const Vec3 first_C = view_.X_CW * (map_.voxel_ * Vec3(8.0 * c.x, 8.0 * c.y, 8.0 * c.z));
  for (int a = 0; a < 3; ++a) p0[a] = static_cast<float>(first_C(a));
}

// What the image says of a node, m along the ray as the update has it; NaN: nothing, beyond the band: what is seen through, or hidden.
double SurfaceFollower::node_off(const UpdateCamera& cam, const float (&p0)[3], int n,
                                 double* z) const noexcept {
  float p[3];
  for (int a = 0; a < 3; ++a) p[a] = p0[a] + cam.node[a][n];
  if (!(p[2] >= CameraBoxes::kLeastZ)) return std::nan("");
  const float inverse = 1.0F / p[2], x = p[0] * inverse, y = p[1] * inverse;
  const float u = x * cam.fx + cam.cx_half, v = y * cam.fy + cam.cy_half;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(cam.width) &&
        v < static_cast<float>(cam.height)))
    return std::nan("");
  const std::uint32_t pixel = cam.pixels[static_cast<int>(v) * cam.width + static_cast<int>(u)];
  if (((pixel >> 16U) & 0xffU) == 0) return std::nan("");
  const float depth = static_cast<float>(pixel & 0xffffU) * 0.001F;
  *z = static_cast<double>(depth);
  return static_cast<double>((depth - p[2]) * std::sqrt((1.0F + x * x) + y * y));
}

// By how much the block's surface is off, and how well that is known: error 0 where its nodes are too few to say; false: nothing
// to be said.
bool SurfaceFollower::look(const UpdateCamera& cam, std::int32_t block, Looked& out,
                           Vec3& slope) const noexcept {
  float p0[3];
  first_node(block, p0);
  const double unit = static_cast<double>(map_.metres_per_unit_);
  const std::uint32_t* words = map_.block_words(block);
  const auto sure = [words](int n) {
    return TsdfMap::word_weight(words[n]) >= TsdfMap::kObservedWeight &&
           std::abs(TsdfMap::word_distance(words[n])) < kAtTheEnd;
  };
  std::array<double, TsdfMap::kBlockVoxels> offs, room;
  std::size_t count = 0;
  double z_sum = 0;
  int slopes = 0;
  slope.setZero();
  for (int n = 0; n < TsdfMap::kBlockVoxels; ++n) {
    if (!sure(n)) continue;
    double z = 0;
    const int d = TsdfMap::word_distance(words[n]);
    const double off = node_off(cam, p0, n, &z) - unit * d;
    if (!(std::abs(off) < kMost * map_.truncation_)) continue;
    offs[count++] = off;
    z_sum += z;
    if ((n & 7) == 7 || ((n >> 3) & 7) == 7 || (n >> 6) == 7) continue;
    if (!sure(n + 64) || !sure(n + 8) || !sure(n + 1)) continue;
    slope +=
        Vec3(TsdfMap::word_distance(words[n + 64]) - d, TsdfMap::word_distance(words[n + 8]) - d,
             TsdfMap::word_distance(words[n + 1]) - d);
    ++slopes;
  }
  out.block = block;
  if (count < kFewNodes || slopes == 0) {
    out = {.block = block,
           .noise_m = kNoiseOfFew * sigma_m(count > 0 ? z_sum / static_cast<double>(count) : 1.0),
           .part = true};
    return count > 0;
  }
  slope *= unit / (map_.voxel_ * slopes);
  const double z = z_sum / static_cast<double>(count);
  // Of a reading along its ray: at a slant more.
  const double axial = sigma_m(z), lateral = 0.4 * z / static_cast<double>(cam.fx);
  const double slant = std::max(0.0, slope.squaredNorm() - 1);
  const double noise = std::sqrt(axial * axial + lateral * lateral * slant);
  Middle of = middle_of({offs.data(), count}, room);
  out.part = of.scatter > kAgree * noise + kTilt * std::abs(of.value);
  if (out.part && !apart_from_standing({offs.data(), count}, room, noise, count, of)) return false;
  if (std::abs(of.value) > kFast_m * slope.norm()) return false;
  // Nodes behind each other share a reading as far as the ray does not slant; none has more than the block's pixels.
  const double px = map_.voxel_ * static_cast<double>(cam.fx) / z;
  const double slope2 = std::max(1.0, slope.squaredNorm());
  const double step_px = px * std::sqrt(1 - 1 / slope2);  // from node to node along the normal
  const double deep = std::clamp(2 * map_.truncation_ / map_.voxel_, 1.0, 8.0);
  const double shared = std::clamp(1 / std::max(step_px, 1e-3), 1.0, deep);
  const double readings = std::max(
      4.0, std::min(static_cast<double>(count) / shared, 64 * px * px / std::sqrt(slope2)));
  out.off_m = of.value;
  out.noise_m = std::max(noise, of.scatter);
  out.error_m = 1.25 * out.noise_m / std::sqrt(readings);  // of a median
  return true;
}

// Whether what was seen of the block is more than noise, than what the camera's error explains and than what another view may say.
bool SurfaceFollower::is_off(Looked& it, const Vec3& slope, double view_doubt) noexcept {
  // Once it moves it is kept where it is seen, whatever is left to go, until it has been still for a while.
  const bool moving = moves(s_.memory[static_cast<std::size_t>(it.block)]);
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
bool SurfaceFollower::look_round(const UpdateCamera& cam, std::int32_t block) noexcept {
  const BlockCoord c = map_.coords_[static_cast<std::size_t>(block)];
  bool any = false;
  for (int n = 0; n < 27; ++n) {
    const BlockCoord at{c.x + n / 9 - 1, c.y + n / 3 % 3 - 1, c.z + n % 3 - 1};
    const std::int32_t b = map_.find_block(at);
    if (b == TsdfMap::kNoBlock || s_.looked_count == FollowScratch::kMostLooked) continue;
    std::uint32_t& asked = s_.asked[static_cast<std::size_t>(b)];
    if (asked == map_.frame_) continue;
    asked = map_.frame_;
    tests_ += TsdfMap::kBlockVoxels;
    Looked& it = s_.looked[static_cast<std::size_t>(s_.looked_count)];
    Vec3 slope;
    if (!look(cam, b, it, slope)) continue;
    it.at = {at.x, at.y, at.z};
    if (it.error_m == 0) {
      it.moves = false;
      ++s_.looked_count;
      continue;
    }
    const Memory& own = s_.memory[static_cast<std::size_t>(b)];
    const Memory& seen =
        own.frame == map_.frame_ ? own : s_.memory[static_cast<std::size_t>(block)];
    if (!is_off(it, slope, slope.norm() * view_doubt_m(b, seen))) continue;
    any = true;
    ++s_.looked_count;
  }
  return any;
}

// Each is moved by the mean of itself and of those of its neighbours that say the same; one of few nodes by theirs.
void SurfaceFollower::smooth() noexcept {
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

void SurfaceFollower::move(const UpdateCamera& cam, const Looked& it) noexcept {
  float p0[3];
  first_node(it.block, p0);
  const double unit = static_cast<double>(map_.metres_per_unit_), gate = 4 * it.noise_m;
  const int by = static_cast<int>(std::lround(it.by_m / unit));
  std::uint32_t* words =
      map_.words_.data() + static_cast<std::size_t>(it.block) * TsdfMap::kBlockVoxels;
  for (int n = 0; n < TsdfMap::kBlockVoxels; ++n) {
    const int d = TsdfMap::word_distance(words[n]);
    const std::uint32_t w = TsdfMap::word_weight(words[n]);
    if (w == 0) continue;
    if (std::abs(d) >= kAtTheEnd) continue;
    double z = 0;
    const double off = node_off(cam, p0, n, &z) - unit * d;
    const double apart = std::abs(off - it.off_m);  // NaN: nothing is said of it
    if (apart > gate || (it.part && !(apart < std::abs(off)))) continue;
    const int moved = std::clamp(d + by, -TsdfMap::kDistanceOne, TsdfMap::kDistanceOne);
    words[n] = TsdfMap::make_word(moved, static_cast<int>(std::min(w, kMoved)));
  }
  map_.changed_[static_cast<std::size_t>(it.block)] = map_.revision_;
  Memory& m = s_.memory[static_cast<std::size_t>(it.block)];
  m.now = m.before = {};
  m.eyes = std::min(m.eyes, static_cast<float>(kAs));
  if (it.moves) m.moved = map_.frame_;
}

// What lies at the ends of the band there and beside it is where the surface comes to next.
void SurfaceFollower::loosen_round(const Looked& it) noexcept {
  for (int n = 0; n < 27; ++n) {
    const std::int32_t b =
        map_.find_block({it.at[0] + n / 9 - 1, it.at[1] + n / 3 % 3 - 1, it.at[2] + n % 3 - 1});
    if (b == TsdfMap::kNoBlock) continue;
    std::uint32_t& loosened = s_.loosened[static_cast<std::size_t>(b)];
    if (loosened == map_.frame_) continue;
    loosened = map_.frame_;
    std::uint32_t* words = map_.words_.data() + static_cast<std::size_t>(b) * TsdfMap::kBlockVoxels;
    for (int i = 0; i < TsdfMap::kBlockVoxels; ++i) {
      const int d = TsdfMap::word_distance(words[i]);
      if (std::abs(d) >= kAtTheEnd && TsdfMap::word_weight(words[i]) > kEnds)
        words[i] = TsdfMap::make_word(d, static_cast<int>(kEnds));
    }
  }
}

void SurfaceFollower::step(IntegrateStats& stats) noexcept {
  const bool asked = compare_blocks(stats);
  if (!asked) return;
  const UpdateCamera cam = map_.update_camera(k_, view_.X_CW);
  s_.looked_count = 0;
  bool any = false;
  for (int n = 0; n < s_.met_count; ++n) {
    const bool off = look_round(cam, s_.met[static_cast<std::size_t>(n)]);
    any = any || off;
  }
  stats.follow_tests += tests_;
  if (!any) return;
  smooth();
  for (int n = 0; n < s_.looked_count; ++n) {
    if (s_.looked[static_cast<std::size_t>(n)].by_m == 0) continue;
    ++stats.blocks_moved;
    move(cam, s_.looked[static_cast<std::size_t>(n)]);
    loosen_round(s_.looked[static_cast<std::size_t>(n)]);
  }
}

void TsdfMap::follow(const View& view, IntegrateStats& stats) noexcept {
  if (!config_.follow) return;
  follow_->eyes = std::min(follow_->eyes + 1, config_.max_weight);
  follow_->eye_W += (view.X_WC.translation() - follow_->eye_W) / follow_->eyes;
  if (!view.frame.follow) return;
  const Pose way = view.X_CW * X_CW_last_.inverse(Eigen::Isometry);
  const double turned = Eigen::AngleAxisd(way.linear()).angle();
  if (way.translation().norm() > kStep_m || turned > kTurn_rad) return;
  SurfaceFollower(*this, view).step(stats);
}

}  // namespace perception
