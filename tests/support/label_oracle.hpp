// The voxel vote of docs/segmentation.md, once more and plainly: every voxel of every block, in
// double precision, from the raw depth image. Shares no code with the product; of the map it reads
// only which blocks there are and their distances (an oracle of its own checks those). What a float
// may decide either way is left undecided, and so is the voxel from then on.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/tsdf/tsdf_map.hpp"

namespace tests {

class LabelOracle {
 public:
  struct Rules {  // of the map under test
    double voxel_m, min_depth_m, max_depth_m, edge_base_m, edge_per_m, reach_gain;
  };
  struct Voxel {
    int label = 0, weight = 0;
    bool sure = true;
  };
  using Key = std::array<int, 3>;
  using Block = std::array<Voxel, 512>;

  explicit LabelOracle(const Rules& rules) : rules_(rules) {}

  // After the frame was integrated and the label image has voted.
  void vote(const perception::TsdfMap& map, const perception::Intrinsics& k,
            perception::ImageView<const std::uint16_t> depth, const perception::Pose& X_WC,
            perception::ImageView<const std::uint8_t> labels, int fresh) {
    read_pixels(k, depth);
    const perception::Pose X_CW = X_WC.inverse();
    map.for_each_block([&](std::int32_t b, perception::BlockCoord at) {
      const Key key{at.x, at.y, at.z};
      Block work;
      const auto held = blocks_.find(key);
      if (held != blocks_.end()) {
        work = held->second;
      } else {
        for (int n = 0; n < 512; ++n)
          work[static_cast<std::size_t>(n)] = background_so_far(map, map.block_words(b)[n]);
      }
      bool any = false, doubt = false;
      for (int n = 0; n < 512; ++n) {
        Voxel& voxel = work[static_cast<std::size_t>(n)];
        const perception::Vec3 p_W(8 * at.x + n / 64, 8 * at.y + n / 8 % 8, 8 * at.z + n % 8);
        one(voxel, X_CW * (rules_.voxel_m * p_W), k, labels, fresh);
        any = any || (voxel.sure && voxel.label > 0);
        doubt = doubt || !voxel.sure;
      }
      // Room is taken where something is labelled; where that hangs on a voxel in doubt, the map
      // says.
      const bool kept = any || (doubt && map.block_labels(b) != nullptr);
      if (kept) {
        blocks_[key] = work;
      } else if (held != blocks_.end()) {
        blocks_.erase(held);
      }
    });
    images_ = blocks_.empty() ? 0 : std::min(images_ + 1, 32);
  }

  [[nodiscard]] const std::map<Key, Block>& blocks() const { return blocks_; }

 private:
  struct Pixel {
    double depth_mm = 0, reach = 1;
    bool fused = false, sure = true;
  };

  // What images before this one would have made of a voxel that had no room: background, as often
  // as it was observed near the surface.
  [[nodiscard]] Voxel background_so_far(const perception::TsdfMap& map, std::uint32_t word) const {
    const double distance_m =
        static_cast<std::int16_t>(word & 0xffffU) * static_cast<double>(map.metres_per_unit());
    const int observed = static_cast<int>(word >> 16U) / 128;
    Voxel v;
    v.weight = std::abs(distance_m) <= 0.02 ? std::min(observed, images_) : 0;
    v.sure = std::abs(std::abs(distance_m) - 0.02) > 1e-7;
    return v;
  }

  void one(Voxel& voxel, const perception::Vec3& p, const perception::Intrinsics& k,
           perception::ImageView<const std::uint8_t> labels, int fresh) const {
    if (p.z() < 0.05 - 1e-5) return;
    const double u = k.fx * p.x() / p.z() + k.cx, v = k.fy * p.y() / p.z() + k.cy;
    const double iu = std::floor(u + 0.5), iv = std::floor(v + 0.5);
    constexpr double kPx = 2e-4, kM = 5e-6;
    const auto on_line = [](double x) { return std::abs(x + 0.5 - std::round(x + 0.5)) < kPx; };
    if (u < -0.5 - kPx || v < -0.5 - kPx || u > k.width - 0.5 + kPx || v > k.height - 0.5 + kPx)
      return;
    if (on_line(u) || on_line(v) || p.z() < 0.05 + 1e-5) {
      voxel.sure = false;
      return;
    }
    const Pixel& pixel = pixels_[static_cast<std::size_t>(iv * k.width + iu)];
    if (!pixel.sure) {
      voxel.sure = false;
      return;
    }
    if (pixel.depth_mm == 0) return;
    const double sdf = (1e-3 * pixel.depth_mm - p.z()) * (p.norm() / p.z());
    // Along the ray: of large voxels longer where it meets the surface at a grazing angle.
    const double band = rules_.voxel_m > 0.011 ? 0.02 * pixel.reach : 0.02;
    for (const double limit : {-band, 0.01, band, 0.02 * pixel.reach, 0.05 * pixel.reach})
      if (std::abs(sdf - limit) < kM) voxel.sure = false;
    if (sdf < -band) return;
    const int said = labels.at(static_cast<int>(iu), static_cast<int>(iv));
    const bool says = said <= 31;
    if (sdf > band) {  // free space
      const bool other = says && said != voxel.label;
      if (sdf > 0.05 * pixel.reach || (other && sdf > 0.02 * pixel.reach)) {
        voxel.weight -= 4;
        if (voxel.weight <= 0) voxel.weight = voxel.label = 0;
      }
      return;
    }
    if (!says || !pixel.fused) return;
    const bool over_surface = sdf > 0.01;
    if (fresh != 0 && said == fresh && voxel.label == 0) voxel.weight = 0;
    if (voxel.label != 0 && said == 0 && over_surface && voxel.weight > 1) voxel.weight -= 1;
    if (voxel.weight == 0) {
      voxel.label = said;
      voxel.weight = 1;
    } else if (voxel.label == said) {
      voxel.weight = std::min(32, voxel.weight + 1);
    } else {
      voxel.weight -= 1;
      if (voxel.weight == 0) {
        voxel.label = said;
        voxel.weight = 1;
      }
    }
  }

  // Depth edges and holes carve and are not fused; the band is longer at grazing angles.
  void read_pixels(const perception::Intrinsics& k,
                   perception::ImageView<const std::uint16_t> depth) {
    pixels_.assign(static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height), {});
    const auto reading = [&](int u, int v) -> double {
      if (u < 0 || v < 0 || u >= k.width || v >= k.height) return 0;
      const int d = depth.at(u, v);
      return d == 65535 || d < 1000 * rules_.min_depth_m ? 0 : d;
    };
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) {
        Pixel& p = pixels_[static_cast<std::size_t>(v * k.width + u)];
        const double c = reading(u, v);
        const double gate = 1000 * rules_.edge_base_m + rules_.edge_per_m * c;
        double least = 1e9;
        int count = 0;
        for (int y = v - 1; y <= v + 1; ++y)
          for (int x = u - 1; x <= u + 1; ++x)
            if (reading(x, y) > 0) least = std::min(least, reading(x, y)), ++count;
        if (c == 0) {
          if (count >= 6) p.depth_mm = least;
          continue;
        }
        bool edge = false;
        const std::array<double, 4> near{reading(u - 1, v), reading(u + 1, v), reading(u, v - 1),
                                         reading(u, v + 1)};
        for (const double d : near) {
          if (d == 0) continue;
          edge = edge || std::abs(d - c) > gate;
          p.sure = p.sure && std::abs(std::abs(d - c) - gate) > 1.5;
        }
        p.depth_mm = edge ? least : c;
        p.fused = !edge && c <= 1000 * rules_.max_depth_m;
        if (!p.fused) continue;
        const auto slope = [&](double low, double high) {
          for (const double d : {low, high})
            p.sure = p.sure && (d == 0 || std::abs(std::abs(d - c) - 2 * gate) > 3);
          const bool has_low = low != 0 && std::abs(low - c) <= 2 * gate;
          const bool has_high = high != 0 && std::abs(high - c) <= 2 * gate;
          const int run = (has_low ? 2 : 0) + (has_high ? 2 : 0);
          return run == 0 ? 0.0 : ((has_high ? high : c) - (has_low ? low : c)) / run;
        };
        const double zu = slope(reading(u - 2, v), reading(u + 2, v));
        const double zv = slope(reading(u, v - 2), reading(u, v + 2));
        const perception::Vec3 ray((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
        const perception::Vec3 normal(-k.fx * zu, -k.fy * zv,
                                      c + (u - k.cx) * zu + (v - k.cy) * zv);
        const double gain = rules_.reach_gain * normal.norm() * ray.norm() / normal.dot(ray);
        const double steps = 32 * std::clamp(gain, 1.0, 3.0) + 0.5;
        p.sure = p.sure && std::abs(steps - std::round(steps)) > 1e-4;
        p.reach = std::floor(steps) / 32;
      }
  }

  Rules rules_;
  std::vector<Pixel> pixels_;
  std::map<Key, Block> blocks_;
  int images_ = 0;  // that voted since something was first labelled, up to the cap
};

}  // namespace tests
