#include "tools/measure/accuracy/moving_film.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "drivers/camera/render.hpp"

namespace teletact {

using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

namespace {

constexpr double kDisplaced_m = 0.05, kSigmas = 6, kLowest_m = 0.03;
constexpr int kRest = 20, kFreed = 20;  // frames

double lowest_of(const drivers::Shape& s, const Pose& X_WS) {
  switch (s.kind) {
    case drivers::Shape::Kind::kSphere:
      return X_WS.translation().z() - s.half.x();
    case drivers::Shape::Kind::kCylinder:
      return X_WS.translation().z() - s.half.z();
    default:
      return X_WS.translation().z() - X_WS.linear().row(2).cwiseAbs().dot(s.half);
  }
}

double farthest_corner(const Pose& A, const Pose& B, const Vec3& half) {
  double most = 0;
  for (int i = 0; i < 8; ++i) {
    const Vec3 p((i & 1) != 0 ? half.x() : -half.x(), (i & 2) != 0 ? half.y() : -half.y(),
                 (i & 4) != 0 ? half.z() : -half.z());
    most = std::max(most, (A * p - B * p).norm());
  }
  return most;
}

class Camera {
 public:
  Camera(rt::NonRealtime& nrt, const MovingSample& sample, const drivers::World& world, bool colour,
         double incidence)
      : sample_(sample),
        world_(world),
        noise_(nrt, noise_of(incidence)),
        scratch_(nrt, world.shapes().size()),
        image_(std::make_unique<RgbdFrame>()) {
    scratch_.colour = colour;
    scratch_.shape.resize(RgbdFrame::kMaxPixels);
  }
  const RgbdFrame& expose(int frame, FusionSequence& out) {
    const Pose X_WC = sample_.way.X_WC(frame * MovingSample::kFrame_s);
    const rt::Time t = MovingSample::time_of(frame);
    drivers::render(world_, sample_.camera(), X_WC, {kMovingNear_m, kMovingFar_m}, noise_,
                    rt::mix64(sample_.seed, static_cast<std::uint64_t>(sample_.index)),
                    static_cast<std::uint64_t>(frame), scratch_, *image_, t);
    image_->exposure = t;
    out.append(*image_);
    out.truth_WC.emplace_back(X_WC);
    return *image_;
  }
  [[nodiscard]] int shape(std::size_t pixel) const { return scratch_.shape[pixel]; }

 private:
  static drivers::DepthNoiseConfig noise_of(double incidence) {
    drivers::DepthNoiseConfig noise = moving_noise();
    noise.incidence = incidence;
    return noise;
  }
  const MovingSample& sample_;
  const drivers::World& world_;
  drivers::DepthNoise noise_;
  drivers::RenderScratch scratch_;
  std::unique_ptr<RgbdFrame> image_;
};

}  // namespace

MoverTruth::MoverTruth(const drivers::World& world, const MovingSample& sample) : sample_(sample) {
  std::vector<int> movers;
  for (const auto& s : world.shapes()) {
    slot_.push_back(s.mover >= 0 ? movers_++ : -1);
    if (s.mover >= 0) movers.push_back(static_cast<int>(slot_.size()) - 1);
  }
  const int rested = sample.first_moving - 1;
  std::vector<double> most(movers.size(), -1);
  std::vector<int> at(movers.size(), 0);
  for (int f = 0; f < sample.frames; ++f) {
    const rt::Time t = MovingSample::time_of(f);
    for (std::size_t m = 0; m < movers.size(); ++m) {
      const auto& s = world.shapes()[static_cast<std::size_t>(movers[m])];
      const Pose X_WS = world.X_WS_at(movers[m], t);
      const Pose X_rested = world.X_WS_at(movers[m], MovingSample::time_of(rested));
      const double by = farthest_corner(X_WS, X_rested, s.half);
      if (by > most[m]) most[m] = by, at[m] = f;
      posed_.push_back({X_WS, at[m], lowest_of(s, X_WS)});
    }
  }
  // The lowest of all that moves together.
  for (int f = 0; f < sample.frames; ++f) {
    double low = std::numeric_limits<double>::infinity();
    const auto first = static_cast<std::size_t>(f * movers_);
    for (std::size_t m = 0; m < movers.size(); ++m) low = std::min(low, posed_[first + m].lowest_m);
    for (std::size_t m = 0; m < movers.size(); ++m) posed_[first + m].lowest_m = low;
  }
}

const MoverTruth::Posed& MoverTruth::at(int shape, int frame) const {
  return posed_[static_cast<std::size_t>(frame * movers_ + slot_[static_cast<std::size_t>(shape)])];
}

int MoverTruth::still_for(int frame) const {
  if (frame < sample_.first_moving) return sample_.from_rest ? kRest + kFreed + frame : 0;
  return std::max(0, frame - sample_.last_moving);
}

PixelTruth MoverTruth::of(const Vec3& p_W, double depth_m, int shape, int frame) const {
  if (shape < 0 || slot_[static_cast<std::size_t>(shape)] < 0) return PixelTruth::kStill;
  const int still = still_for(frame);
  if (still >= kRest + kFreed) return PixelTruth::kStill;
  if (still >= kRest) return PixelTruth::kEither;
  const Posed& now = at(shape, frame);
  if (p_W.z() < now.lowest_m + kLowest_m) return PixelTruth::kEither;
  if (sample_.door_width_m > 0 &&
      (p_W - sample_.hinge_W).head<2>().norm() < sample_.door_width_m / 3) {
    return PixelTruth::kEither;
  }
  const Vec3 p_S = now.X_WS.inverse(Eigen::Isometry) * p_W;
  const Vec3 by = at(shape, now.farthest).X_WS * p_S -
                  at(shape, std::max(0, sample_.first_moving - 1)).X_WS * p_S;
  const double least = std::max(kDisplaced_m, kSigmas * drivers::kinect_v2_sigma_m(depth_m));
  return by.norm() >= least ? PixelTruth::kMoving : PixelTruth::kEither;
}

MovingFilm film_moving(rt::NonRealtime& nrt, const MovingSample& sample, bool colour,
                       double incidence) {
  const drivers::World world(nrt, sample.world, MovingSample::kBegin);
  const drivers::World plain(nrt, sample.plain, MovingSample::kBegin);
  const MoverTruth truth(world, sample);
  MovingFilm film;
  film.with.name = "moving", film.plain.name = "plain";
  Camera camera(nrt, sample, world, colour, incidence),
      other(nrt, sample, plain, colour, incidence);
  const auto k = sample.camera();
  const auto pixels = static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height);
  for (int f = 0; f < sample.frames; ++f) {
    other.expose(f, film.plain);
    const RgbdFrame& image = camera.expose(f, film.with);
    const Pose& X_WC = *film.with.truth(f);
    std::vector<std::uint8_t> of(pixels, static_cast<std::uint8_t>(PixelTruth::kEither));
    int valid = 0, mover = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (image.depth_mm[i] == 0) continue;
      ++valid;
      const int shape = camera.shape(i);
      if (shape < 0 || world.shapes()[static_cast<std::size_t>(shape)].mover < 0) {
        of[i] = static_cast<std::uint8_t>(PixelTruth::kStill);
        continue;
      }
      ++mover;
      const double z = 1e-3 * image.depth_mm[i];
      const auto u = static_cast<double>(i % static_cast<std::size_t>(k.width));
      const std::size_t row = i / static_cast<std::size_t>(k.width);
      const auto v = static_cast<double>(row);
      const PixelTruth t = truth.of(X_WC * k.unproject(u, v, z), z, shape, f);
      of[i] = static_cast<std::uint8_t>(static_cast<std::uint8_t>(t) | kMoverBit);
    }
    film.truth.push_back(std::move(of));
    film.share.push_back(valid > 0 ? static_cast<double>(mover) / valid : 0);
    film.share_most = std::max(film.share_most, film.share.back());
  }
  return film;
}

}  // namespace teletact
