#include "perception/tsdf/follow/follow_statistics.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace perception::follow {

namespace {

using Square = Eigen::Matrix<double, 6, 6>;

// Median; of an even number the upper of the two in the middle. (rt::quantile() takes the lower;
// that would change the map.)
double median(std::span<double> v) noexcept {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

}  // namespace

double sigma_m(double z) noexcept { return 1e-3 * std::max(1.2, 1.5 - 0.5 * z + 0.3 * z * z); }

Middle middle_of(std::span<double> v, std::span<double> room) noexcept {
  const double value = median(v);
  for (std::size_t n = 0; n < v.size(); ++n) room[n] = std::abs(v[n] - value);
  return {value, 1.4826 * median(room.first(v.size()))};
}

bool apart_from_standing(std::span<double> offs, std::span<double> room, double noise,
                         std::size_t& count, Middle& moved) noexcept {
  const auto first = offs.begin();
  const auto far = [&](double off) { return std::abs(off) > 3 * noise; };
  count = static_cast<std::size_t>(std::partition(first, offs.end(), far) - first);
  if (count < kFewNodes) return false;
  // Nearer to those than to what stands.
  const double half = 0.5 * middle_of(offs.first(count), room).value;
  const auto nearer = [&](double off) { return half > 0 ? off > half : off < half; };
  count = static_cast<std::size_t>(std::partition(first, offs.end(), nearer) - first);
  const std::span<double> rest = offs.subspan(count);
  if (count < kFewNodes) return false;
  moved = middle_of(offs.first(count), room);
  const auto across = std::count_if(
      rest.begin(), rest.end(), [&](double off) { return half > 0 ? off < -half : off > -half; });
  return moved.scatter <= kAgree * noise + kTilt * std::abs(moved.value) &&
         static_cast<double>(across) <= kAcross * static_cast<double>(count);
}

double standard_error(double count, double sum, double squares, double z_m) noexcept {
  const double mean = sum / count, least = sigma_m(z_m);
  return std::sqrt(std::max(squares / count - mean * mean, least * least) / count);
}

double threshold_m(double error_m) noexcept { return std::max(kLeast_m, kErrors * error_m); }

bool stands_out(const OffsetSums& s, float z_m, double doubt_m) noexcept {
  const auto count = static_cast<double>(s.count), sum = static_cast<double>(s.sum);
  if (count < kFewReadings || std::abs(sum) < kLeast_m * count) return false;
  return std::abs(sum) >=
         count * (doubt_m + threshold_m(standard_error(count, sum, static_cast<double>(s.squares),
                                                       static_cast<double>(z_m))));
}

void fit(std::span<const FollowScratch::Tile> tiles, std::span<double> room,
         CommonMotion& out) noexcept {
  constexpr double kTukey = 4.7, kLeastScatter = 0.1, kDamping = 1e-2;
  constexpr int kRounds = 4;
  std::size_t count = 0, within = 0;
  for (int round = 0;; ++round) {
    count = 0;
    const auto off = [&](const FollowScratch::Tile& t) {
      const Row row = Eigen::Map<const Row>(t.row.data()) / t.count;
      return t.sum / t.count - row.dot(out.twist);
    };
    const auto unit = [](const FollowScratch::Tile& t) {
      return threshold_m(standard_error(t.count, t.sum, t.squares, t.z_m));
    };
    for (const FollowScratch::Tile& t : tiles)
      if (t.count >= 4) room[count++] = std::abs(off(t)) / unit(t);
    if (count < kFewTiles) return;
    out.scatter = std::max(kLeastScatter, 1.4826 * median(room.first(count)));
    if (round == kRounds) break;
    Square A = Square::Zero();
    Row right = Row::Zero();
    within = 0;
    for (const FollowScratch::Tile& t : tiles) {
      if (t.count < 4) continue;
      const double far = std::abs(off(t)) / unit(t) / (kTukey * out.scatter);
      if (far >= 1) continue;
      ++within;
      const Row row = Eigen::Map<const Row>(t.row.data()) / t.count;
      const double w = (1 - far * far) * (1 - far * far) / (unit(t) * unit(t));
      A.noalias() += w * row * row.transpose();
      right.noalias() += w * (t.sum / t.count) * row;
    }
    A.diagonal().array() += kDamping * A.trace() / 6 + 1e-12;
    out.twist = A.ldlt().solve(right);
  }
  out.told = 2 * within > count && out.twist.allFinite();
}

}  // namespace perception::follow
