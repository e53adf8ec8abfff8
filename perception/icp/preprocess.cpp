#include "perception/icp/preprocess.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/icp/kernels.hpp"

namespace perception {

void PreprocessConfig::describe(config::Section& s) {
  s.number("depth_min_m", depth_min_m, 0.05, 5, "nearer readings are dropped")
      .number("depth_max_m", depth_max_m, 0.5, 20, "farther readings are dropped")
      .integer("bilateral_radius_px", bilateral_radius_px, 0, 4, "0 switches the filter off")
      .number("bilateral_sigma_px", bilateral_sigma_px, 0.3, 10, "spatial width of the filter")
      .number("edge_base_m", edge_base_m, 0.001, 0.5, "depth step that is an edge, at depth 0")
      .number("edge_per_m2", edge_per_m2, 0, 0.1, "and its growth with depth squared")
      .number("edge_slope", edge_slope, 0, 20,
              "steepest surface, dz/dx, whose pixels are neighbours");
}

PaddedImage::PaddedImage(int max_width, int max_height)
    : max_width_(max_width), max_height_(max_height) {
  const int stride = (max_width + 2 * kMargin + 7) / 8 * 8;
  data_.assign(
      static_cast<std::size_t>(stride) * static_cast<std::size_t>(max_height + 2 * kMargin), 0.0F);
  reshape(max_width, max_height);
}

void PaddedImage::reshape(int width, int height) noexcept {
  width_ = std::min(width, max_width_);
  height_ = std::min(height, max_height_);
  stride_ = (width_ + 2 * kMargin + 7) / 8 * 8;
  origin_ = static_cast<std::ptrdiff_t>(kMargin) * stride_ + kMargin;
  float* p = data_.data();
  const auto rows = static_cast<std::size_t>(kMargin) * static_cast<std::size_t>(stride_);
  std::fill_n(p, rows, 0.0F);
  std::fill_n(p + static_cast<std::ptrdiff_t>(height_ + kMargin) * stride_, rows, 0.0F);
  for (int v = 0; v < height_; ++v) {
    std::fill_n(row(v) - kMargin, kMargin, 0.0F);
    std::fill_n(row(v) + width_, stride_ - kMargin - width_, 0.0F);
  }
}

namespace {

// Kernels write whole groups of eight; what lies right of the image must stay "no reading".
void clear_right(PaddedImage& image, int v) noexcept {
  float* row = image.row(v);
  std::fill(row + image.width(), row + image.stride() - PaddedImage::kMargin, 0.0F);
}

}  // namespace

void depth_to_metres(ImageView<const std::uint16_t> depth_mm, float min_m, float max_m,
                     PaddedImage& out) noexcept {
  out.reshape(depth_mm.width, depth_mm.height);
  for (int v = 0; v < out.height(); ++v) {
    icp::kernels().to_metres_row(depth_mm.row(v), out.width(), min_m, max_m, out.row(v));
  }
}

namespace {

// Rows v0 .. v1 - 1 of an output that has its shape.
struct Rows {
  int v0, v1;
};
constexpr int kBands = 8;
Rows band(int height, int b) noexcept { return {height * b / kBands, height * (b + 1) / kBands}; }

void bilateral_rows(const PaddedImage& in, const std::vector<float>& weights, int radius,
                    const icp::EdgeRule& rule, Rows rows, PaddedImage& out) noexcept {
  for (int v = rows.v0; v < rows.v1; ++v) {
    icp::kernels().bilateral_row(in.row(v), in.stride(), in.width(), weights.data(), radius, rule,
                                 out.row(v));
    clear_right(out, v);
  }
}

void half_shape(const PaddedImage& in, PaddedImage& out) noexcept {
  out.reshape((in.width() + 1) / 2, (in.height() + 1) / 2);
}

void half_rows(const PaddedImage& in, const icp::EdgeRule& rule, Rows rows,
               PaddedImage& out) noexcept {
  for (int v = rows.v0; v < rows.v1; ++v)
    icp::kernels().half_row(in.row(2 * v), in.stride(), out.width(), rule, out.row(v));
}

void normal_shape(DepthLevel& level) noexcept {
  for (PaddedImage* n : {&level.nx, &level.ny, &level.nz})
    n->reshape(level.depth.width(), level.depth.height());
}

void normal_rows(DepthLevel& level, const icp::EdgeRule& rule, Rows rows) noexcept {
  const PaddedImage& z = level.depth;
  for (int v = rows.v0; v < rows.v1; ++v) {
    icp::kernels().normal_row(z.row(v), z.stride(), z.width(),
                              level.x_factor.data() + PaddedImage::kMargin,
                              level.y_factor.data() + PaddedImage::kMargin + v, rule,
                              level.nx.row(v), level.ny.row(v), level.nz.row(v));
  }
}

}  // namespace

void bilateral(const PaddedImage& in, const std::vector<float>& weights, int radius,
               const icp::EdgeRule& rule, PaddedImage& out) noexcept {
  out.reshape(in.width(), in.height());
  bilateral_rows(in, weights, radius, rule, {0, in.height()}, out);
}

void half_sample(const PaddedImage& in, const icp::EdgeRule& rule, PaddedImage& out) noexcept {
  half_shape(in, out);
  half_rows(in, rule, {0, out.height()}, out);
}

void normals(DepthLevel& level, const icp::EdgeRule& rule) noexcept {
  normal_shape(level);
  normal_rows(level, rule, {0, level.depth.height()});
}

std::vector<float> bilateral_weights(int radius, double sigma_px) {
  const auto weight = [&](int du, int dv) {
    return static_cast<float>(std::exp(-0.5 * (du * du + dv * dv) / (sigma_px * sigma_px)));
  };
  std::vector<float> w{1.0F};
  for (int dv = 0; dv <= radius; ++dv) {
    for (int du = dv == 0 ? 1 : -radius; du <= radius; ++du) w.push_back(weight(du, dv));
  }
  return w;
}

icp::EdgeRule TrackingPyramid::edge_rule(double focal_px) const noexcept {
  return {static_cast<float>(config_.edge_base_m),
          static_cast<float>(config_.edge_slope / focal_px),
          static_cast<float>(config_.edge_per_m2)};
}

TrackingPyramid::TrackingPyramid(rt::NonRealtime&, const PreprocessConfig& config, int max_width,
                                 int max_height)
    : config_(config),
      raw_(max_width, max_height),
      half_((max_width + 1) / 2, (max_height + 1) / 2),
      quarter_((max_width + 3) / 4, (max_height + 3) / 4),
      spatial_weight_(bilateral_weights(config.bilateral_radius_px, config.bilateral_sigma_px)) {
  int w = max_width, h = max_height;
  for (DepthLevel& level : levels_) {
    level.depth = level.nx = level.ny = level.nz = PaddedImage(w, h);
    level.x_factor.assign(static_cast<std::size_t>(w + 3 * PaddedImage::kMargin), 0.0F);
    level.y_factor.assign(static_cast<std::size_t>(h + 3 * PaddedImage::kMargin), 0.0F);
    w = (w + 1) / 2;
    h = (h + 1) / 2;
  }
}

namespace {

void set_camera(DepthLevel& level, const Intrinsics& k) noexcept {
  if (level.intrinsics == k) return;
  level.intrinsics = k;
  constexpr int kMargin = PaddedImage::kMargin;
  for (int i = 0; i < k.width + 2 * kMargin; ++i) {
    level.x_factor[static_cast<std::size_t>(i)] = static_cast<float>((i - kMargin - k.cx) / k.fx);
  }
  for (int i = 0; i < k.height + 2 * kMargin; ++i) {
    level.y_factor[static_cast<std::size_t>(i)] = static_cast<float>((i - kMargin - k.cy) / k.fy);
  }
}

int count_readings(const PaddedImage& depth) noexcept {
  int n = 0;
  for (int v = 0; v < depth.height(); ++v) {
    const float* row = depth.row(v);
    for (int u = 0; u < depth.width(); ++u) n += row[u] > 0 ? 1 : 0;
  }
  return n;
}

}  // namespace

void TrackingPyramid::build(ImageView<const std::uint16_t> depth_mm, const Intrinsics& intrinsics,
                            int pixel_step, rt::ForkJoin& crew) noexcept {
  pixel_step_ = pixel_step >= 4 ? 4 : (pixel_step >= 2 ? 2 : 1);
  depth_to_metres(depth_mm, static_cast<float>(config_.depth_min_m),
                  static_cast<float>(config_.depth_max_m), raw_);
  work_ = static_cast<std::uint64_t>(raw_.width()) * static_cast<std::uint64_t>(raw_.height());
  if (pixel_step_ >= 2) half_sample(raw_, edge_rule(intrinsics.fx), half_);
  if (pixel_step_ >= 4) half_sample(half_, edge_rule(intrinsics.fx / 2), quarter_);
  const PaddedImage& base = pixel_step_ >= 4 ? quarter_ : (pixel_step_ >= 2 ? half_ : raw_);
  Intrinsics k = intrinsics.subsampled(pixel_step_);
  k.width = base.width();
  k.height = base.height();
  PaddedImage& filtered = levels_[0].depth;
  filtered.reshape(base.width(), base.height());
  crew.for_parts(kBands, [&](int b) {
    bilateral_rows(base, spatial_weight_, config_.bilateral_radius_px, edge_rule(k.fx),
                   band(base.height(), b), filtered);
  });
  // Normals and the next coarser image both follow from an image's depth.
  half_shape(filtered, levels_[1].depth);
  half_shape(levels_[1].depth, levels_[2].depth);
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    DepthLevel& level = levels_[l];
    DepthLevel* const next = l + 1 < levels_.size() ? &levels_[l + 1] : nullptr;
    set_camera(level, k);
    normal_shape(level);
    const auto part = [&](int p) {
      if (p < kBands) {
        normal_rows(level, edge_rule(k.fx), band(level.depth.height(), p));
      } else if (next != nullptr) {
        half_rows(level.depth, edge_rule(k.fx), band(next->depth.height(), p - kBands),
                  next->depth);
      }
    };
    (l == 0 ? crew : rt::serial()).for_parts(2 * kBands, part);
    work_ += static_cast<std::uint64_t>(k.width) * static_cast<std::uint64_t>(k.height);
    k = k.subsampled(2);
  }
  levels_[1].valid = count_readings(levels_[1].depth);
}

namespace {

void drop_pixel(DepthLevel& level, int u, int v) noexcept {
  for (PaddedImage* image : {&level.depth, &level.nx, &level.ny, &level.nz}) image->row(v)[u] = 0;
}

// Pixel n of a level that is 2^shift finer lies between pixels n >> shift and the next one.
void drop_finer(ImageView<const std::uint8_t> mask, int shift, DepthLevel& level) noexcept {
  const int half = (1 << shift) / 2, edge = 1 << shift;
  for (int v = 0; v < mask.height; ++v) {
    for (int u = 0; u < mask.width; ++u) {
      if (mask.at(u, v) == 0) continue;
      const int u0 = std::max(0, u * edge - half), v0 = std::max(0, v * edge - half);
      const int u1 = std::min(level.depth.width() - 1, u * edge + half),
                v1 = std::min(level.depth.height() - 1, v * edge + half);
      for (int y = v0; y <= v1; ++y)
        for (int x = u0; x <= u1; ++x) drop_pixel(level, x, y);
    }
  }
}

}  // namespace

void TrackingPyramid::drop(ImageView<const std::uint8_t> mask, int l) noexcept {
  for (int n = 0; n <= l; ++n) drop_finer(mask, l - n, levels_[static_cast<std::size_t>(n)]);
  for (int n = l + 1; n < kLevels; ++n) {
    const int shift = n - l;
    DepthLevel& level = levels_[static_cast<std::size_t>(n)];
    for (int v = 0; v < level.depth.height(); ++v)
      for (int u = 0; u < level.depth.width(); ++u)
        if (mask.at(std::min(u << shift, mask.width - 1), std::min(v << shift, mask.height - 1)) !=
            0)
          drop_pixel(level, u, v);
  }
  levels_[1].valid = count_readings(levels_[1].depth);
}

double TrackingPyramid::mean_depth(const icp::NoiseRule& noise) const noexcept {
  const PaddedImage& depth = levels_[kLevels - 1].depth;
  double weight = 0, sum_m = 0;
  for (int v = 0; v < depth.height(); ++v) {
    const float* row = depth.row(v);
    for (int u = 0; u < depth.width(); ++u) {
      if (!(row[u] > 0)) continue;
      if (noise.per_m2 == 0) {  // all weigh 1
        weight += 1;
        sum_m += static_cast<double>(row[u]);
        continue;
      }
      const float beyond = std::max(row[u] - noise.from_m, 0.0F);
      const float ratio = noise.least_m / (noise.least_m + noise.per_m2 * beyond * beyond);
      const double w = static_cast<double>(ratio * ratio);
      weight += w;
      sum_m += w * static_cast<double>(row[u]);
    }
  }
  return weight > 0 ? sum_m / weight : 0.0;
}

}  // namespace perception
