// Filter, pyramid and normals against brute force and closed form.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "perception/icp/kernels.hpp"
#include "perception/icp/preprocess.hpp"
#include "perception/simd/isa.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

constexpr icp::EdgeRule kRule{0.02F, 0.005F, 0.006F};

PaddedImage random_image(int w, int h, rt::Random& random, double hole_share) {
  PaddedImage out(w, h);
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const double step = (u / 7 + v / 5) % 2 == 0 ? 1.2 : 2.0;
      out.row(v)[u] =
          random.uniform() < hole_share ? 0.0F : static_cast<float>(step + 0.01 * random.normal());
    }
  }
  return out;
}

double at(const PaddedImage& im, int u, int v) {
  return u < 0 || v < 0 || u >= im.width() || v >= im.height() ? 0.0
                                                               : static_cast<double>(im.row(v)[u]);
}

double noise_of(double z) { return 0.02 + 0.006 * z * z; }
double edge_of(double z) { return noise_of(z) + 0.005 * z; }

TEST(Bilateral, EqualsBruteForceAtEveryPixelAndBorder) {
  rt::Random random(11);
  for (const auto& [w, h] : {std::pair{37, 23}, {64, 40}, {9, 5}, {1, 1}}) {
    const PaddedImage in = random_image(w, h, random, 0.1);
    for (int radius = 0; radius <= 4; ++radius) {
      PaddedImage out(w, h);
      const auto weights = bilateral_weights(radius, 1.5);
      bilateral(in, weights, radius, kRule, out);
      for (int v = 0; v < h; ++v) {
        for (int u = 0; u < w; ++u) {
          const double c = at(in, u, v);
          double sum = 0, total = 0;
          for (int dv = -radius; dv <= radius; ++dv) {
            for (int du = -radius; du <= radius; ++du) {
              const double tap = at(in, u + du, v + dv), twin = at(in, u - du, v - dv);
              const double d = std::max(std::abs(tap - c), std::abs(twin - c));
              const double k = 1 - std::pow(d / edge_of(c), 2);
              if (tap <= 0 || twin <= 0 || k <= 0) continue;
              const double weight = std::exp(-0.5 * (du * du + dv * dv) / 2.25) * k * k;
              sum += weight * tap;
              total += weight;
            }
          }
          const double expected = c > 0 ? sum / total : 0;
          ASSERT_NEAR(at(out, u, v), expected, 2e-6) << u << ' ' << v << " radius " << radius;
        }
      }
    }
  }
}

TEST(Bilateral, NeverBlendsAcrossAnEdgeOrAHole) {
  PaddedImage in(40, 20), out(40, 20);
  for (int v = 0; v < 20; ++v) {
    for (int u = 0; u < 40; ++u) in.row(v)[u] = u < 20 ? 1.0F : 1.05F;
    in.row(v)[10] = 0;
  }
  bilateral(in, bilateral_weights(3, 2.0), 3, kRule, out);
  for (int v = 0; v < 20; ++v) {
    for (int u = 0; u < 40; ++u) ASSERT_FLOAT_EQ(out.row(v)[u], in.row(v)[u]);
  }
}

TEST(Bilateral, ReducesNoiseOnAPlane) {
  rt::Random random(5);
  PaddedImage in(128, 128), out(128, 128);
  for (int v = 0; v < 128; ++v) {
    for (int u = 0; u < 128; ++u) in.row(v)[u] = static_cast<float>(1.5 + 0.003 * random.normal());
  }
  bilateral(in, bilateral_weights(2, 1.5), 2, kRule, out);
  double before = 0, after = 0;
  for (int v = 4; v < 124; ++v) {
    for (int u = 4; u < 124; ++u) {
      before += std::pow(at(in, u, v) - 1.5, 2);
      after += std::pow(at(out, u, v) - 1.5, 2);
    }
  }
  const double gain = std::sqrt(before / after);
  RecordProperty("noise_reduction", std::to_string(gain));
  EXPECT_GT(gain, 2.5);
}

TEST(HalfSample, EqualsBruteForce) {
  rt::Random random(12);
  for (const auto& [w, h] : {std::pair{37, 23}, {64, 40}, {2, 2}, {1, 1}}) {
    const PaddedImage in = random_image(w, h, random, 0.15);
    PaddedImage out((w + 1) / 2, (h + 1) / 2);
    half_sample(in, kRule, out);
    ASSERT_EQ(out.width(), (w + 1) / 2);
    for (int v = 0; v < out.height(); ++v) {
      for (int u = 0; u < out.width(); ++u) {
        const double c = at(in, 2 * u, 2 * v);
        double sum = c, n = 1;
        for (int dv = -1; dv <= 1; ++dv) {
          for (int du = -1; du <= 1; ++du) {
            if (du == 0 && dv == 0) continue;
            const double a = at(in, 2 * u + du, 2 * v + dv), b = at(in, 2 * u - du, 2 * v - dv);
            if (a <= 0 || b <= 0) continue;
            if (std::abs(a - c) >= edge_of(c) || std::abs(b - c) >= edge_of(c)) continue;
            if (std::abs(a + b - 2 * c) >= noise_of(c)) continue;
            sum += a;
            n += 1;
          }
        }
        ASSERT_NEAR(at(out, u, v), c > 0 ? sum / n : 0, 1e-6);
      }
    }
  }
}

TEST(Pyramid, SlantedPlaneStaysOnThePlaneUpToItsBorder) {
  rt::Startup startup;
  tests::AnalyticScene scene;
  scene.planes = {{Vec3(0, 0, 1.4), Vec3(0.5, 0.3, -1).normalized()}};
  const Intrinsics k = tests::small_camera();
  const auto z = tests::cast_depth(scene, k, Pose::Identity());
  rt::Random random(1);
  auto mm = tests::to_mm(z, 0, random);
  for (int v = 0; v < k.height; ++v) {  // holes make borders
    for (int u = 0; u < k.width; ++u) {
      if ((u / 16 + v / 16) % 3 == 0) mm[static_cast<std::size_t>(v * k.width + u)] = 0;
    }
  }
  for (const int step : {1, 2, 4}) {
    PreprocessConfig config;
    TrackingPyramid pyramid(startup.token(), config, k.width, k.height);
    pyramid.build({mm.data(), k.width, k.height, k.width}, k, step);
    for (int l = 0; l < 3; ++l) {
      const DepthLevel& level = pyramid.level(l);
      const int s = step << l;
      ASSERT_EQ(level.intrinsics.width, (k.width + s - 1) / s);
      ASSERT_NEAR(level.intrinsics.fx, k.fx / s, 1e-12);
      double worst = 0, worst_normal = 0;
      for (int v = 0; v < level.depth.height(); ++v) {
        for (int u = 0; u < level.depth.width(); ++u) {
          const auto depth = static_cast<double>(level.depth.row(v)[u]);
          if (depth <= 0) continue;
          const Vec3 p = level.intrinsics.unproject(u, v, depth);
          worst =
              std::max(worst, std::abs((p - scene.planes[0].point).dot(scene.planes[0].normal)));
          const Vec3 n(level.nx.row(v)[u], level.ny.row(v)[u], level.nz.row(v)[u]);
          if (n.norm() < 0.5) continue;
          ASSERT_NEAR(n.norm(), 1, 1e-5);
          worst_normal =
              std::max(worst_normal, std::acos(std::min(1.0, n.dot(scene.planes[0].normal))));
        }
      }
      EXPECT_LT(worst, 0.0015 * s) << "step " << step << " level " << l;
      EXPECT_LT(worst_normal, 0.1) << "step " << step << " level " << l;
    }
  }
}

// Every instruction set of this machine against the plain loops, on widths that leave a remainder.
TEST(Kernels, EveryInstructionSetGivesTheSameBytes) {
  rt::Random random(21);
  const auto weights = bilateral_weights(2, 1.5);
  for (const int width : {101, 96, 17, 5}) {
    const PaddedImage in = random_image(width, 31, random, 0.1);
    std::vector<std::uint16_t> mm(static_cast<std::size_t>(width));
    for (auto& d : mm) d = static_cast<std::uint16_t>(random.uniform(0, 6000));
    std::vector<float> factors(static_cast<std::size_t>(width) + 48, 0.1F);
    for (std::size_t i = 0; i < factors.size(); ++i) factors[i] = 0.01F * static_cast<float>(i);
    const auto run = [&](const icp::Kernels& k) {
      const auto plane = static_cast<std::size_t>(31 * width);
      std::vector<float> out(6 * plane + 64, 0.0F), row(static_cast<std::size_t>(width) + 16);
      // Vector kernels may write zeros beyond the row.
      const auto keep = [&](std::size_t to, int v) {
        std::copy_n(row.begin(), width,
                    out.begin() + static_cast<std::ptrdiff_t>(to * plane) + v * width);
      };
      for (int v = 0; v < 31; ++v) {
        k.bilateral_row(in.row(v), in.stride(), width, weights.data(), 2, kRule, row.data());
        keep(0, v);
        std::vector<float> ny(row.size()), nz(row.size());
        k.normal_row(in.row(v), in.stride(), width, factors.data() + 8, factors.data() + 8, kRule,
                     row.data(), ny.data(), nz.data());
        keep(1, v);
        row.swap(ny);
        keep(2, v);
        row.swap(nz);
        keep(3, v);
        k.half_row(in.row(v), in.stride(), width / 2, kRule, row.data());
        keep(4, v);
        k.to_metres_row(mm.data(), width, 0.3F, 5.0F, row.data());
        keep(5, v);
      }
      return out;
    };
    const auto reference = run(icp::kScalarKernels);
    for (const simd::Isa isa : simd::available()) {
      ASSERT_TRUE(simd::choose(isa));
      const auto out = run(icp::kernels());
      EXPECT_EQ(std::memcmp(out.data(), reference.data(), out.size() * sizeof(float)), 0)
          << simd::name_of(isa) << ", width " << width;
    }
    ASSERT_TRUE(simd::choose("auto"));
  }
}

TEST(Pyramid, EmptyAndOversizedImagesAreHarmless) {
  rt::Startup startup;
  TrackingPyramid pyramid(startup.token(), PreprocessConfig{}, 64, 48);
  std::vector<std::uint16_t> zero(64 * 48, 0), far(64 * 48, 65535);
  for (auto* image : {&zero, &far}) {
    pyramid.build({image->data(), 64, 48, 64}, {60, 60, 31.5, 23.5, 64, 48}, 1);
    EXPECT_EQ(pyramid.mean_depth({0.0015F, 0.004F, 0.8F}), 0);
    EXPECT_EQ(pyramid.level(1).valid, 0);
  }
}

// Two surfaces: their mean is nearer to the one that is believed more.
TEST(Pyramid, MeanDepthIsOfWhatWeighs) {
  rt::Startup startup;
  TrackingPyramid pyramid(startup.token(), PreprocessConfig{}, 64, 48);
  std::vector<std::uint16_t> mm(64 * 48);
  for (std::size_t i = 0; i < mm.size(); ++i) mm[i] = i % 64 < 32 ? 1000 : 3000;
  pyramid.build({mm.data(), 64, 48, 64}, {60, 60, 31.5, 23.5, 64, 48}, 1);
  EXPECT_NEAR(pyramid.mean_depth({0.0015F, 0, 1}), 2.0, 1e-6);
  // Sigma 1 mm at 1 m, 5 mm at 3 m: 25 to 1.
  EXPECT_NEAR(pyramid.mean_depth({0.001F, 0.001F, 1}), (25 * 1.0 + 3.0) / 26, 1e-5);
}

}  // namespace
}  // namespace perception
