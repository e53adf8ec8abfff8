#include "perception/motion/consensus.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "perception/motion/cell_loops.hpp"

namespace perception {

namespace {

constexpr double kDamping =
    1e-5;  // of the prior, a pixel, unit motion: far below what a scene constrains
// chosen on: not recorded; judged on: moving 606, moving 707
constexpr float kLeastScale = 0.03F;  // of the limit, of a scale that is estimated
constexpr float kOfMedian = 4;        // the scale: so many times what half of the cells keep
constexpr float kOwnScale = 0.1F;     // of two poses that are compared cell by cell, at least

Mat6 unpack(const double (&upper)[21]) noexcept {
  Mat6 H;
  int s = 0;
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j) H(i, j) = H(j, i) = upper[s++];
  return H;
}

}  // namespace

void Consensus::look(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                     const Vec3& centre_F, double length_m, const ConsensusConfig& config, int rows,
                     bool again) noexcept {
  Gates gates;
  gates.distance_m = 0.2F;
  gates.noise = {config.noise.least_m, 0.0F, config.noise.from_m};  // all pixels alike
  accumulate_cells(live, model, X_FC, centre_F, gates, sums_, rows, !again);
  length_m_ = length_m;
  const auto map = static_cast<float>(config.map_error_m + config.map_error_voxel * config.voxel_m);
  const auto share = static_cast<float>(config.noise_share);
  total_pairs_ = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    const float beyond = std::max(sums_.depth_m[c] - config.noise.from_m, 0.0F);
    const float sigma = share * (config.noise.least_m + config.noise.per_m2 * beyond * beyond);
    limit2_[c] = 4 * (sigma * sigma + map * map);
    if (sums_.pairs[c] < kLeastPairs) continue;
    total_pairs_ += static_cast<double>(sums_.pairs[c]);
  }
}

// Mean square residual over the limit, of every cell.
void Consensus::fit(const Vec6& xi, Cells& misfit) const noexcept {
  float x[6], coefficient[21];
  int s = 0;
  for (int i = 0; i < 6; ++i) x[i] = static_cast<float>(xi(i));
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j) coefficient[s++] = (i == j ? 1.0F : 2.0F) * x[i] * x[j];
  for (float& twice : x) twice *= 2;
  motion::misfit_of(sums_, x, coefficient, limit2_, misfit);
}

// What the cells leave by themselves, of those that may be static: noise and the map's error where
// most of them fit.
float Consensus::scale_of(const Cells& misfit, const Cells& memory) const noexcept {
  Cells kept;
  std::size_t n = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c)
    if (sums_.pairs[c] >= kLeastPairs && memory[c] > 0) kept[n++] = misfit[c];
  if (n == 0) return 1;
  // Of an even number the upper of the two in the middle: rt::quantile() has the lower, and another
  // scale is another map.
  std::nth_element(kept.begin(), kept.begin() + static_cast<std::ptrdiff_t>(n / 2),
                   kept.begin() + static_cast<std::ptrdiff_t>(n));
  return std::clamp(kOfMedian * kept[n / 2], kLeastScale, 1.0F);
}

double Consensus::support(const Cells& misfit, const Cells& weight) const noexcept {
  return motion::supported(sums_, misfit, weight, scale_, kLeastPairs);
}

// Weighted least squares, held to `from` where the cells say nothing.
bool Consensus::solve(const Cells& weight, const Vec6& from, Vec6& xi) const noexcept {
  motion::WeightedSums weighted;
  motion::weigh(sums_, weight, kLeastPairs, weighted);
  const double pairs = weighted.pairs;
  if (!(pairs > 0)) return false;
  Mat6 H = unpack(weighted.H);
  Vec6 b;
  for (int i = 0; i < 6; ++i) b(i) = -weighted.g[i];
  for (int i = 0; i < 6; ++i) {
    const double unit = i < 3 ? 1.0 : length_m_ * length_m_;
    H(i, i) += kDamping * pairs * unit;
    b(i) += kDamping * pairs * unit * from(i);
  }
  const Eigen::LDLT<Mat6> ldlt(H);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  const Vec6 x = ldlt.solve(b);
  if (!x.allFinite()) return false;
  xi = x;
  return true;
}

void Consensus::refine(const Cells& memory, float scale, int rounds, Vec6& xi) const noexcept {
  Cells misfit, weight;
  for (int r = 0; r < rounds; ++r) {
    fit(xi, misfit);
    for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
      const float u = 1 + misfit[c] / scale;
      weight[c] = memory[c] / (u * u);
    }
    if (!solve(weight, Vec6::Zero(), xi)) return;
    scale *= 0.4F;
    if (scale < 1) scale = std::max(scale, scale_of(misfit, memory));
  }
}

bool Consensus::fits(int cell) const noexcept {
  return misfit_[static_cast<std::size_t>(cell)] <= kMisfit * scale_;
}

double Consensus::mean_way(const Vec6& a, const Vec6& b) const noexcept {
  // Rotation at the mean depth: what a point of the scene moves by.
  const Vec6 d = a - b;
  return std::hypot(d.head<3>().norm(), length_m_ * d.tail<3>().norm());
}

double Consensus::support_of(const Vec6& xi) const noexcept {
  Cells misfit;
  fit(xi, misfit);
  return support(misfit, remembered_);
}

double Consensus::share_of_winner(const Vec6& xi) const noexcept {
  const double ours = support(misfit_, remembered_);
  return ours > 0 ? support_of(xi) / ours : 1.0;
}

double Consensus::own_share(const Vec6& xi) const noexcept {
  Cells misfit;
  fit(xi, misfit);
  const float scale = std::max(scale_, kOwnScale);
  double own = 0, all = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    if (sums_.pairs[c] < kLeastPairs) continue;
    const float pixels = remembered_[c] * sums_.pairs[c];
    const float more = 1 / (1 + misfit[c] / scale) - 1 / (1 + misfit_[c] / scale);
    all += static_cast<double>(pixels);
    own += static_cast<double>(pixels * std::max(more, 0.0F));
  }
  return all > 0 ? own / all : 0;
}

double Consensus::reconsider() noexcept {
  fit(Vec6::Zero(), misfit_);
  return support(misfit_, remembered_);
}

bool ConsensusResult::better_than(const ConsensusResult& other) const noexcept {
  const float tighter = std::min(scale, other.scale);
  std::size_t k = 0;
  while (k + 1 < kScales.size() && kScales[k] < tighter) ++k;
  return support_at[k] > other.support_at[k];
}

// What the winner leaves unexplained.
void Consensus::conclude(const Vec6& xi, ConsensusResult& out, float most_scale) noexcept {
  out = ConsensusResult{};
  out.xi = xi;
  fit(xi, misfit_);
  for (std::size_t k = 0; k < ConsensusResult::kScales.size(); ++k) {
    scale_ = ConsensusResult::kScales[k];
    out.support_at[k] = support(misfit_, remembered_);
  }
  out.scale = scale_ = std::min(scale_of(misfit_, remembered_), most_scale);
  out.support = support(misfit_, remembered_);
  out.pairs = total_pairs_;
  double may_be_static = 0, unexplained = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    if (sums_.pairs[c] < kLeastPairs) continue;
    const auto pixels = static_cast<double>(remembered_[c] * sums_.pairs[c]);
    may_be_static += pixels;
    if (!(misfit_[c] > kMisfit * scale_)) continue;
    ++out.misfits;
    unexplained += pixels;
  }
  out.unexplained = may_be_static > 0 ? unexplained / may_be_static : 1;
}

void Consensus::settle(const Cells& remembered, ConsensusResult& out) noexcept {
  remembered_ = remembered;
  Vec6 xi = Vec6::Zero();
  refine(remembered, 6.0F, kRounds, xi);
  conclude(xi, out);
  out.certain = true;
}

void Consensus::stay(const Cells& remembered, ConsensusResult& out) noexcept {
  remembered_ = remembered;
  Vec6 xi = Vec6::Zero();
  refine(remembered, kStay, 1, xi);
  conclude(xi, out);
  out.certain = true;
}

}  // namespace perception
