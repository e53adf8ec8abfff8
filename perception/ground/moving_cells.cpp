#include "perception/ground/moving_cells.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "perception/motion/motion_mask.hpp"

namespace perception {

namespace {

constexpr std::uint16_t kNone = 0xffff;
constexpr int kStep = 2;  // of pixels and rows: the patches are of 4 x 4 at least
constexpr std::uint32_t lowest(std::uint32_t bits) { return bits & (~bits + 1U); }
constexpr auto kMovingPixel = static_cast<std::uint8_t>(PixelOf::kMoving);

}  // namespace

struct MovingCells::Eye {
  const MovingFrame& frame;
  Eigen::Matrix3f R_CM;
  Vec3f t_CM, foot_M;  // of the camera
  float cell_m;
  Eigen::Isometry3f X_BM;

  // The pixel that shows a point of M, and its depth in C; false: not in the image. Of a cell on
  // its rim some is in it.
  [[nodiscard]] bool pixel(const Vec3f& p_M, int& u, int& v, float& z) const noexcept {
    const Vec3f q = R_CM * p_M + t_CM;
    z = q.z();
    if (!(z > 0.05F)) return false;
    const Intrinsics& k = frame.intrinsics;
    const float x = static_cast<float>(k.fx) * q.x() / z + static_cast<float>(k.cx) + 0.5F,
                y = static_cast<float>(k.fy) * q.y() / z + static_cast<float>(k.cy) + 0.5F;
    const auto width = static_cast<float>(k.width), height = static_cast<float>(k.height);
    const float half = 0.5F * static_cast<float>(k.fx) * cell_m / z;
    if (!(x >= -half && y >= -half && x < width + half && y < height + half)) return false;
    u = static_cast<int>(std::clamp(x, 0.0F, width - 1));
    v = static_cast<int>(std::clamp(y, 0.0F, height - 1));
    return true;
  }
};

void MovingCellsConfig::describe(config::Section& s) {
  s.flag("on", on, "what moves is an obstacle")
      .number("hold_s", hold_s, 0.1, 60, "without a sight, and it is none any more")
      .number("depth_m", depth_m, 0, 2, "that a thing reaches behind what is seen of it");
}

MovingCells::MovingCells(rt::NonRealtime&, const MovingCellsConfig& config, const Rule& rule)
    : config_(config), rule_(rule), entries_(kMost) {
  const auto n = static_cast<std::size_t>(rule.cells);
  slot_.assign(n * n, kNone);
}

std::uint64_t MovingCells::take_work() noexcept {
  const std::uint64_t w = work_;
  work_ = 0;
  return w;
}

// ---------------------------------------------------------------- the set

MovingCells::Entry* MovingCells::entry_of(std::uint32_t cell, bool make) noexcept {
  std::uint16_t& slot = slot_[cell];
  if (slot != kNone) return &entries_[slot];
  if (!make) return nullptr;
  if (count_ == kMost) {
    ++refused_;
    return nullptr;
  }
  slot = static_cast<std::uint16_t>(count_++);
  entries_[slot] = Entry{};
  entries_[slot].cell = static_cast<std::uint16_t>(cell);
  return &entries_[slot];
}

void MovingCells::remove(int i, std::span<std::uint8_t> drawn) noexcept {
  Entry& e = entries_[static_cast<std::size_t>(i)];
  changed_ = changed_ || e.shown;
  drawn[e.cell] = static_cast<std::uint8_t>(drawn[e.cell] & ~kBit);
  slot_[e.cell] = kNone;
  --count_;
  if (i == count_) return;
  e = entries_[static_cast<std::size_t>(count_)];
  slot_[e.cell] = static_cast<std::uint16_t>(i);
}

void MovingCells::show(Entry& e, std::span<std::uint8_t> drawn) noexcept {
  changed_ = changed_ || !e.shown;
  e.shown = true;
  drawn[e.cell] = static_cast<std::uint8_t>(drawn[e.cell] | kBit);
}

void MovingCells::clear(std::span<std::uint8_t> drawn) noexcept {
  while (count_ > 0) remove(count_ - 1, drawn);
}

bool MovingCells::expire(rt::Time now, std::span<std::uint8_t> drawn) noexcept {
  changed_ = false;
  for (int i = 0; i < count_;) {
    if (rt::seconds(now - entries_[static_cast<std::size_t>(i)].last) > config_.hold_s)
      remove(i, drawn);
    else
      ++i;
  }
  return changed_;
}

void MovingCells::write(CostMap& out, rt::Time now) const noexcept {
  out.moving_count = count_;
  for (int i = 0; i < count_; ++i) {
    const Entry& e = entries_[static_cast<std::size_t>(i)];
    const double age = std::clamp(1e3 * rt::seconds(now - e.last), 0.0, 65535.0);
    out.moving[static_cast<std::size_t>(i)] = {e.cell, static_cast<std::uint16_t>(age)};
  }
}

void MovingCells::soften(CostMap& out, std::span<const std::uint8_t> occupied,
                         std::span<const std::uint8_t> drawn) const noexcept {
  for (int i = 0; i < count_; ++i) {
    const Entry& e = entries_[static_cast<std::size_t>(i)];
    if (e.shown && e.behind && occupied[e.cell] == 0 && drawn[e.cell] == kBit)
      out.cost[e.cell] = CostMap::kInscribed;
  }
}

// ---------------------------------------------------------------- one image

bool MovingCells::see(const MovingFrame& frame, const Place& place) noexcept {
  changed_ = false;
  refused_ = 0;
  if (!config_.on || (!frame.any && count_ == 0)) return false;
  for (int i = 0; i < count_; ++i) {
    Entry& e = entries_[static_cast<std::size_t>(i)];
    e.area = 0;
    e.met = 0;
    e.seen = e.reached = false;
  }
  if (frame.any) collect(frame, place);
  const Pose X_CM = place.X_MC.inverse(Eigen::Isometry);
  Eye eye{frame,
          X_CM.linear().cast<float>(),
          X_CM.translation().cast<float>(),
          place.X_MC.translation().cast<float>(),
          rule_.resolution_m,
          Eigen::Isometry3f::Identity()};
  eye.X_BM.matrix() = (rule_.X_BC * X_CM).matrix().cast<float>();
  const int sighted = settle(eye, place);
  if (sighted > 0 && config_.depth_m > 0) reach_behind(eye, place, count_);
  if (frame.sure) let_go(eye, place, sighted > 0);
  work_ += static_cast<std::uint64_t>(count_);
  return changed_;
}

// The nearest rows first: if there is no room for all, it is for them.
void MovingCells::collect(const MovingFrame& f, const Place& place) noexcept {
  const Intrinsics& k = f.intrinsics;
  const Eigen::Matrix3f R = place.X_MC.linear().cast<float>();
  const Vec3f t = place.X_MC.translation().cast<float>();
  const float inv_cell = 1 / rule_.resolution_m, limit = static_cast<float>(rule_.cells);
  const float slices_per_m = static_cast<float>(rule_.slices) / rule_.top_m;
  const auto fx = static_cast<float>(k.fx), fy = static_cast<float>(k.fy);
  const auto cx = static_cast<float>(k.cx), cy = static_cast<float>(k.cy);
  const float area_per_z2 = 256.0F * kStep * kStep * inv_cell * inv_cell / (fx * fy);
  std::uint64_t points = 0;
  for (int v = (k.height - 2) / kStep * kStep; v >= kStep; v -= kStep) {
    const std::uint8_t* what = f.what.row(v);
    const float *z_row = f.depth_m.row(v), *above = f.depth_m.row(v - 1),
                *below = f.depth_m.row(v + 1);
    for (int u = kStep; u + 1 < k.width; u += kStep) {
      if (what[u] != kMovingPixel) continue;
      const float z = z_row[u];
      if (!(z > 0 && z <= rule_.range_m)) continue;
      ++points;
      const float step = 0.02F + 0.006F * z * z + 2 * z / fx;
      const auto like = [&](float n) { return std::abs(n - z) < step; };
      if (!((like(z_row[u - 1]) || like(z_row[u + 1])) && (like(above[u]) || like(below[u]))))
        continue;
      const Vec3f p = R * Vec3f(z * (static_cast<float>(u) - cx) / fx,
                                z * (static_cast<float>(v) - cy) / fy, z) +
                      t;
      const float h = p.z() - (place.tilt.x() + place.tilt.y() * p.x() + place.tilt.z() * p.y());
      if (!(h > rule_.tolerance_m + rule_.per_m2 * z * z && h <= rule_.top_m)) continue;
      const float x = p.x() * inv_cell, y = p.y() * inv_cell;
      if (!(x >= 0 && y >= 0 && x < limit && y < limit)) continue;
      const auto cell =
          static_cast<std::uint32_t>(static_cast<int>(y) * rule_.cells + static_cast<int>(x));
      Entry* e = entry_of(cell, true);
      if (e == nullptr) continue;
      e->area += std::max(1, static_cast<int>(area_per_z2 * z * z));
      e->met |= 1U << static_cast<unsigned>(
                    std::min(static_cast<int>(h * slices_per_m), rule_.slices - 1));
    }
  }
  work_ += 4 * points + static_cast<std::uint64_t>(k.width) * static_cast<std::uint64_t>(k.height) /
                            (kStep * kStep * 8);
}

// What this image shows enough of. How many.
int MovingCells::settle(const Eye& eye, const Place& place) noexcept {
  int sighted = 0;
  for (int i = 0; i < count_;) {
    Entry& e = entries_[static_cast<std::size_t>(i)];
    e.seen = e.area >= rule_.enough && !in_body(eye, place, e.cell);
    if (e.seen) {
      ++sighted;
      e.last = eye.frame.taken;
      e.slices = e.behind ? e.met : e.slices | e.met;
      e.through = 0;
      e.behind = false;
      show(e, place.drawn);
    } else if (!e.shown) {
      remove(i, place.drawn);
      continue;
    }
    ++i;
  }
  return sighted;
}

void MovingCells::reach_behind(const Eye& eye, const Place& place, int count) noexcept {
  const float cell = rule_.resolution_m, limit = static_cast<float>(rule_.cells);
  const int steps = static_cast<int>(std::ceil(config_.depth_m / static_cast<double>(cell)));
  for (int i = 0; i < count; ++i) {
    const Entry front = entries_[static_cast<std::size_t>(i)];
    if (!front.seen) continue;
    const Vec3f at = centre_M(front.cell, 0, place);
    const Eigen::Vector2f way = (at - eye.foot_M).head<2>();
    const float length = way.norm();
    if (!(length > cell)) continue;
    for (int s = 1; s <= steps; ++s) {
      const Eigen::Vector2f q = (at.head<2>() + static_cast<float>(s) * cell / length * way) / cell;
      if (!(q.x() >= 0 && q.y() >= 0 && q.x() < limit && q.y() < limit)) break;
      const auto c = static_cast<std::uint32_t>(static_cast<int>(q.y()) * rule_.cells +
                                                static_cast<int>(q.x()));
      Entry* e = entry_of(c, false);
      if (e != nullptr && (e->seen || e->reached)) continue;
      if (place.occupied[c] != 0) break;
      if (floor_seen(eye, place, c) || in_body(eye, place, c)) continue;
      if (e == nullptr) {
        e = entry_of(c, true);
        if (e == nullptr) return;
        e->behind = true;
      }
      e->reached = true;
      if (e->behind) e->slices = front.slices, e->last = eye.frame.taken;
      e->through = 0;
      show(*e, place.drawn);
    }
  }
}

void MovingCells::let_go(const Eye& eye, const Place& place, bool any_sighted) noexcept {
  for (int i = 0; i < count_;) {
    Entry& e = entries_[static_cast<std::size_t>(i)];
    const bool goes = !e.seen && !e.reached &&
                      (place.occupied[e.cell] != 0 || (e.behind && any_sighted) ||
                       in_body(eye, place, e.cell) || seen_through(eye, place, e) ||
                       (floor_seen(eye, place, e.cell) && (e.through & lowest(e.slices)) != 0));
    if (goes)
      remove(i, place.drawn);
    else
      ++i;
  }
}

// ---------------------------------------------------------------- what an image says of a cell

Vec3f MovingCells::centre_M(std::uint32_t cell, float h, const Place& place) const noexcept {
  const auto edge = static_cast<std::uint32_t>(rule_.cells);
  const std::uint32_t row = cell / edge;
  const float x = (static_cast<float>(cell % edge) + 0.5F) * rule_.resolution_m,
              y = (static_cast<float>(row) + 0.5F) * rule_.resolution_m;
  return {x, y, h + place.tilt.x() + place.tilt.y() * x + place.tilt.z() * y};
}

// The ray to the floor in the cell's middle gets there, and what it meets does not move.
bool MovingCells::floor_seen(const Eye& eye, const Place& place, std::uint32_t cell) noexcept {
  int u = 0, v = 0;
  float z = 0;
  ++work_;
  if (!eye.pixel(centre_M(cell, 0, place), u, v, z) || z > rule_.range_m) return false;
  if (eye.frame.what.at(u, v) == kMovingPixel) return false;
  return eye.frame.depth_m.at(u, v) > z - 0.5F * rule_.resolution_m - rule_.per_m2 * z * z;
}

// All heights that the thing was met at, one by one, in this image or those since its last sight.
bool MovingCells::seen_through(const Eye& eye, const Place& place, Entry& e) noexcept {
  if (e.slices == 0) return false;
  for (std::uint32_t left = e.slices & ~e.through; left != 0; left &= left - 1) {
    const float h = (static_cast<float>(std::countr_zero(left)) + 0.5F) * rule_.top_m /
                    static_cast<float>(rule_.slices);
    int u = 0, v = 0;
    float z = 0;
    ++work_;
    if (!eye.pixel(centre_M(e.cell, h, place), u, v, z) || z > rule_.range_m) continue;
    if (eye.frame.depth_m.at(u, v) > z + rule_.resolution_m + rule_.per_m2 * z * z)
      e.through |= lowest(left);
  }
  return e.through == e.slices;
}

bool MovingCells::in_body(const Eye& eye, const Place& place, std::uint32_t cell) const noexcept {
  if (rule_.body_B.empty()) return false;
  const Vec3f p_B = eye.X_BM * centre_M(cell, 0, place);
  const Eigen::Vector2d p(static_cast<double>(p_B.x()), static_cast<double>(p_B.y()));
  return std::any_of(rule_.body_B.begin(), rule_.body_B.end(),
                     [&](const Eigen::AlignedBox2d& b) { return b.contains(p); });
}

}  // namespace perception
