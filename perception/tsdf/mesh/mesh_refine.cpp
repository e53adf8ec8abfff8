#include "perception/tsdf/mesh/mesh_refine.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "perception/tsdf/mesh/mesh.hpp"

namespace perception {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

// Vertices in cells of one radius, in the order of the cells; z runs fastest, so the three cells
// above each other are one run.
class Cells {
 public:
  Cells(const std::vector<Eigen::Vector3f>& points, double edge) : inv_edge_(1 / edge) {
    entries_.reserve(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const auto c = cell_of(points[i]);
      entries_.push_back({key(c[0], c[1], c[2]), static_cast<std::uint32_t>(i)});
    }
    std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) {
      return a.key != b.key ? a.key < b.key : a.vertex < b.vertex;
    });
  }
  // fn(the vertices of a cell, those of it and the 26 about it), for every cell that has any.
  template <class Fn>
  void for_each(const std::vector<Eigen::Vector3f>& points, Fn&& fn) const {
    std::vector<std::uint32_t> own, near;
    for (std::size_t from = 0; from < entries_.size();) {
      std::size_t to = from;
      own.clear(), near.clear();
      while (to < entries_.size() && entries_[to].key == entries_[from].key)
        own.push_back(entries_[to++].vertex);
      const auto c = cell_of(points[own.front()]);
      for (int n = 0; n < 9; ++n) {
        const std::int64_t x = c[0] + n / 3 - 1, y = c[1] + n % 3 - 1;
        const std::uint64_t last = key(x, y, c[2] + 1);
        auto it = std::lower_bound(entries_.begin(), entries_.end(), key(x, y, c[2] - 1),
                                   [](const Entry& e, std::uint64_t k) { return e.key < k; });
        for (; it != entries_.end() && it->key <= last; ++it) near.push_back(it->vertex);
      }
      fn(own, near);
      from = to;
    }
  }

 private:
  struct Entry {
    std::uint64_t key;
    std::uint32_t vertex;
  };
  [[nodiscard]] std::array<std::int64_t, 3> cell_of(const Eigen::Vector3f& p) const {
    std::array<std::int64_t, 3> c{};
    for (int a = 0; a < 3; ++a)
      c[static_cast<std::size_t>(a)] =
          static_cast<std::int64_t>(std::floor(static_cast<double>(p(a)) * inv_edge_));
    return c;
  }
  static std::uint64_t key(std::int64_t x, std::int64_t y, std::int64_t z) {
    constexpr std::int64_t kShift = 1 << 20;
    return static_cast<std::uint64_t>((x + kShift) << 42 | (y + kShift) << 21 | (z + kShift));
  }
  double inv_edge_;
  std::vector<Entry> entries_;
};

struct Moved {
  double along = 0;  // the normal, m
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
};

class Refiner {
 public:
  Refiner(const Mesh& mesh, std::span<const float> readings, double voxel_m, const RefineOptions& o)
      : mesh_(mesh),
        readings_(readings),
        o_(o),
        voxel_(voxel_m),
        radius_(o.radius * voxel_m),
        least_cos_(std::cos(o.most_angle_deg * std::numbers::pi / 180)) {}

  // Of vertex i among those near it.
  void move(std::uint32_t i, const std::vector<std::uint32_t>& near, Eigen::Vector3f& vertex,
            Eigen::Vector3f& normal) const {
    const Vec3 p = mesh_.vertices_W[i].cast<double>(), n = mesh_.normals_W[i].cast<double>();
    const Vec3 s = n.unitOrthogonal(), t = n.cross(s);
    Sums sums;
    for (const std::uint32_t k : near) add(k, p, n, s, t, sums);
    Moved m;
    if (!fit(sums, m)) return;
    const double most =
        std::min(voxel_, o_.most_sigmas * o_.reading_sigma_m /
                             std::sqrt(std::max(1.0, static_cast<double>(readings_[i]))));
    vertex = (p + std::clamp(m.along, -most, most) * n).cast<float>();
    normal = (n - m.slope(0) * s - m.slope(1) * t).normalized().cast<float>();
  }

 private:
  // Over the neighbours: weighted products of (1, x, y, x^2, xy, y^2) and of the offset z; lengths
  // in radii.
  struct Sums {
    Mat6 A = Mat6::Zero();
    Vec6 b = Vec6::Zero();
    double zz = 0, kernel = 0;
    int count = 0;
  };

  void add(std::uint32_t k, const Vec3& p, const Vec3& n, const Vec3& s, const Vec3& t,
           Sums& sums) const {
    const Vec3 d = mesh_.vertices_W[k].cast<double>() - p;
    const double r2 = d.squaredNorm() / (radius_ * radius_);
    const double c = n.dot(mesh_.normals_W[k].cast<double>());
    const double z_m = d.dot(n), step = z_m / voxel_;
    if (r2 >= 1 || c <= least_cos_ || step * step >= 1) return;
    const double near = 1 - r2, alike = (c - least_cos_) / (1 - least_cos_),
                 level = 1 - step * step;
    const double kernel = near * near * alike * alike * level * level;
    const double w = kernel * std::max(1.0, static_cast<double>(readings_[k]));
    const double x = d.dot(s) / radius_, y = d.dot(t) / radius_, z = z_m / radius_;
    const Vec6 f = (Vec6() << 1, x, y, x * x, x * y, y * y).finished();
    sums.A.noalias() += w * f * f.transpose();
    sums.b += w * z * f;
    sums.zz += w * z * z;
    sums.kernel += kernel;
    ++sums.count;
  }

  // False: too few neighbours for a plane.
  bool fit(const Sums& sums, Moved& out) const {
    constexpr int kLeast = 8;
    constexpr double kLeastKernel = 2, kRidge = 1e-3;
    if (sums.count < kLeast || sums.kernel < kLeastKernel) return false;
    const double ridge = kRidge * sums.A(0, 0);
    Eigen::Matrix3d P = sums.A.topLeftCorner<3, 3>();
    P.diagonal().tail<2>().array() += ridge;
    Mat6 Q = sums.A;
    Q.diagonal().tail<5>().array() += ridge;
    const Eigen::LDLT<Eigen::Matrix3d> plane_of(P);
    const Eigen::LDLT<Mat6> bent_of(Q);
    const Vec3 plane = plane_of.solve(Vec3(sums.b.head<3>()));
    const Vec6 bent = bent_of.solve(sums.b);
    if (!plane.allFinite() || !bent.allFinite()) return false;
    // Variance of the bent surface's height here, from what it leaves over.
    const double left = std::max(0.0, sums.zz - bent.dot(sums.b));
    const double sigma2 = left / std::max(1.0, sums.kernel - 3);
    const Vec6 first = bent_of.solve(Vec6(Vec6::Unit(0)));
    const double variance = sigma2 * first(0);
    const double more = bent(0) - plane(0);
    const double share = more * more > variance ? 1 - variance / (more * more) : 0;
    out.along = (plane(0) + share * more) * radius_;
    out.slope = plane.tail<2>() + share * (bent.segment<2>(1) - plane.tail<2>());
    return true;
  }

  const Mesh& mesh_;
  std::span<const float> readings_;
  RefineOptions o_;
  double voxel_, radius_, least_cos_;
};

}  // namespace

void refine_vertices(rt::NonRealtime&, std::span<const float> readings, double voxel_m,
                     const RefineOptions& options, Mesh& mesh) {
  if (mesh.vertices_W.empty() || readings.size() != mesh.vertices_W.size()) return;
  const Cells cells(mesh.vertices_W, options.radius * voxel_m);
  const Refiner refiner(mesh, readings, voxel_m, options);
  std::vector<Eigen::Vector3f> vertices = mesh.vertices_W, normals = mesh.normals_W;
  cells.for_each(mesh.vertices_W, [&](const std::vector<std::uint32_t>& own,
                                      const std::vector<std::uint32_t>& near) {
    for (const std::uint32_t i : own) refiner.move(i, near, vertices[i], normals[i]);
  });
  mesh.vertices_W = std::move(vertices);
  mesh.normals_W = std::move(normals);
}

}  // namespace perception
