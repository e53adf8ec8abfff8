// Noise that grows with the angle between ray and surface.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "drivers/camera/depth_noise.hpp"
#include "drivers/camera/render.hpp"
#include "drivers/world/world.hpp"
#include "rt/memory/non_realtime.hpp"

namespace {

rt::Startup startup;

// The law of Fankhauser et al. 2015, beyond 80 degrees as at 80.
double tilted_sigma_mm(double z, double angle_deg) {
  const double t = std::min(angle_deg, 80.0) * std::numbers::pi / 180;
  const double root = t / (std::numbers::pi / 2 - t);
  return 1000 * drivers::kinect_v2_sigma_m(z) + 0.1 * std::pow(z, 1.5) * root * root;
}

TEST(Noise, TheIncidenceTableIsTheLawWithin1Percent) {
  const drivers::IncidenceTable table;
  for (double deg = 0; deg <= 90; deg += 0.5) {
    const double t = std::min(deg, 80.0) * std::numbers::pi / 180;
    const double root = t / (std::numbers::pi / 2 - t);
    const auto cosine = static_cast<float>(std::cos(deg * std::numbers::pi / 180));
    EXPECT_NEAR(static_cast<double>(table(cosine)), root * root, 0.01 * root * root + 1e-3) << deg;
  }
}

// A wall that fills the view of a narrow lens, seen at an angle: std of the reading against the
// model, at the image's middle.
TEST(Noise, AxialSigmaGrowsWithTheAngleOfIncidence) {
  const auto frame = std::make_unique<perception::RgbdFrame>();
  for (const bool jitter : {false, true}) {
    const drivers::DepthNoise noise(startup.token(), {1.0, jitter ? 0.3 : 0.0, 0, 0, 1.0});
    for (const double deg : {0.0, 30.0, 50.0, 70.0, 78.0}) {
      const double t = deg * std::numbers::pi / 180, z = 2;
      drivers::WorldConfig c;
      auto& p = c.planes.emplace_back();
      p.name = "wall", p.point_m = {0, 0, z}, p.normal = {std::sin(t), 0, -std::cos(t)};
      const drivers::World world(startup.token(), c);
      drivers::RenderScratch scratch(startup.token(), world.shapes().size());
      const perception::Intrinsics k{4000, 4000, 49.5, 49.5, 100, 100};
      double square = 0;
      int n = 0;
      for (std::uint64_t seq = 0; seq < 10; ++seq) {
        drivers::render(world, k, perception::Pose::Identity(), {}, noise, 42, seq, scratch,
                        *frame);
        for (int v = 2; v < 98; ++v)
          for (int u = 40; u < 60; ++u, ++n) {
            const double x = (u - 49.5) / 4000;
            const double e = frame->depth().at(u, v) - 1000 * z / (1 - x * std::tan(t));
            square += e * e;
          }
      }
      const double sigma = std::sqrt(square / n - 1.0 / 12), law = tilted_sigma_mm(z, deg);
      // A ray that goes beside its pixel meets the slope elsewhere, and sees a slope that is off.
      const double beside = jitter ? 300.0 * z / 4000 * std::tan(t) : 0;
      EXPECT_NEAR(sigma / std::hypot(law, beside), 1, jitter ? 0.15 : 0.05) << deg;
    }
  }
}

}  // namespace
