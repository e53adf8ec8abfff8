#include "perception/ground/ground_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include <Eigen/Cholesky>

namespace perception {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kMaxRow = 640;  // pixels of a row that is bridged
constexpr std::size_t kSearchPoints = 4096;
constexpr std::uint8_t kNeither = 0, kGround = 1, kObstacle = 2;
constexpr std::uint8_t kDrawn = 1;

int enough_of(const GroundConfig& c) {
  return std::max(1, static_cast<int>(std::lround(256 * c.obstacle_area)));
}

MovingCells::Rule rule_of(const GroundConfig& c, const GroundPrior& prior) {
  MovingCells::Rule r;
  r.cells = c.cells;
  r.resolution_m = static_cast<float>(c.resolution_m);
  r.tolerance_m = static_cast<float>(c.ground_tolerance_m);
  r.per_m2 = static_cast<float>(c.tolerance_per_m2);
  r.range_m = static_cast<float>(c.range_m);
  r.top_m = static_cast<float>(c.robot_height_m);
  r.slices = GroundMap::kSlices;
  r.enough = enough_of(c);
  r.body_B = prior.body_B;
  r.X_BC = prior.X_BC;
  return r;
}

}  // namespace

void VirtualObstacleConfig::describe(config::Section& s) {
  s.text("shape", shape, {"disc", "box"}, "of the no-go area")
      .numbers("position_m", position_m, -1000, 1000, "of its centre in the world")
      .numbers("size_m", size_m, 0.01, 100, "edges of a box")
      .number("yaw_deg", yaw_deg, -360, 360, "of a box, about up")
      .number("radius_m", radius_m, 0.01, 100, "of a disc");
}

VirtualObstacle VirtualObstacleConfig::obstacle() const {
  VirtualObstacle o;
  o.kind = shape == "box" ? VirtualObstacle::Kind::kBox : VirtualObstacle::Kind::kDisc;
  o.centre_W = Vec3(position_m[0], position_m[1], position_m[2]);
  o.half_x_m = size_m[0] / 2;
  o.half_y_m = size_m[1] / 2;
  o.yaw_rad = yaw_deg * kDegree;
  o.radius_m = radius_m;
  return o;
}

void GroundConfig::describe(config::Section& s) {
  plane.describe(s.section("plane", "search for the ground plane"));
  moving.describe(s.section("moving", "what moves, as an obstacle"));
  s.integer("cells", cells, 16, CostMap::kMaxCells, "along an edge of the cost map")
      .number("resolution_m", resolution_m, 0.01, 1, "edge of a cell")
      .number("range_m", range_m, 0.5, 20, "points farther from the camera are not used")
      .number("ground_tolerance_m", ground_tolerance_m, 0.005, 0.5, "height that is still ground")
      .number("tolerance_per_m2", tolerance_per_m2, 0, 0.1, "and its growth with range squared")
      .number("robot_height_m", robot_height_m, 0.05, 5, "higher surfaces are overhead")
      .number("bridge_m", bridge_m, 0, 2, "longest gap between ground points that is ground")
      .number("obstacle_area", obstacle_area, 0.01, 10,
              "share of a cell's area seen as obstacle in one frame, to count")
      .integer("occupied_at", occupied_at, 1, 255, "evidence that makes a cell occupied")
      .integer("evidence_gain", evidence_gain, 1, 255, "a frame that shows an obstacle")
      .integer("evidence_loss", evidence_loss, 0, 255, "a frame that shows the floor")
      .integer("evidence_cap", evidence_cap, 1, 255, "so that changes are learned")
      .number("robot_radius_m", robot_radius_m, 0.01, 2, "radius of the body round its centre")
      .number("inflation_m", inflation_m, 0, 2, "rising cost beyond the radius")
      .number("start_radius_m", start_radius_m, 0, 3, "disc declared free at the start")
      .list(
          "virtual_obstacle",
          [this](config::Section& item) { virtual_obstacles.emplace_back().describe(item); },
          "no-go areas");
}

GroundMap::GroundMap(rt::NonRealtime& nrt, const GroundConfig& config, const GroundPrior& prior)
    : config_(config), prior_(prior), moving_(nrt, config.moving, rule_of(config, prior)) {
  if (config.cells < 16 || config.cells > CostMap::kMaxCells) {
    throw std::invalid_argument("ground.cells = " + std::to_string(config.cells) +
                                ": must be 16 .. " + std::to_string(CostMap::kMaxCells));
  }
  reach_ = static_cast<int>(
      std::ceil((config.robot_radius_m + config.inflation_m) / config.resolution_m + 0.5));
  if (reach_ > 100) {
    throw std::invalid_argument("ground.robot_radius_m + ground.inflation_m = " +
                                std::to_string(config.robot_radius_m + config.inflation_m) +
                                " m: must be at most 99 cells of ground.resolution_m");
  }
  if (config.virtual_obstacles.size() > kMaxVirtual) {
    throw std::invalid_argument("ground.virtual_obstacle: at most " + std::to_string(kMaxVirtual));
  }
  slices_per_m_ = static_cast<float>(kSlices / config.robot_height_m);
  const auto n = static_cast<std::size_t>(config.cells);
  points_.resize(kSearchPoints);
  cells_.resize(n * n);
  touched_.resize(n * n);
  occupied_.assign(n * n, 0);
  drawn_.assign(n * n, 0);
  column_.assign(n * (n + 2 * static_cast<std::size_t>(reach_)), 0);
  distance2_.assign(n * n, 0);
  row_x_.resize(kMaxRow);
  row_y_.resize(kMaxRow);
  row_h_.resize(kMaxRow);
  row_kind_.resize(kMaxRow);
  const int largest = (reach_ + 1) * (reach_ + 1);
  cost_of_distance2_.resize(static_cast<std::size_t>(largest) + 1);
  for (int d2 = 0; d2 <= largest; ++d2) {
    const double beyond = std::sqrt(d2) * config.resolution_m - config.robot_radius_m;
    double cost = 0;
    if (d2 == 0)
      cost = CostMap::kOccupied;
    else if (beyond <= config.resolution_m / 2)
      cost = CostMap::kInscribed;
    else if (beyond < config.inflation_m)
      cost = std::max(1.0, 252 * (1 - beyond / config.inflation_m));
    cost_of_distance2_[static_cast<std::size_t>(d2)] = static_cast<std::uint8_t>(cost);
  }
  for (const VirtualObstacleConfig& v : config.virtual_obstacles) {
    virtual_[static_cast<std::size_t>(virtual_count_++)] = v.obstacle();
  }
  clear();
}

void GroundMap::clear() noexcept {
  found_ = false;
  agreeing_ = 0;
  searches_ = 0;
  correction_.setZero();
  touched_count_ = 0;
  std::fill(cells_.begin(), cells_.end(),
            Cell{0, 0, 0, 0, 0, std::numeric_limits<float>::quiet_NaN(), 0, 0});
  std::fill(occupied_.begin(), occupied_.end(), std::uint8_t{0});
  std::fill(drawn_.begin(), drawn_.end(), std::uint8_t{0});
  moving_.clear(drawn_);
  dirty_ = true;
}

std::uint64_t GroundMap::take_work() noexcept {
  const std::uint64_t w = work_ + moving_.take_work();
  work_ = 0;
  return w;
}

void GroundMap::update(const GroundFrame& frame) noexcept {
  if (frame.depth_m.data == nullptr || !frame.intrinsics.valid()) return;
  if (!frame.X_WC.matrix().allFinite()) return;
  if (!found_) search(frame);
  if (!found_) return;
  collect(frame);
  look_through(frame);
  settle();
}

void GroundMap::see_moving(const MovingFrame& frame) noexcept {
  if (!found_ || !frame.intrinsics.valid() || !frame.X_WC.matrix().allFinite()) return;
  const bool changed =
      moving_.see(frame, {X_MW_ * frame.X_WC, correction_.cast<float>(), occupied_, drawn_});
  dirty_ = dirty_ || changed;
}

void GroundMap::search(const GroundFrame& frame) noexcept {
  const Intrinsics& k = frame.intrinsics;
  const double pixels = static_cast<double>(k.width) * k.height;
  const int stride = std::max(1, static_cast<int>(std::ceil(std::sqrt(pixels / kSearchPoints))));
  std::size_t n = 0;
  for (int v = stride / 2; v < k.height; v += stride) {
    for (int u = stride / 2; u < k.width && n < points_.size(); u += stride) {
      const auto z = static_cast<double>(frame.depth_m.at(u, v));
      if (z > 0 && z <= config_.range_m) {
        points_[n++] = (frame.X_WC * k.unproject(u, v, z)).cast<float>();
      }
    }
  }
  work_ += n * static_cast<std::uint64_t>(config_.plane.draws) / 2;
  GroundHint hint;
  hint.up_known = prior_.up_known;
  hint.up = prior_.up_known ? prior_.up_W : Vec3(-frame.X_WC.linear().col(1));
  hint.camera_height_m = prior_.camera_height_m;
  const Vec3 camera = frame.X_WC.translation();
  const auto plane = find_ground({points_.data(), n}, camera, hint, config_.plane, searches_++);
  if (!plane) {
    agreeing_ = 0;
    return;
  }
  const bool agrees = agreeing_ > 0 &&
                      plane->normal.dot(candidate_W_.normal) > std::cos(3 * kDegree) &&
                      std::abs(plane->height(camera) - candidate_W_.height(camera)) < 0.03;
  if (!agrees) {
    candidate_W_ = *plane;
    agreeing_ = 1;
  } else {
    // Running mean of the agreeing frames.
    const double w = 1.0 / (agreeing_ + 1);
    candidate_W_.normal = ((1 - w) * candidate_W_.normal + w * plane->normal).normalized();
    candidate_W_.offset = (1 - w) * candidate_W_.offset + w * plane->offset;
    candidate_W_.rms_m = plane->rms_m;
    candidate_W_.inliers = plane->inliers;
    candidate_W_.share = plane->share;
    candidate_W_.below = plane->below;
    ++agreeing_;
  }
  if (agreeing_ >= config_.plane.frames) {
    plane_W_ = candidate_W_;
    found_ = true;
    fix_grid();
  }
}

void GroundMap::fix_grid() noexcept {
  const Vec3 z = plane_W_.normal;
  const Vec3 along = std::abs(z.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 x = (along - along.dot(z) * z).normalized();
  Mat3 R;
  R.col(0) = x;
  R.col(1) = z.cross(x);
  R.col(2) = z;
  const Vec3 start = prior_.start_W - plane_W_.height(prior_.start_W) * z;  // on the plane
  const double half = 0.5 * config_.cells * config_.resolution_m;
  X_WM_ = Pose::Identity();
  X_WM_.linear() = R;
  X_WM_.translation() = start - R * Vec3(half, half, 0);
  X_MW_ = X_WM_.inverse();
  // The robot stands at the middle: see START DISC in the header.
  const double r = config_.start_radius_m / config_.resolution_m;
  const double middle = config_.cells / 2.0;
  for (int iy = 0; iy < config_.cells && r > 0; ++iy) {
    for (int ix = 0; ix < config_.cells; ++ix) {
      if (std::hypot(ix + 0.5 - middle, iy + 0.5 - middle) > r) continue;
      Cell& c = cells_[static_cast<std::size_t>(iy * config_.cells + ix)];
      c.seen = 1;
      c.height = 0;
    }
  }
  draw_virtual();
}

void GroundMap::touch(std::size_t cell) noexcept {
  Cell& c = cells_[cell];
  if (c.obstacle_area == 0 && c.ground_points == 0) {
    touched_[touched_count_++] = static_cast<std::uint32_t>(cell);
    c.frame_height = -std::numeric_limits<float>::infinity();
  }
}

void GroundMap::collect(const GroundFrame& frame) noexcept {
  const Intrinsics& k = frame.intrinsics;
  const Pose X_MC = X_MW_ * frame.X_WC;
  const Eigen::Matrix3f R = X_MC.linear().cast<float>();
  const Vec3f t = X_MC.translation().cast<float>();
  const Vec3f step = R.col(0) / static_cast<float>(k.fx);
  const auto inv_cell = static_cast<float>(1 / config_.resolution_m);
  const auto cell = static_cast<float>(config_.resolution_m);
  const auto a = static_cast<float>(correction_.x()), b = static_cast<float>(correction_.y()),
             c = static_cast<float>(correction_.z());
  const auto tolerance = static_cast<float>(config_.ground_tolerance_m);
  const auto per_m2 = static_cast<float>(config_.tolerance_per_m2);
  const auto range = static_cast<float>(config_.range_m);
  const auto top = static_cast<float>(config_.robot_height_m);
  const auto bridge2 = static_cast<float>(config_.bridge_m * config_.bridge_m);
  const auto limit = static_cast<float>(config_.cells);
  const int width = std::min(k.width, kMaxRow);
  Eigen::Matrix3d drift = Eigen::Matrix3d::Zero();  // normal equations of the correction
  Vec3 drift_rhs = Vec3::Zero();
  std::uint64_t steps = 0;

  // A pixel at depth z stands for (z / f)^2 of surface that faces the camera.
  const float area_per_z2 = 256.0F * inv_cell * inv_cell / static_cast<float>(k.fx * k.fy);
  const auto count = [&](float x, float y, bool ground, float h, float z) {
    const float cx = x * inv_cell, cy = y * inv_cell;
    if (!(cx >= 0 && cy >= 0 && cx < limit && cy < limit)) return;
    const auto i =
        static_cast<std::size_t>(static_cast<int>(cy)) * static_cast<std::size_t>(config_.cells) +
        static_cast<std::size_t>(static_cast<int>(cx));
    touch(i);
    Cell& at = cells_[i];
    if (ground) {
      if (at.ground_points < 0xffffU) ++at.ground_points;
    } else {
      const float area = std::min(65535.0F - static_cast<float>(at.obstacle_area),
                                  std::max(1.0F, area_per_z2 * z * z));
      at.obstacle_area = static_cast<std::uint16_t>(at.obstacle_area + static_cast<int>(area));
      at.frame_height = std::max(at.frame_height, h);
      at.slices |= slice_of(h);
    }
  };

  std::fill(row_kind_.begin(), row_kind_.end(), kNeither);
  for (int v = 0; v < k.height; ++v) {
    const float* z_row = frame.depth_m.row(v);
    const Vec3f base =
        R * Vec3f(static_cast<float>(-k.cx / k.fx), static_cast<float>((v - k.cy) / k.fy), 1.0F);
    for (int u = 0; u < width; ++u) {
      const auto i = static_cast<std::size_t>(u);
      const float z = z_row[u];
      if (!(z > 0 && z <= range)) {
        row_kind_[i] = kNeither;
        continue;
      }
      const Vec3f p = z * (base + static_cast<float>(u) * step) + t;
      const float h = p.z() - (a + b * p.x() + c * p.y());
      const float gate = tolerance + per_m2 * z * z;
      const bool ground = std::abs(h) <= gate;
      const bool obstacle = !ground && (h > 0 ? h <= top : h < -3 * gate);
      if (ground || obstacle) {
        count(p.x(), p.y(), ground, h, z);
        // Cells between this point and the one above it in the image, when both are of one kind and, for
        // an obstacle, of one height: rows of a grazing surface lie farther apart than cells.
        const float dx = row_x_[i] - p.x(), dy = row_y_[i] - p.y(), d2 = dx * dx + dy * dy;
        const bool joined =
            row_kind_[i] == (ground ? kGround : kObstacle) && std::abs(row_h_[i] - h) <= gate;
        if (joined && d2 > cell * cell && d2 <= bridge2) {
          const int n = static_cast<int>(std::sqrt(d2) * inv_cell * 1.5F) + 1;
          for (int s = 1; s < n; ++s) {
            const float f = static_cast<float>(s) / static_cast<float>(n);
            count(p.x() + f * dx, p.y() + f * dy, ground, h, z);
          }
          steps += static_cast<std::uint64_t>(n);
        }
      }
      if (ground && ((u ^ v) & 3) == 0) {
        // About the camera's foot, so that offset and tilt hardly mix.
        const Vec3 j(1, static_cast<double>(p.x() - t.x()), static_cast<double>(p.y() - t.y()));
        drift += j * j.transpose();
        drift_rhs += static_cast<double>(h) * j;
      }
      row_x_[i] = p.x();
      row_y_[i] = p.y();
      row_h_[i] = h;
      row_kind_[i] = ground ? kGround : (obstacle ? kObstacle : kNeither);
    }
  }
  work_ += static_cast<std::uint64_t>(k.width) * static_cast<std::uint64_t>(k.height) + steps;

  // Follow slow drift of the tracking: a twentieth of the way to this frame's ground, tilt damped.
  if (drift(0, 0) > 100) {
    const double n = drift(0, 0);
    drift.diagonal() += n * Vec3(0, 0.5, 0.5);
    const Vec3 delta = 0.05 * drift.ldlt().solve(drift_rhs);
    if (!delta.allFinite()) return;
    correction_.x() +=
        delta.x() - delta.y() * X_MC.translation().x() - delta.z() * X_MC.translation().y();
    correction_.y() += delta.y();
    correction_.z() += delta.z();
  }
}

void GroundMap::settle() noexcept {
  const int enough = enough_of(config_);
  for (std::size_t i = 0; i < touched_count_; ++i) {
    const std::size_t cell = touched_[i];
    Cell& c = cells_[cell];
    const bool was = c.evidence >= config_.occupied_at;
    if (c.obstacle_area >= enough) {
      c.evidence = static_cast<std::uint8_t>(
          std::min<int>(c.evidence + config_.evidence_gain, config_.evidence_cap));
      c.height = c.frame_height;
      c.through = 0;
    } else if (4 * c.obstacle_area < enough && c.ground_points > 0) {
      c.evidence = static_cast<std::uint8_t>(std::max<int>(c.evidence - config_.evidence_loss, 0));
      c.seen = 1;
      if (c.evidence < config_.occupied_at) c.height = 0, c.slices = c.through = 0;
    }
    const bool is = c.evidence >= config_.occupied_at;
    if (is != was) {
      occupied_[cell] = is ? 1 : 0;
      dirty_ = true;
    }
    c.obstacle_area = c.ground_points = 0;
  }
  work_ += touched_count_;
  touched_count_ = 0;
}

bool GroundMap::set_virtual(std::span<const VirtualObstacle> obstacles) noexcept {
  if (obstacles.size() > kMaxVirtual) return false;
  std::copy(obstacles.begin(), obstacles.end(), virtual_.begin());
  virtual_count_ = static_cast<int>(obstacles.size());
  if (found_) draw_virtual();
  return true;
}

void GroundMap::forget(const Eigen::AlignedBox3d& box_W) noexcept {
  if (!found_ || box_W.isEmpty() || !box_W.min().allFinite() || !box_W.max().allFinite()) return;
  // What of the grid the box can reach: its corners seen from M.
  Eigen::AlignedBox3d box_M;
  for (int corner = 0; corner < 8; ++corner)
    box_M.extend(X_MW_ * box_W.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner)));
  const double step = config_.resolution_m, half = step / 2;
  if (box_M.min().z() > config_.robot_height_m || box_M.max().z() < -half) return;
  const auto cell = [&](double at) {
    return static_cast<int>(std::clamp(std::floor(at / step), -1.0, config_.cells + 0.0));
  };
  const int x0 = std::max(cell(box_M.min().x()), 0), y0 = std::max(cell(box_M.min().y()), 0);
  const int x1 = std::min(cell(box_M.max().x()), config_.cells - 1),
            y1 = std::min(cell(box_M.max().y()), config_.cells - 1);
  const Eigen::AlignedBox3d grown_W(box_W.min() - Vec3::Constant(half),
                                    box_W.max() + Vec3::Constant(half));
  for (int iy = y0; iy <= y1; ++iy) {
    for (int ix = x0; ix <= x1; ++ix) {
      const auto i = static_cast<std::size_t>(iy * config_.cells + ix);
      Cell& c = cells_[i];
      if (c.evidence == 0) continue;
      bool inside = false;
      for (double z = 0; z <= config_.robot_height_m && !inside; z += step)
        inside = grown_W.contains(X_WM_ * Vec3((ix + 0.5) * step, (iy + 0.5) * step, z));
      if (!inside) continue;
      c.evidence = c.seen = 0;
      c.slices = c.through = 0;
      c.height = std::numeric_limits<float>::quiet_NaN();
      dirty_ = dirty_ || occupied_[i] != 0;
      occupied_[i] = 0;
    }
  }
  work_ += static_cast<std::uint64_t>(std::max(0, x1 - x0 + 1)) *
           static_cast<std::uint64_t>(std::max(0, y1 - y0 + 1));
}

void GroundMap::draw_virtual() noexcept {
  for (std::uint8_t& d : drawn_) d = static_cast<std::uint8_t>(d & ~kDrawn);
  dirty_ = true;
  const double margin = config_.resolution_m / 2;  // a cell that the shape touches counts
  for (int n = 0; n < virtual_count_; ++n) {
    const VirtualObstacle& o = virtual_[static_cast<std::size_t>(n)];
    const Vec3 centre = X_MW_ * o.centre_W;
    const double c = std::cos(o.yaw_rad), s = std::sin(o.yaw_rad);
    for (int iy = 0; iy < config_.cells; ++iy) {
      for (int ix = 0; ix < config_.cells; ++ix) {
        const double dx = (ix + 0.5) * config_.resolution_m - centre.x();
        const double dy = (iy + 0.5) * config_.resolution_m - centre.y();
        const bool inside = o.kind == VirtualObstacle::Kind::kDisc
                                ? std::hypot(dx, dy) <= o.radius_m + margin
                                : std::abs(c * dx + s * dy) <= o.half_x_m + margin &&
                                      std::abs(c * dy - s * dx) <= o.half_y_m + margin;
        if (inside) drawn_[static_cast<std::size_t>(iy * config_.cells + ix)] |= kDrawn;
      }
    }
  }
  work_ += cells_.size() * static_cast<std::uint64_t>(virtual_count_ + 1);
}

void GroundMap::inflate() noexcept {
  const int n = config_.cells, pad = reach_, stride = n + 2 * pad;
  const auto cap = static_cast<std::uint16_t>(reach_ + 1);
  const auto cap2 = static_cast<std::uint16_t>(cap * cap);
  // Distance along y, two sweeps over whole rows; margins stay at the cap.
  std::fill(column_.begin(), column_.end(), cap);
  const auto row = [&](int y) {
    return column_.data() + static_cast<std::ptrdiff_t>(y) * stride + pad;
  };
  for (int y = 0; y < n; ++y) {
    std::uint16_t* d = row(y);
    const std::uint16_t* before = y > 0 ? row(y - 1) : nullptr;
    const std::uint8_t* o = occupied_.data() + static_cast<std::ptrdiff_t>(y) * n;
    const std::uint8_t* w = drawn_.data() + static_cast<std::ptrdiff_t>(y) * n;
    for (int x = 0; x < n; ++x) {
      const int up = before != nullptr ? std::min(before[x] + 1, static_cast<int>(cap)) : cap;
      d[x] = static_cast<std::uint16_t>((o[x] | w[x]) != 0 ? 0 : up);
    }
  }
  for (int y = n - 2; y >= 0; --y) {
    std::uint16_t* d = row(y);
    const std::uint16_t* after = row(y + 1);
    for (int x = 0; x < n; ++x) {
      d[x] = static_cast<std::uint16_t>(std::min<int>(d[x], after[x] + 1));
    }
  }
  for (std::uint16_t& d : column_) d = static_cast<std::uint16_t>(d * d);
  for (int y = 0; y < n; ++y) {
    std::uint16_t* out = distance2_.data() + static_cast<std::ptrdiff_t>(y) * n;
    std::fill_n(out, n, cap2);
    for (int dx = -reach_; dx <= reach_; ++dx) {
      const auto add = static_cast<std::uint16_t>(dx * dx);
      const std::uint16_t* in = row(y) + dx;
      for (int x = 0; x < n; ++x) {
        const auto d2 = static_cast<std::uint16_t>(in[x] + add);
        out[x] = d2 < out[x] ? d2 : out[x];
      }
    }
  }
  dirty_ = false;
  work_ += cells_.size() * static_cast<std::uint64_t>(2 * reach_ + 3) / 16;
}

void GroundMap::write(CostMap& out, rt::Time now) noexcept {
  out.ground_found = found_;
  out.resolution = config_.resolution_m;
  out.width = out.height = config_.cells;
  out.X_WM = X_WM_;
  const std::size_t n = cells_.size();
  work_ += n;
  if (moving_.size() > 0 && moving_.expire(now, drawn_)) dirty_ = true;
  moving_.write(out, now);
  if (!found_) {
    std::fill_n(out.cost.begin(), n, static_cast<std::uint8_t>(CostMap::kUnknown));
    std::fill_n(out.height_m.begin(), n, std::numeric_limits<float>::quiet_NaN());
    return;
  }
  if (dirty_) inflate();
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint8_t cost = cost_of_distance2_[distance2_[i]];
    const bool shut = cost >= CostMap::kInscribed;
    out.cost[i] = shut || cells_[i].seen != 0 ? cost : static_cast<std::uint8_t>(CostMap::kUnknown);
    out.height_m[i] = cells_[i].height;
  }
  moving_.soften(out, occupied_, drawn_);
}

}  // namespace perception
