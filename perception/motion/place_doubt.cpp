#include "perception/motion/place_doubt.hpp"

#include <algorithm>

namespace perception::motion {

namespace {

// chosen on: moving 101, moving 404 (movers from the first frame on, share >= .12), moving 1 (9), moving 505 (ten at level 2), recording; judged on: moving 606
// Of the image: where the map should show something and shows nothing, beyond what it did when
// there was least of that; what does not fit, and lies behind what does.
constexpr double kHoles = 0.04, kOfLeastHoles = 1.5, kUnfit = 0.10;
constexpr int kDoubtFrames = 10;  // without, and it may be claimed again
constexpr int kSoon = 2;          // frames, at most, to the second one that proves it

}  // namespace

FitShares fit_shares(const MapView& map, const DepthLevel& live, const Pose& X_WC,
                     const WatchedImage& image, const Consensus& consensus,
                     const MotionEvidence& evidence,
                     const std::vector<std::uint8_t>& mask) noexcept {
  const CellSums& sums = consensus.sums();
  const Pose X_FC = evidence.X_FW() * X_WC;
  MapReader reader(map, 1.0);
  FitShares s;
  // An eighth of the pixels is enough for shares of some hundredths.
  for (int v = 0; v < image.height; v += 2)
    for (int u = v & 2; u < image.width; u += 4) {
      const float z = live.depth.row(v)[u];
      if (!(z > 0)) continue;
      const int i = v * image.width + u;
      const auto c = static_cast<std::size_t>(image.cell_of(u, v));
      const bool met = sums.pairs[c] >= 0.5F * sums.live[c],
                 misses = sums.pairs[c] >= Consensus::kLeastPairs &&
                          !consensus.fits_noise(static_cast<int>(c)),
                 masked = mask[static_cast<std::size_t>(i)] != 0;
      const std::size_t k = masked || !met || misses ? 1 : 0;
      s.pixels[k] += 1, s.depth_m[k] += static_cast<double>(z);
      if (!met && !masked && evidence.shows_nothing(reader, X_FC, image.point_C(live, i)))
        s.nowhere += 1;
    }
  return s;
}

bool PlaceDoubt::doubts(const FitShares& s, int known, double masked_share) noexcept {
  const double all = std::max(s.pixels[0] + s.pixels[1], 1.0), share = s.nowhere / all;
  // Where a thing has been seen to move, it is known what moves.
  const bool grows = known > 1 && masked_share < kUnfit &&
                     share >= kHoles + kOfLeastHoles * std::max(least_holes_, own_holes_),
             behind = s.depth_m[1] * s.pixels[0] >= s.depth_m[0] * s.pixels[1];
  least_holes_ = known > 1 ? std::min(least_holes_, share) : share;
  const bool unfit = behind && s.pixels[1] >= kUnfit * all, again = grown_ago_ <= kSoon;
  // Holes that are gone in the next image are the map's own: far surfaces at a coarse level (what
  // misses them is dropped, and so not cast the next time), a room that a door opens.
  if (grown_ago_ == 1 && !sure_ && share < kHoles / 2) own_holes_ = std::max(own_holes_, holes_);
  holes_ = share;
  sure_ = (sure_ && in_doubt_ > 0) || (unfit && grows && again);
  grown_ago_ = unfit && grows ? 1 : std::min(grown_ago_ + 1, kSoon + 1);
  in_doubt_ = unfit && sure_ ? kDoubtFrames : std::max(0, in_doubt_ - 1);
  return in_doubt_ > 0;
}

}  // namespace perception::motion
