// What moves while it is looked at (creeps, rises, settles, comes to rest) is followed, block by block; what stands keeps the
// noise of a hundred readings. And what went away before a background that gives no reading is forgotten.
//
// A block's readings near its surface are on average `mean` off what it knows (voxel_update.hpp sums them): the map's lag
// itself, so it adds up what a creeping surface does from frame to frame, as a CUSUM does, and one threshold will do:
// kLeast_m, or four standard errors of the mean where that is more. Beyond it in two frames running, or twice beyond it in one, the block
// has moved: where its innovations agree it is moved with its surface (the mean is taken over, its weights fall to kMoved);
// where they do not, some of it moved and its weights fall to kMixed.
//
// A pose error is an innovation too, of many blocks by one small motion: that twist is fitted robustly to the innovations (a
// point-to-plane fit, rows from the field's own slope), and only what stands out of the rest counts, by four times the
// scatter that the frame's blocks have themselves. Less than kFewest blocks, or no majority that agrees: nothing is learned.
//
// Chosen on the floor of case 13 (tools/stability) and a plane in tests/unit/perception_tsdf at 1 m; reported on the rooms of
// `teletact accuracy fusion` and the fused cases 1, 2, 5, 6, 7, 10.
#include <algorithm>
#include <array>
#include <cmath>

#include "perception/tsdf/band_kernel.hpp"
#include "perception/tsdf/frame_view.hpp"
#include "perception/tsdf/voxel_update.hpp"

namespace perception {
namespace {

constexpr double kLeast_m = 0.8e-3, kErrors = 4, kScatter = 4;
constexpr int kFewCompared = 24;  // voxels: a block that the surface hardly touches says nothing
constexpr int kFewest = 20, kMostFitted = 512, kFitted = 160;
constexpr std::uint32_t kMoved = 8 * TsdfMap::kWeightOne, kMixed = 3 * TsdfMap::kWeightOne;
constexpr int kAtTheEnd = 32700;  // |d|: a bound, not a distance

// Of a Kinect v2's reading along the axis.
double sigma_m(double z) noexcept { return 1e-3 * std::max(1.2, 1.5 - 0.5 * z + 0.3 * z * z); }

using Row = Eigen::Matrix<double, 6, 1>;
using Normal = Eigen::Matrix<double, 6, 6>;

struct Fitted {
  std::uint64_t key;
  Vec3 slope, at;  // of the field; the block's middle
  double off, unit;
};

// The small motion that most of the blocks agree on, and their scatter about it, in units of each one's own threshold.
struct Common {
  Row twist = Row::Zero();
  Vec3 about = Vec3::Zero();
  double radius = 1, scatter = 0;
  bool told = false;
  [[nodiscard]] Row row(const Vec3& slope, const Vec3& at) const noexcept {
    Row out;
    out << slope, (at - about).cross(slope) / radius;
    return out;
  }
};

double median(std::span<double> v) noexcept {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

// Tukey's weights from the plain start: what moves does not pull as long as it is the minority. Where the blocks are as near
// to no motion at all as their noise allows, there is none: directions that they do not constrain would take it up.
Common common_motion(std::span<const Fitted> blocks) noexcept {
  constexpr double kTukey = 4.7, kLeastScatter = 0.2, kNoMotion = 0.4, kDamping = 1e-2;
  constexpr int kRounds = 4;
  Common out;
  const std::size_t count = blocks.size();
  if (count < static_cast<std::size_t>(kFewest)) return out;
  for (const Fitted& b : blocks) out.about += b.at / static_cast<double>(count);
  double spread = 0;
  for (const Fitted& b : blocks)
    spread += (b.at - out.about).norm() / static_cast<double>(count);
  out.radius = std::max(spread, 0.05);
  std::array<double, kMostFitted> size{};
  std::size_t within = 0;
  for (int round = 0;; ++round) {
    for (std::size_t i = 0; i < count; ++i) {
      const Fitted& b = blocks[i];
      size[i] = std::abs(b.off - out.row(b.slope, b.at).dot(out.twist)) / b.unit;
    }
    std::array<double, kMostFitted> sorted = size;
    out.scatter = std::max(kLeastScatter, 1.4826 * median({sorted.data(), count}));
    if (round == 0 && out.scatter <= kNoMotion) {
      out.told = true;
      return out;
    }
    if (round == kRounds) break;
    Normal A = Normal::Zero();
    Row right = Row::Zero();
    within = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const double far = size[i] / (kTukey * out.scatter);
      if (far >= 1) continue;
      ++within;
      const Fitted& b = blocks[i];
      const double w = (1 - far * far) * (1 - far * far) / (b.unit * b.unit);
      const Row row = out.row(b.slope, b.at);
      A.noalias() += w * row * row.transpose();
      right.noalias() += w * b.off * row;
    }
    A.diagonal().array() += kDamping * A.trace() / 6 + 1e-12;
    out.twist = A.ldlt().solve(right);
  }
  out.told = 2 * within > count && out.twist.allFinite();
  return out;
}

}  // namespace

// Of the block's field where it is known well, towards where it is seen from; false: nowhere.
bool TsdfMap::slope_of(std::int32_t block, bool anywhere, Vec3& out) const noexcept {
  const std::uint32_t* words = block_words(block);
  const auto sure = [words](int n) {
    return word_weight(words[n]) >= kObservedWeight && std::abs(word_distance(words[n])) <= kSureUnits;
  };
  static constexpr int kFrom[7] = {3, 1, 5, 0, 6, 2, 4};
  const std::span<const int> from(kFrom, anywhere ? 7 : 3);
  for (const int x : from)
    for (const int y : from)
      for (const int z : from) {
        const int n = in_block(x, y, z);
        if (!sure(n) || !sure(n + 64) || !sure(n + 8) || !sure(n + 1)) continue;
        const int d = word_distance(words[n]);
        const double unit = static_cast<double>(metres_per_unit_) / voxel_;
        out = unit * Vec3(word_distance(words[n + 64]) - d, word_distance(words[n + 8]) - d,
                          word_distance(words[n + 1]) - d);
        return true;
      }
  return false;
}

void TsdfMap::move_block(std::int32_t block, double by_m, std::uint32_t weight_most) noexcept {
  std::uint32_t* words = words_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  const double units = by_m / static_cast<double>(metres_per_unit_);
  for (int n = 0; n < kBlockVoxels; ++n) {
    const int d = word_distance(words[n]), w = word_weight(words[n]);
    if (w == 0 || std::abs(d) >= kAtTheEnd) continue;
    // This frame's reading is in it already.
    const double part = std::max(w - kWeightOne, 0) / static_cast<double>(w);
    const int moved = std::clamp(d + static_cast<int>(std::lround(part * units)), -kDistanceOne,
                                 kDistanceOne);
    words[n] = make_word(moved, std::min(w, static_cast<int>(weight_most)));
  }
  changed_[static_cast<std::size_t>(block)] = revision_;
}

void TsdfMap::learn_changes(const View& view, IntegrateStats& stats) noexcept {
  if (!config_.follow_changes) return;
  const double unit = static_cast<double>(metres_per_unit_);
  const auto compared = [this](int n) {
    return innovations_[static_cast<std::size_t>(n)].compared >= kFewCompared;
  };
  int usable = 0;
  for (int n = 0; n < in_view_count_; ++n) usable += compared(n) ? 1 : 0;
  if (usable < kFewest) return;
  const auto middle = [&](int n) {
    const BlockCoord c = coords_[static_cast<std::size_t>(in_view_[static_cast<std::size_t>(n)].block)];
    return Vec3(voxel_ * Vec3(8 * c.x + 3.5, 8 * c.y + 3.5, 8 * c.z + 3.5));
  };
  const Vec3 axis = view.X_WC.linear().col(2), eye = view.X_WC.translation();
  const double pixels_wide = 8 * voxel_ * view.frame.intrinsics.fx;
  // Mean innovation and what of it is noise at most, m.
  struct Off {
    double mean, threshold, sigma, z;
  };
  const auto off_of = [&](int n, const Vec3& at) {
    const Innovation& i = innovations_[static_cast<std::size_t>(n)];
    const double z = std::max(0.1, axis.dot(at - eye)), sigma = sigma_m(z);
    const double across = pixels_wide / z;
    const double free = std::min(i.compared / 3.0, across * across);
    return Off{unit * i.off / i.compared, std::max(kLeast_m, kErrors * sigma / std::sqrt(free)),
               sigma, z};
  };
  // Some of them, chosen and summed by place alone: block numbers differ with what was put away.
  std::array<Fitted, kMostFitted> fitted;
  int count = 0;
  const auto one_in = static_cast<std::uint64_t>((usable + kFitted - 1) / kFitted);
  for (int n = 0; n < in_view_count_ && count < kMostFitted; ++n) {
    if (!compared(n)) continue;
    const std::int32_t block = in_view_[static_cast<std::size_t>(n)].block;
    const BlockCoord c = coords_[static_cast<std::size_t>(block)];
    Fitted& f = fitted[static_cast<std::size_t>(count)];
    f.key = block_key(c.x, c.y, c.z);
    if ((f.key * 0x9e3779b97f4a7c15ULL >> 32U) % one_in != 0 || !slope_of(block, false, f.slope))
      continue;
    f.at = middle(n);
    const Off off = off_of(n, f.at);
    f.off = off.mean, f.unit = off.threshold;
    ++count;
  }
  std::sort(fitted.begin(), fitted.begin() + count,
            [](const Fitted& a, const Fitted& b) { return a.key < b.key; });
  const Common common = common_motion({fitted.data(), static_cast<std::size_t>(count)});
  if (!common.told) return;
  const double least = std::max(1.0, kScatter * common.scatter);
  const bool still = common.twist.isZero();
  for (int n = 0; n < in_view_count_; ++n) {
    if (!compared(n)) continue;
    const Innovation& i = innovations_[static_cast<std::size_t>(n)];
    if (still && std::abs(unit * i.off) < least * kLeast_m * i.compared) continue;
    const std::int32_t block = in_view_[static_cast<std::size_t>(n)].block;
    const Vec3 at = middle(n);
    const Off off = off_of(n, at);
    Vec3 slope;
    const bool sloped = slope_of(block, true, slope);
    if (!sloped && !still) continue;
    const double rest = still ? off.mean : off.mean - common.row(slope, at).dot(common.twist);
    const double times = std::abs(rest) / (least * off.threshold);
    if (times < 1) continue;
    std::uint32_t& last = stood_out_[static_cast<std::size_t>(block)];
    const std::uint32_t sign = rest > 0 ? 1 : 0, before = 2 * (frame_ - 1) + sign;
    const bool again = last == before;
    last = 2 * frame_ + sign;
    if (times < 2 && !again) continue;
    // Noise that one reading has along its ray, at a slant more; and a surface that tilts as it moves.
    const double across = sloped ? std::max(0.0, slope.squaredNorm() - 1) : 0;
    const double lateral = 0.4 * off.z / view.frame.intrinsics.fx;
    const double noise2 = off.sigma * off.sigma + lateral * lateral * across + 1e-7;
    const double scatter2 =
        unit * unit * (std::ldexp(static_cast<double>(i.off2), 2 * kOffShift) / i.compared) -
        off.mean * off.mean;
    const bool agree = scatter2 <= 2.5 * noise2 + 0.1 * rest * rest;
    move_block(block, agree ? rest : 0, agree ? kMoved : kMixed);
    ++stats.blocks_moved;
  }
}

// A block in which much is seen through and nothing is seen: what stood there left. What of it is still known and has
// no reading now (nothing behind that can be measured) is not seen through either; it fades, unknown after two turns. Where
// nothing is seen to go, what gives no reading stays: a dark thing, or one behind the mask of something that moves.
void TsdfMap::forget_unread(const UpdateCamera& cam, const std::array<float, 3>& p0,
                            std::int32_t block) noexcept {
  constexpr std::uint32_t kKeep = 64, kForgotten = kWeightOne;  // a quarter a turn; one reading
  const auto base = static_cast<std::size_t>(block) * kBlockVoxels;
  bool gone = false;
  for (std::size_t n = 0; n < kBlockVoxels; ++n) {
    std::uint32_t& word = words_[base + n];
    if (word_weight(word) == 0 || word_distance(word) >= kFreeUnits) continue;
    const float x = p0[0] + cam.node[0][n], y = p0[1] + cam.node[1][n], z = p0[2] + cam.node[2][n];
    if (!(z >= CameraBoxes::kLeastZ)) continue;
    const float u = x / z * cam.fx + cam.cx_half, v = y / z * cam.fy + cam.cy_half;
    if (!(u >= 0 && v >= 0 && u < static_cast<float>(cam.width) &&
          v < static_cast<float>(cam.height)))
      continue;
    if (cam.pixels[static_cast<int>(v) * cam.width + static_cast<int>(u)] != 0) continue;
    const std::uint32_t w = (std::min<std::uint32_t>(word_weight(word), kGoing) * kKeep) >> 8U;
    if (w >= kForgotten) {
      word = make_word(word_distance(word), static_cast<int>(w));
    } else {
      word = 0;
      colours_[base + n] = 0;
    }
    gone = true;
  }
  if (gone) changed_[static_cast<std::size_t>(block)] = revision_;
}

}  // namespace perception
