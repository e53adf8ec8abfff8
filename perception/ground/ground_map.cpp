#include "perception/ground/ground_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace perception {

namespace {

constexpr int kMaxRow = 640;  // pixels of a row that is bridged
constexpr std::size_t kSearchPoints = 4096;

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
