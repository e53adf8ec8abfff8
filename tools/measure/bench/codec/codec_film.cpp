#include "tools/measure/bench/codec/codec_film.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "drivers/camera/render.hpp"
#include "rt/random.hpp"

namespace teletact {

using drivers::DepthNoiseLaw;
using perception::RgbdFrame;

namespace {

SyntheticRoom room_of(const CodecFilmOptions& o) {
  SyntheticRoom room = furnished_room();
  rt::Random random(o.seed, 71);
  for (auto& box : room.world.boxes) {
    box.yaw_deg += 8 * (random.uniform() - 0.5);
    for (double& c : box.paint.colour)
      c = std::clamp(c + 60 * (random.uniform() - 0.5), 0.0, 255.0);
  }
  if (o.arm) {
    auto& arm = room.world.boxes.emplace_back();
    arm.name = "arm";
    arm.size_m = {0.08, 0.08, 0.7};
    arm.position_m = {1.5, 0.1, 0.95};
    auto& swing = room.world.movers.emplace_back();
    swing.name = "swing", swing.shapes = "arm", swing.kind = "swing";
    swing.amplitude_m = {0.05, 0.25, 0};
    swing.period_s = 3;
  }
  room.noise.axial = 0;  // put on here, where its law is chosen
  room.noise.lateral_px = o.lateral_px;
  return room;
}

std::uint8_t shaken(std::uint8_t c, double by) {
  return static_cast<std::uint8_t>(std::clamp(static_cast<int>(std::lround(c + by)), 1, 255));
}

}  // namespace

void mark_inner(const std::uint16_t* mm, int width, int height, std::uint8_t* inner) {
  std::fill_n(inner, static_cast<std::ptrdiff_t>(width) * height, std::uint8_t{1});
  const auto at = [&](int u, int v) { return mm[v * width + u]; };
  const auto bends = [](int a, int b, int c) {
    if (a == 0 || b == 0 || c == 0) return true;
    return std::abs(1.0 / a - 2.0 / b + 1.0 / c) * b > 0.5 * drivers::DepthNoise::kEdgeStep;
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const bool rim = u < 1 || v < 1 || u >= width - 1 || v >= height - 1;
      const bool edge = rim || bends(at(u - 1, v), at(u, v), at(u + 1, v)) ||
                        bends(at(u, v - 1), at(u, v), at(u, v + 1));
      for (int b = std::max(0, v - 2); edge && b <= std::min(height - 1, v + 2); ++b)
        for (int a = std::max(0, u - 2); a <= std::min(width - 1, u + 2); ++a)
          inner[b * width + a] = 0;
    }
  }
}

double noise_mm(DepthNoiseLaw law, double z_m) noexcept {
  return law == DepthNoiseLaw::kStrict ? 1e3 * drivers::kinect_v2_sigma_m(z_m)
                                       : 1.5 + 2 * z_m * z_m;
}

CodecFilm film_codec(rt::NonRealtime& nrt, const CodecFilmOptions& o) {
  const SyntheticRoom room = room_of(o);
  const drivers::World world(nrt, room.world);
  const drivers::DepthNoise edges(nrt, room.noise), none(nrt, {});
  const drivers::NormalTable normal;
  drivers::RenderScratch scratch(nrt, world.shapes().size());
  CodecFilm film;
  film.world = room.world;
  auto frame = std::make_unique<RgbdFrame>(), truth = std::make_unique<RgbdFrame>();
  const auto pixels = static_cast<std::size_t>(room.camera.width * room.camera.height);
  rt::Random random(o.seed, 72);
  for (int i = 0; i < o.frames; ++i) {
    const double t_s = 2.0 * static_cast<double>(o.seed) + (o.moving ? i / 30.0 : 0.0);
    const perception::Pose X_WC = carried_pose(t_s);
    const rt::Time t = rt::Time{} + rt::Nanos{i * 33'333'333LL};
    const drivers::DepthRange range{room.range_min_m, room.range_max_m};
    const auto seq = static_cast<std::uint64_t>(i);
    drivers::render(world, room.camera, X_WC, range, none, o.seed, seq, scratch, *truth, t);
    drivers::render(world, room.camera, X_WC, range, edges, o.seed, seq, scratch, *frame, t);
    for (std::size_t n = 0; n < pixels; ++n) {
      const double mm = frame->depth_mm[n];
      const auto word = random();
      if (mm > 0) {
        const double noisy = mm + noise_mm(o.noise, 1e-3 * mm) *
                                      static_cast<double>(normal(static_cast<std::uint32_t>(word)));
        frame->depth_mm[n] = static_cast<std::uint16_t>(std::clamp(std::lround(noisy), 1L, 65534L));
      }
      const double by = 3 * static_cast<double>(normal(static_cast<std::uint32_t>(word >> 32U)));
      perception::Rgb& c = frame->colour[n];
      if ((c.r | c.g | c.b) != 0) c = {shaken(c.r, by), shaken(c.g, by), shaken(c.b, by)};
    }
    frame->exposure = rt::Time{} + rt::Nanos{1'000'000'000LL + i * 33'333'333LL};
    film.sensor.append(*frame);
    film.sensor.truth_WC.emplace_back(X_WC);
    film.truth_mm.insert(film.truth_mm.end(), truth->depth_mm.begin(),
                         truth->depth_mm.begin() + static_cast<std::ptrdiff_t>(pixels));
    film.inner.resize(film.inner.size() + pixels);
    mark_inner(truth->depth_mm.data(), room.camera.width, room.camera.height,
               film.inner.data() + film.inner.size() - pixels);
  }
  film.sensor.name = o.moving ? "moving" : "at rest";
  return film;
}

}  // namespace teletact
