// The renderer's loops over a row, against one pixel at a time.
#include "drivers/camera/row_kernels.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rt/random.hpp"

namespace {

constexpr int kWidths[] = {1, 2, 7, 8, 31, 64, 147, 512};

TEST(RowKernels, DrawWhatRandomDrawsOneByOne) {
  const drivers::NormalTable normal;
  for (const int n : kWidths) {
    for (std::uint64_t stream = 0; stream < 5; ++stream) {
      const drivers::RowStream row(42, stream);
      std::vector<float> drawn(static_cast<std::size_t>(n));
      drivers::draw_normals(row, normal, drawn.data(), n);
      rt::Random rng(42, stream);
      for (int u = 0; u < n; ++u) {
        const std::uint64_t bits = rng();
        ASSERT_EQ(row(u), bits) << "stream " << stream << ", " << u << " of " << n;
        ASSERT_EQ(drawn[static_cast<std::size_t>(u)],
                  normal(static_cast<std::uint32_t>(bits >> 32U)))
            << "stream " << stream << ", " << u << " of " << n;
      }
    }
  }
}

// Rows of 1/depth with steps, slopes and holes.
std::vector<float> some_row(rt::Random& rng, int n) {
  std::vector<float> row(static_cast<std::size_t>(n));
  double inverse = rng.uniform(0.2, 2), slope = 0;
  for (float& r : row) {
    if (rng.uniform() < 0.1) inverse = rng.uniform(0.2, 2), slope = rng.uniform(-0.01, 0.01);
    inverse += slope;
    r = rng.uniform() < 0.1 ? 0.0F : static_cast<float>(inverse);
  }
  return row;
}

TEST(RowKernels, MarkThePixelsBesideAnEdge) {
  int marked = 0, all = 0;
  for (const int n : kWidths) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      rt::Random rng(seed, 9);
      const auto row = some_row(rng, n), up = some_row(rng, n), down = some_row(rng, n);
      const bool border = seed % 4 == 0;
      std::vector<float> step(row.size());
      std::vector<std::uint8_t> beside(row.size(), 7);
      drivers::mark_edges(
          {row.data(), border ? nullptr : up.data(), border ? nullptr : down.data()}, step.data(),
          beside.data(), n);
      for (std::size_t u = 0; u < row.size(); ++u) {
        float most = 0;
        if (u > 0 && u + 1 < row.size()) most = std::abs(row[u - 1] - 2 * row[u] + row[u + 1]);
        if (!border) most = std::max(most, std::abs(up[u] - 2 * row[u] + down[u]));
        const bool want =
            row[u] > 0 && most > static_cast<float>(drivers::DepthNoise::kEdgeStep) * row[u];
        ASSERT_EQ(beside[u], want ? 1 : 0) << "seed " << seed << ", " << u << " of " << n;
        marked += want ? 1 : 0, ++all;
      }
    }
  }
  EXPECT_GT(marked, all / 20);
  EXPECT_LT(marked, all);
}

TEST(RowKernels, ShakeByTheModelsSigmaAndLeaveHoles) {
  for (const int n : kWidths) {
    rt::Random rng(static_cast<std::uint64_t>(n), 3);
    std::vector<float> z(static_cast<std::size_t>(n)), deviate(z.size());
    for (std::size_t u = 0; u < z.size(); ++u) {
      z[u] = rng.uniform() < 0.2 ? 0.0F : static_cast<float>(rng.uniform(0.4, 8));
      deviate[u] = static_cast<float>(rng.normal());
    }
    const std::vector<float> before = z;
    drivers::shake_row(z.data(), deviate.data(), nullptr, 2.0F, n);
    for (std::size_t u = 0; u < z.size(); ++u) {
      const double d = static_cast<double>(before[u]);
      const double want =
          d > 0 ? d + 2 * drivers::kinect_v2_sigma_m(d) * static_cast<double>(deviate[u]) : 0;
      ASSERT_NEAR(z[u], want, 2e-6) << u << " of " << n;
    }
  }
}

}  // namespace
