#include "perception/tsdf/follow/follow.hpp"

#include <algorithm>
#include <cmath>

#include "perception/geometry/ifloor.hpp"
#include "perception/tsdf/blocks/held_bytes.hpp"
#include "perception/tsdf/follow/follow_frame.hpp"

namespace perception {
namespace {

using FollowTile = FollowScratch::Tile;
using namespace follow;

constexpr int kComparedReadings = 3400;  // that are compared in a frame, about
// chosen on: follow 1000; judged on: follow 2000
constexpr double kObservations = 2;  // least weight of nodes that readings are compared with
// If the camera moved farther than this since the last frame, nothing is followed: distances along
// the rays differ too much beside edges and on slanted surfaces.
constexpr double kStep_m = 0.04, kTurn_rad = 0.044;
// Share of a truncation. Times the sine of the angle between the rays of now and then it is the
// difference of distances along them, since a band's nodes lie half a truncation off their surface.
constexpr double kOfView = 0.5;  // derived
constexpr float kKept = 0.75F;   // of the history of earlier frames, each frame

const Eigen::AlignedBox3d kEverywhere(Vec3::Constant(-1e9), Vec3::Constant(1e9));

// The pixels that are compared.
struct Grid {
  int u0, v0, u1, v1, step;
};
Grid grid_over(int u0, int v0, int u1, int v1, std::uint32_t frame) noexcept {
  const double area = (u1 - u0 + 1.0) * (v1 - v0 + 1.0);
  const int step = std::max(1, static_cast<int>(std::lround(std::sqrt(area / kComparedReadings))));
  const auto shift = [&](std::uint32_t by) {
    return static_cast<int>(by * frame % static_cast<std::uint32_t>(step));
  };
  return {u0 + shift(5), v0 + shift(3), u1, v1, step};
}

}  // namespace

// Counts the readings of the grid that end in the box (voxels). For those that end where the map is
// known it calls fn(cell, offset along the ray, end in voxels, depth, pixel).
template <class Fn>
int FollowFrame::compare(const Place& place, const Eigen::AlignedBox3d& box, MapReader& reader,
                         Fn&& fn) const noexcept {
  const Grid g = grid_over(place[0], place[1], place[2], place[3], frame_);
  const double unit = static_cast<double>(store_.metres_per_unit), per_voxel = 1 / store_.voxel;
  const Mat3 R = view_.X_WC.linear() * per_voxel;
  const Vec3 eye = view_.X_WC.translation() * per_voxel;
  int tests = 0;
  for (int v = g.v0; v <= g.v1; v += g.step) {
    const std::uint32_t* row = pyramid_.pixels() + static_cast<std::ptrdiff_t>(v) * k_.width;
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
      if (std::abs(off) < kSlowReach * store_.truncation) fn(cell, off, p, z, u, v);
    }
  }
  return tests;
}

// Before the block's frame is told.
void FollowFrame::remember_eye(BlockPast& m) const noexcept {
  if (m.frame == 0 || frame_ - m.frame > kStill) {
    for (int a = 0; a < 3; ++a)
      m.eye_W[static_cast<std::size_t>(a)] = static_cast<float>(s_.eye_W(a));
    m.eyes = static_cast<float>(s_.eyes);
    return;
  }
  m.eyes = std::min(m.eyes + 1, static_cast<float>(store_.config.max_weight));
  for (int a = 0; a < 3; ++a) {
    float& eye = m.eye_W[static_cast<std::size_t>(a)];
    eye += (static_cast<float>(view_.X_WC.translation()(a)) - eye) / m.eyes;
  }
}

// Largest offset that readings from here may have against the history from elsewhere although
// nothing moved, m along a ray on the surface's normal.
double FollowFrame::view_doubt_m(std::int32_t block, const BlockPast& m) const noexcept {
  const BlockCoord c = store_.blocks.coord(block);
  const Vec3 middle = store_.voxel * Vec3(8.0 * c.x + 3.5, 8.0 * c.y + 3.5, 8.0 * c.z + 3.5);
  const Vec3 now = (middle - view_.X_WC.translation()).normalized();
  const Vec3 then = (middle - wide(m.eye_W.data())).normalized();
  return kOfView * store_.truncation * now.cross(then).norm();
}

// Sums up what the readings say of their blocks; false: nothing may have moved.
bool FollowFrame::compare_blocks() noexcept {
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
    within = {box_W.min() / store_.voxel, box_W.max() / store_.voxel};
  }
  MapReader reader(MapView(store_), kObservations);
  counts_.tests += compare(
      place, within, reader, [&](const auto&, double off, const Vec3& p, double z, int, int) {
        const std::uint32_t* words =
            reader.block_of(ifloor(p.x()) >> 3, ifloor(p.y()) >> 3, ifloor(p.z()) >> 3);
        const auto block = static_cast<std::int32_t>(store_.blocks.number_of(words));
        BlockPast& m = store_.blocks.past(block);
        if (m.frame != frame_) {
          if (m.frame + 1 != frame_) m.before = m.now = {};
          const auto keep = [](float before, float now) { return kKept * (before + now); };
          m.before = {keep(m.before.count, m.now.count), keep(m.before.sum, m.now.sum),
                      keep(m.before.squares, m.now.squares)};
          m.now = {};
          remember_eye(m);
          m.frame = frame_;
          s_.met[static_cast<std::size_t>(s_.met_count++)] = block;
        }
        m.now.add(static_cast<float>(off));
        m.z_m = static_cast<float>(z);
      });
  int off = 0;
  for (int n = 0; n < s_.met_count; ++n) {
    const std::int32_t block = s_.met[static_cast<std::size_t>(n)];
    const BlockPast& m = store_.blocks.past(block);
    const OffsetSums &a = m.now, &b = m.before;
    const double doubt = view_doubt_m(block, m);
    if (moves(m) || stands_out(a, m.z_m, doubt) ||
        stands_out({a.count + b.count, a.sum + b.sum, a.squares + b.squares}, m.z_m, doubt))
      s_.met[static_cast<std::size_t>(off++)] = block;
  }
  s_.met_count = off;
  return off > 0;
}

void FollowFrame::camera_error() noexcept {
  asked_camera_ = true;
  CommonMotion& out = camera_;
  s_.tiles.fill({});
  const int edge =
      (std::max(k_.width, k_.height) + FollowScratch::kAcross - 1) / FollowScratch::kAcross;
  // The points' middle, roughly: a metre before the camera.
  out.about = (view_.X_WC.translation() + view_.X_WC.linear().col(2)) / store_.voxel;
  out.radius = 1 / store_.voxel;
  const double slope_unit = static_cast<double>(store_.metres_per_unit) / store_.voxel;
  MapReader reader(MapView(store_), kObservations);
  counts_.tests += compare(
      {0, 0, k_.width - 1, k_.height - 1}, kEverywhere, reader,
      [&](const MapReader::Cell& cell, double off, const Vec3& p, double z, int u, int v) {
        if (!cell.within(kAtTheEnd)) return;
        float g[3];
        cell.gradient(g);
        FollowTile& t =
            s_.tiles[static_cast<std::size_t>((v / edge) * FollowScratch::kAcross + u / edge)];
        t.count += 1, t.sum += off, t.squares += off * off, t.z_m = z;
        Eigen::Map<Row>(t.row.data()) += out.row(slope_unit * wide(g), p);
      });
  fit(s_.tiles, s_.room, out);
}

FollowCounts FollowFrame::step() noexcept {
  if (!compare_blocks()) return counts_;
  const UpdateCamera cam = update_camera(store_, pyramid_, k_, view_.X_CW);
  s_.looked_count = 0;
  bool any = false;
  for (int n = 0; n < s_.met_count; ++n) {
    const bool off = look_round(cam, s_.met[static_cast<std::size_t>(n)]);
    any = any || off;
  }
  if (!any) return counts_;
  smooth();
  for (int n = 0; n < s_.looked_count; ++n) {
    if (s_.looked[static_cast<std::size_t>(n)].by_m == 0) continue;
    ++counts_.blocks_moved;
    move(cam, s_.looked[static_cast<std::size_t>(n)]);
    loosen_round(s_.looked[static_cast<std::size_t>(n)]);
  }
  return counts_;
}

SurfaceFollower::SurfaceFollower(rt::NonRealtime&, MapStore& store, const DepthPyramid& pyramid)
    : store_(store),
      pyramid_(pyramid),
      scratch_(std::make_unique<FollowScratch>(static_cast<std::size_t>(store.config.max_blocks))) {
}

SurfaceFollower::~SurfaceFollower() = default;

std::size_t SurfaceFollower::memory_bytes() const noexcept {
  return sizeof *scratch_ + held_bytes(scratch_->met, scratch_->asked, scratch_->loosened);
}

FollowCounts SurfaceFollower::step(const FrameCamera& view, std::uint32_t frame,
                                   const Pose& X_CW_last) noexcept {
  FollowScratch& s = *scratch_;
  s.eyes = std::min(s.eyes + 1, store_.config.max_weight);
  s.eye_W += (view.X_WC.translation() - s.eye_W) / s.eyes;
  if (!view.frame.follow) return {};
  const Pose way = view.X_CW * X_CW_last.inverse(Eigen::Isometry);
  const double turned = Eigen::AngleAxisd(way.linear()).angle();
  if (way.translation().norm() > kStep_m || turned > kTurn_rad) return {};
  return FollowFrame(store_, pyramid_, s, view, frame).step();
}

}  // namespace perception
