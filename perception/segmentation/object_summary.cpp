#include "perception/segmentation/object_summary.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace perception {

ObjectSummary summarise(std::span<const Vec3f> points, std::span<const Rgb> colours,
                        std::span<float> scratch) noexcept {
  ObjectSummary s;
  double r = 0, g = 0, b = 0;
  for (const Rgb& c : colours) r += c.r, g += c.g, b += c.b;
  if (!colours.empty()) {
    const auto m = static_cast<double>(colours.size());
    s.colour = {static_cast<std::uint8_t>(r / m + 0.5), static_cast<std::uint8_t>(g / m + 0.5),
                static_cast<std::uint8_t>(b / m + 0.5)};
  }
  const std::size_t n = points.size();
  if (n < 3 || scratch.size() < n) return s;
  s.points = static_cast<int>(n);
  Vec3 mean = Vec3::Zero();
  for (const Vec3f& p : points) mean += p.cast<double>();
  mean /= static_cast<double>(n);
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  for (const Vec3f& p : points) {
    const Vec3 e = p.cast<double>() - mean;
    moment += e * e.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(moment / static_cast<double>(n));
  Eigen::Matrix3d axes;
  for (int k = 0; k < 3; ++k) axes.col(k) = solver.eigenvectors().col(2 - k);

  double low[3], high[3];
  for (int k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < n; ++i) {
      scratch[i] = static_cast<float>(axes.col(k).dot(points[i].cast<double>() - mean));
    }
    // The far end is the 0.99 quantile of rt/quantile.hpp, the near end its mirror image.
    const auto cut = static_cast<std::ptrdiff_t>(n / 100);
    const auto first = scratch.begin(), end = first + static_cast<std::ptrdiff_t>(n);
    std::nth_element(first, first + cut, end);
    low[k] = static_cast<double>(scratch[static_cast<std::size_t>(cut)]);
    const auto top = static_cast<std::ptrdiff_t>(n) - 1 - cut;
    std::nth_element(first, first + top, end);
    high[k] = static_cast<double>(scratch[static_cast<std::size_t>(top)]);
    if (-low[k] > high[k]) {
      axes.col(k) *= -1;
      std::swap(low[k], high[k]);
      low[k] *= -1;
      high[k] *= -1;
    }
  }
  if (axes.determinant() < 0) {
    axes.col(2) *= -1;
    std::swap(low[2], high[2]);
    low[2] *= -1;
    high[2] *= -1;
  }
  s.X_FO.linear() = axes;
  s.X_FO.translation() = mean;
  for (int k = 0; k < 3; ++k) {
    s.extent_m[k] = high[k] - low[k];
    s.centre_m[k] = 0.5 * (high[k] + low[k]);
  }
  return s;
}

}  // namespace perception
