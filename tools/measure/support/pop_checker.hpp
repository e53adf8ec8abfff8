// Checks whether the proxy went through the surface. It uses only the windows and the blend, with
// its own interpolation, and shares no code with the renderer.
//
//   sunk     a contact tick with phi(p) < -0.5 mm on the blended field
//   flipped  (p - h) . n_entry changed its sign without a free tick in between; n_entry is the
//            direction of p - h in the first tick of the contact. Counted where the stretch is
//            above 0.1 mm.
#pragma once

#include <cmath>
#include <cstdint>

#include "perception/patch/surface_patch.hpp"

namespace teletact {

class PopChecker {
 public:
  // Did the pull p - h turn to the other side since the contact began?
  struct Turn {
    bool inside = false;
    perception::Vec3 entry_W = perception::Vec3::UnitZ();
    // True once a turn.
    bool judge(bool in_contact, const perception::Vec3& stretch) {
      inside = inside && in_contact;
      if (!in_contact) return false;
      const bool begins = !inside && stretch.norm() > 1e-6;
      const bool turns = inside && stretch.norm() > 1e-4 && stretch.dot(entry_W) < -1e-4;
      if (begins || turns) entry_W = stretch.normalized();
      inside = inside || begins;
      return turns;
    }
  };
  // Before a step: what is handed in (null: nothing new).
  void offer(const perception::SurfacePatch* patch) {
    if (patch == nullptr || patch == newer_ || patch->seq == 0) return;
    older_ = newer_ != nullptr && newer_->map_id == patch->map_id ? newer_ : nullptr;
    newer_ = patch;
  }
  // After it. `blend` is the share of the newer window.
  void judge(bool in_contact, const perception::Vec3& p_W, const perception::Vec3& h_W,
             double blend) {
    depth_m_ = std::nan("");
    const bool turned = turn_.judge(in_contact, p_W - h_W);
    if (!in_contact) return;
    flipped_ += turned ? 1 : 0;
    ++judged_;
    const double phi = value(p_W, blend);
    depth_m_ = -phi;
    if (std::isnan(phi)) {
      ++unknown_;
    } else {
      deepest_m_ = std::fmax(deepest_m_, -phi);
      if (phi < -0.0005) ++sunk_;
    }
  }
  [[nodiscard]] std::uint64_t judged() const { return judged_; }
  [[nodiscard]] std::uint64_t unknown() const { return unknown_; }  // a corner was not observed
  [[nodiscard]] std::uint64_t sunk() const { return sunk_; }
  [[nodiscard]] std::uint64_t flipped() const { return flipped_; }
  [[nodiscard]] double deepest_m() const { return deepest_m_; }
  // In the last tick; NaN: free, or a corner was not observed.
  [[nodiscard]] double depth_m() const { return depth_m_; }
  [[nodiscard]] const perception::Vec3& entry_W() const { return turn_.entry_W; }  // n_entry
  [[nodiscard]] double voxel_m() const { return newer_ != nullptr ? newer_->voxel_size : 0; }
  // Of the blended windows; NaN: observed in neither.
  [[nodiscard]] double node_value(const std::int64_t (&at)[3], double blend) const {
    const double v = node(newer_, at), o = blend < 1 ? node(older_, at) : std::nan("");
    if (std::isnan(v) || std::isnan(o)) return std::isnan(v) ? o : v;
    return (1 - blend) * o + blend * v;
  }

 private:
  // Of one node; NaN: not observed there.
  static double node(const perception::SurfacePatch* w, const std::int64_t (&at)[3]) {
    if (w == nullptr) return std::nan("");
    int i[3];
    for (int a = 0; a < 3; ++a) {
      const std::int64_t k = at[a] - w->origin_node[static_cast<std::size_t>(a)];
      if (k < 0 || k >= w->nodes) return std::nan("");
      i[a] = static_cast<int>(k);
    }
    const std::size_t n = w->index(i[0], i[1], i[2]);
    if (w->material[n] == 0) return std::nan("");
    return static_cast<double>(w->distance[n]) * static_cast<double>(w->metres_per_unit);
  }
  [[nodiscard]] double value(const perception::Vec3& p_W, double blend) const {
    if (newer_ == nullptr) return std::nan("");
    std::int64_t base[3];
    double u[3];
    for (int a = 0; a < 3; ++a) {
      const double q = p_W[a] / newer_->voxel_size;
      if (!(std::abs(q) < 1e9)) return std::nan("");
      base[a] = static_cast<std::int64_t>(std::floor(q));
      u[a] = q - static_cast<double>(base[a]);
    }
    double sum = 0;
    for (int c = 0; c < 8; ++c) {
      double weight = 1;
      std::int64_t at[3];
      for (int a = 0; a < 3; ++a) {
        const bool far = ((c >> a) & 1) != 0;
        at[a] = base[a] + (far ? 1 : 0);
        weight *= far ? u[a] : 1 - u[a];
      }
      const double v = node_value(at, blend);
      if (std::isnan(v)) return v;
      sum += weight * v;
    }
    return sum;
  }
  const perception::SurfacePatch *older_ = nullptr, *newer_ = nullptr;
  Turn turn_;
  std::uint64_t judged_ = 0, unknown_ = 0, sunk_ = 0, flipped_ = 0;
  double deepest_m_ = 0, depth_m_ = std::nan("");
};

}  // namespace teletact
