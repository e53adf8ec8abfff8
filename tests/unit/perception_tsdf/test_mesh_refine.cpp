// Vertices onto the surface of their neighbourhood: against a slow reference, and on shapes that
// are known.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "perception/tsdf/mesh/mesh.hpp"
#include "rt/random.hpp"

namespace tests {
namespace {

using namespace perception;  // NOLINT: a test

constexpr double kVoxel = 0.01;

struct Cloud {
  Mesh mesh;
  std::vector<float> readings;
  void add(const Vec3& p, const Vec3& n, double seen) {
    mesh.vertices_W.push_back(p.cast<float>());
    mesh.normals_W.push_back(n.normalized().cast<float>());
    readings.push_back(static_cast<float>(seen));
  }
};

void refine(Cloud& c, const RefineOptions& o = {}) {
  rt::Startup startup;
  refine_vertices(startup.token(), c.readings, kVoxel, o, c.mesh);
}

double rms_mm(const Mesh& m, const std::function<double(const Vec3&)>& distance) {
  double sum = 0;
  for (const auto& v : m.vertices_W) sum += std::pow(1e3 * distance(v.cast<double>()), 2);
  return std::sqrt(sum / static_cast<double>(m.vertices_W.size()));
}

// Everything with everything, by QR of the weighed rows: where vertex i goes.
struct Slow {
  Vec3 vertex, normal;
};
Slow slow(const Cloud& c, std::size_t i, const RefineOptions& o) {
  const Vec3 p = c.mesh.vertices_W[i].cast<double>(), n = c.mesh.normals_W[i].cast<double>();
  const Vec3 s = n.unitOrthogonal(), t = n.cross(s);
  const double R = o.radius * kVoxel, gate = std::cos(o.most_angle_deg * std::numbers::pi / 180);
  std::vector<std::array<double, 4>> rows;  // x, y, z, weight
  double kernels = 0, weights = 0;
  for (std::size_t k = 0; k < c.readings.size(); ++k) {
    const Vec3 d = c.mesh.vertices_W[k].cast<double>() - p;
    const double cosine = n.dot(c.mesh.normals_W[k].cast<double>()), z = n.dot(d);
    if (d.norm() >= R || cosine <= gate || std::fabs(z) >= kVoxel) continue;
    const double kernel = std::pow(1 - std::pow(d.norm() / R, 2), 2) *
                          std::pow((cosine - gate) / (1 - gate), 2) *
                          std::pow(1 - std::pow(z / kVoxel, 2), 2);
    const double weight = kernel * std::max(1.0, static_cast<double>(c.readings[k]));
    rows.push_back({s.dot(d) / R, t.dot(d) / R, z / R, weight});
    kernels += kernel, weights += weight;
  }
  if (rows.size() < 8 || kernels < 2) return {p, n};
  const auto solve = [&](int terms) {
    const auto count = static_cast<Eigen::Index>(rows.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(count + terms - 1, terms);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(count + terms - 1);
    for (Eigen::Index r = 0; r < count; ++r) {
      const auto& [x, y, z, w] = rows[static_cast<std::size_t>(r)];
      const double f[6] = {1, x, y, x * x, x * y, y * y};
      for (int a = 0; a < terms; ++a) A(r, a) = std::sqrt(w) * f[a];
      b(r) = std::sqrt(w) * z;
    }
    for (int a = 1; a < terms; ++a) A(count + a - 1, a) = std::sqrt(1e-3 * weights);
    return std::pair<Eigen::MatrixXd, Eigen::VectorXd>(A, A.colPivHouseholderQr().solve(b));
  };
  const auto [flat_rows, flat] = solve(3);
  const auto [rows_6, bent] = solve(6);
  double left = 0;
  for (const auto& [x, y, z, w] : rows) {
    const double fit =
        bent(0) + x * bent(1) + y * bent(2) + x * x * bent(3) + x * y * bent(4) + y * y * bent(5);
    left += w * (z - fit) * (z - fit);
  }
  for (int a = 1; a < 6; ++a) left += 1e-3 * weights * bent(a) * bent(a);
  const double variance =
      left / std::max(1.0, kernels - 3) * (rows_6.transpose() * rows_6).inverse()(0, 0);
  const double more = bent(0) - flat(0);
  const double share = more * more > variance ? 1 - variance / (more * more) : 0;
  const double most =
      std::min(kVoxel, o.most_sigmas * o.reading_sigma_m /
                           std::sqrt(std::max(1.0, static_cast<double>(c.readings[i]))));
  const double along = std::clamp((flat(0) + share * more) * R, -most, most);
  const double u = flat(1) + share * (bent(1) - flat(1)), v = flat(2) + share * (bent(2) - flat(2));
  return {p + along * n, (n - u * s - v * t).normalized()};
}

TEST(MeshRefine, IsWhatTheSlowReferenceSays) {
  constexpr std::uint64_t kSeed = 8;
  rt::Random random(kSeed);
  double most = 0;
  for (int round = 0; round < 8; ++round) {
    Cloud c;
    const Vec3 centre(random.uniform(), -random.uniform(), random.uniform());
    const double r = 0.03 + 0.1 * random.uniform();
    for (int k = 0; k < 700; ++k) {  // a noisy sphere across the axes' planes, and a wall
      const Vec3 d = Vec3(random.normal(), random.normal(), random.normal()).normalized();
      const Vec3 tilt = 0.1 * Vec3(random.normal(), random.normal(), random.normal());
      if (k % 3 != 0)
        c.add(centre + (r + 1e-3 * random.normal()) * d, d + tilt, 2 + 98 * random.uniform());
      else
        c.add(Vec3(0.1 * random.uniform(), 0.1 * random.uniform(), 1e-3 * random.normal()),
              Vec3::UnitZ() + tilt, 100 * random.uniform());
    }
    Cloud done = c;
    refine(done);
    for (std::size_t i = 0; i < c.readings.size(); ++i) {
      const Slow want = slow(c, i, {});
      EXPECT_NEAR((done.mesh.vertices_W[i].cast<double>() - want.vertex).norm(), 0, 2e-7)
          << "seed " << kSeed << ", round " << round << ", vertex " << i;
      EXPECT_NEAR((done.mesh.normals_W[i].cast<double>() - want.normal).norm(), 0, 1e-5);
      most = std::max(most,
                      static_cast<double>((done.mesh.vertices_W[i] - c.mesh.vertices_W[i]).norm()));
    }
  }
  EXPECT_GT(most, 1e-3) << "something moves";
}

// Independent noise, as neighbouring pixels have.
TEST(MeshRefine, NoiseOfAWallFallsToAThird) {
  rt::Random random(3);
  Cloud c;
  const Vec3 n = Vec3(0.3, -0.5, 0.8).normalized(), s = n.unitOrthogonal(), t = n.cross(s);
  for (int i = 0; i < 60; ++i)
    for (int k = 0; k < 60; ++k)
      c.add(7e-3 * (i * s + k * t) + 1e-3 * random.normal() * n,
            n + 0.07 * Vec3(random.normal(), random.normal(), random.normal()), 16);
  const auto off = [&](const Vec3& p) { return n.dot(p); };
  const double before = rms_mm(c.mesh, off);
  refine(c);
  std::printf("wall: RMS %.3f mm of %.3f\n", rms_mm(c.mesh, off), before);
  EXPECT_LT(3 * rms_mm(c.mesh, off), before);
}

TEST(MeshRefine, ShapesWithoutNoiseStayWhatTheyAre) {
  rt::Random random(5);
  for (const double r : {0.05, 0.15, 0.5}) {
    Cloud c;
    for (int k = 0; k < 40000 && k < 2e4 * 12.6 * r * r; ++k) {
      const Vec3 d = Vec3(random.normal(), random.normal(), random.normal()).normalized();
      c.add(r * d, d, 50);
    }
    const auto off = [&](const Vec3& p) { return p.norm() - r; };
    refine(c);
    std::printf("sphere of %.2f m: RMS %.4f mm\n", r, rms_mm(c.mesh, off));
    EXPECT_LT(rms_mm(c.mesh, off), 0.12) << r;
  }
  // A step of 15 mm and a corner, vertices up to the edge with their own face's normal.
  Cloud step, corner;
  for (int k = 0; k < 8000; ++k) {
    const double x = 0.2 * random.uniform() - 0.1, y = 0.2 * random.uniform();
    step.add(Vec3(x, y, x < 0 ? 0 : 0.015), Vec3::UnitZ(), 20);
    if (k % 2 == 0)
      corner.add(Vec3(std::fabs(x), y, 0), Vec3::UnitZ(), 20);
    else
      corner.add(Vec3(0, y, std::fabs(x)), Vec3::UnitX(), 20);
  }
  refine(step), refine(corner);
  EXPECT_LT(rms_mm(step.mesh, [](const Vec3& p) { return p.z() - (p.x() < 0 ? 0 : 0.015); }), 1e-3);
  EXPECT_LT(rms_mm(corner.mesh, [](const Vec3& p) { return std::min(p.x(), p.z()); }), 1e-3);
}

TEST(MeshRefine, WhatManyReadingsSayStays) {
  rt::Random random(7);
  Cloud c;
  for (int k = 0; k < 4000; ++k)
    c.add(Vec3(0.2 * random.uniform(), 0.2 * random.uniform(), 3e-3 * random.normal()),
          Vec3::UnitZ(), k % 2 == 0 ? 100 : 4);
  const Mesh before = c.mesh;
  refine(c);
  for (std::size_t i = 0; i < c.readings.size(); ++i) {
    const double way = static_cast<double>((c.mesh.vertices_W[i] - before.vertices_W[i]).norm());
    EXPECT_LE(way, 3 * 4e-3 / std::sqrt(static_cast<double>(c.readings[i])) + 1e-7);
  }
}

TEST(MeshRefine, TooLittleIsLeftAlone) {
  Cloud none;
  refine(none);
  EXPECT_TRUE(none.mesh.vertices_W.empty());
  Cloud few;
  for (int k = 0; k < 7; ++k)
    few.add(Vec3(2e-3 * k, 1e-3 * (k % 3), 1e-3 * (k % 2)), Vec3::UnitZ(), 2);
  const Mesh before = few.mesh;
  refine(few);
  for (std::size_t i = 0; i < 7; ++i) EXPECT_EQ(few.mesh.vertices_W[i], before.vertices_W[i]);
}

}  // namespace
}  // namespace tests
