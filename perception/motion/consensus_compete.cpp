// Hypotheses, and which of them is the camera's (consensus.hpp).
#include <algorithm>
#include <cmath>

#include "perception/motion/consensus.hpp"
#include "rt/random.hpp"

namespace perception {

namespace {

constexpr int kHandful = 6;  // cells of a random hypothesis
// chosen on: moving 51 (3, 22), moving 7 (6), moving 53 (5), recording backwards; judged on: moving 606, moving 707
// A leap, far beyond what the prior may err by, counts with this share of the pixels that it
// explains.
constexpr double kUnlikely = 0.25;
// chosen on: not recorded; judged on: moving 606, moving 707
constexpr double kOutvoted = 0.97;
constexpr double kLeastRest = 0.05;  // of the pixels: less can not rival the winner
// Of a cell: by less than this two poses that fit it differ by noise alone, in either's favour.
constexpr float kByNoise = 0.1F;

}  // namespace

double Consensus::likely(double way_m, double sigma_m) noexcept {
  const double ways = way_m / sigma_m;
  return kUnlikely + (1 - kUnlikely) / (1 + ways * ways);
}

double Consensus::likely(const Contest& c, const Vec6& xi) const noexcept {
  return likely(mean_way(xi, c.prior), c.prior_sigma_m);
}

// Least squares over `part` from nothing, then refined over what may be static.
void Consensus::add_of_part(Contest& contest, const Cells& part, float scale) const noexcept {
  Vec6 xi;
  if (solve(part, Vec6::Zero(), xi)) add_from(contest, xi, scale);
}

void Consensus::add_from(Contest& contest, Vec6 xi, float scale) const noexcept {
  refine(remembered_, scale, kRounds, xi);
  contest.pose[static_cast<std::size_t>(contest.count++)] = xi;
}

void Consensus::propose(Contest& contest, const Vec6& still, std::uint64_t seed) const noexcept {
  Cells part;
  add_from(contest, Vec6::Zero(), 1.0F);
  add_from(contest, still, 1.0F);
  add_from(contest, contest.prior, 1.0F);
  add_from(contest, contest.prior, kStay);
  part.fill(1);
  add_of_part(contest, part, 36.0F);
  add_of_part(contest, remembered_, 6.0F);
  const int columns = sums_.columns, rows = sums_.rows;
  for (int quarter = 0; quarter < 8; ++quarter) {  // four quarters, then what is left without each
    part.fill(0);
    for (int c = 0; c < sums_.size(); ++c) {
      const bool in = (c % columns >= columns / 2) == ((quarter & 1) != 0) &&
                      (c / columns >= rows / 2) == ((quarter & 2) != 0);
      part[static_cast<std::size_t>(c)] = in == (quarter < 4) ? 1.0F : 0.0F;
    }
    add_of_part(contest, part, 6.0F);
  }
  rt::Random rng(seed, 77);
  for (int n = 0; n < Contest::kHandfuls; ++n) {
    part.fill(0);
    for (int k = 0, tries = 0; k < kHandful && tries < 64; ++tries) {
      const auto c = static_cast<std::size_t>(rng() % static_cast<std::uint64_t>(sums_.size()));
      if (sums_.pairs[c] < 2 * kLeastPairs || part[c] > 0) continue;
      part[c] = 1;
      ++k;
    }
    add_of_part(contest, part, 6.0F);
  }
  Cells misfit;
  for (int i = 0; i < contest.count; ++i) {
    fit(contest.pose[static_cast<std::size_t>(i)], misfit);
    contest.tightest = std::min(contest.tightest, scale_of(misfit, remembered_));
  }
}

// Most support, of what may be static, by what the tightest of them leaves to half of the cells: by
// the noise model's limit a far wall follows whatever is near. A leap needs more of it.
void Consensus::choose(Contest& contest) noexcept {
  Cells misfit;
  double most = -1;
  contest.most_support = 0;
  scale_ = contest.tightest;
  for (int i = 0; i < contest.count; ++i) {
    const Vec6& xi = contest.pose[static_cast<std::size_t>(i)];
    fit(xi, misfit);
    const double supported = support(misfit, remembered_);
    contest.most_support = std::max(contest.most_support, supported);
    const double s = supported * likely(contest, xi);
    if (s > most) most = s, contest.best = i;
  }
}

// What is left without the winner, by itself: less than half of the cells never sets the scale in
// propose().
void Consensus::propose_rest(Contest& contest) noexcept {
  Cells rest, misfit;
  fit(contest.pose[static_cast<std::size_t>(contest.best)], misfit);
  double left = 0, all = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    const bool fits = misfit[c] <= kMisfit * scale_ || sums_.pairs[c] < kLeastPairs;
    rest[c] = fits ? 0.0F : remembered_[c];
    left += static_cast<double>(rest[c] * sums_.pairs[c]);
    all += static_cast<double>(remembered_[c] * sums_.pairs[c]);
  }
  if (left <= kLeastRest * all) return;
  for (const bool from_prior : {true, false}) {
    Vec6 xi = contest.prior;
    if (!from_prior && !solve(rest, Vec6::Zero(), xi)) continue;
    refine(rest, from_prior ? 1.0F : 6.0F, kRounds, xi);
    contest.pose[static_cast<std::size_t>(contest.count++)] = xi;
    fit(xi, misfit);
    contest.tightest = std::min(contest.tightest, scale_of(misfit, rest));
  }
  choose(contest);
}

// Pixels in cells that fit the pose and not the winner, over those that fit the winner and not it.
double Consensus::rivalry(const Contest& contest, const Vec6& xi,
                          const Vec6& winner) const noexcept {
  Cells misfit;
  fit(xi, misfit);
  double ours = 0, theirs = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    if (sums_.pairs[c] < kLeastPairs) continue;
    const float d = remembered_[c] * sums_.pairs[c] *
                    (1 / (1 + misfit_[c] / scale_) - 1 / (1 + misfit[c] / scale_));
    (d > 0 ? ours : theirs) += static_cast<double>(std::abs(d));
  }
  return theirs * likely(contest, xi) / (std::max(ours, 1.0) * likely(contest, winner));
}

void Consensus::stand(Stand& out) const noexcept {
  out.misfit = misfit_, out.pairs = sums_.pairs, out.scale = scale_;
}

double Consensus::only(const Stand& a, const Stand& b, float most_scale) const noexcept {
  const float scale = std::min({a.scale, b.scale, most_scale});
  double sum = 0;
  for (std::size_t c = 0; c < static_cast<std::size_t>(sums_.size()); ++c) {
    const float ours = a.pairs[c] < kLeastPairs ? 0 : a.pairs[c] / (1 + a.misfit[c] / scale),
                theirs = b.pairs[c] < kLeastPairs ? 0 : b.pairs[c] / (1 + b.misfit[c] / scale);
    sum += static_cast<double>(
        remembered_[c] *
        std::max(ours - theirs - kByNoise * std::max(a.pairs[c], b.pairs[c]), 0.0F));
  }
  return sum;
}

void Consensus::compete(const Cells& remembered, const Vec6& still, const Vec6& prior,
                        double prior_sigma_m, std::uint64_t seed, ConsensusResult& out) noexcept {
  remembered_ = remembered;
  Contest contest;
  contest.prior = prior, contest.prior_sigma_m = prior_sigma_m;
  propose(contest, still, seed);
  choose(contest);
  out = ConsensusResult{};
  if (contest.best < 0) return;
  propose_rest(contest);
  const Vec6 winner = contest.pose[static_cast<std::size_t>(contest.best)];
  conclude(winner, out, contest.tightest);
  Vec6 expected = winner;
  double rival = 0;
  for (int i = 0; i < contest.count; ++i) {
    const Vec6& xi = contest.pose[static_cast<std::size_t>(i)];
    if (mean_way(xi, winner) < kOtherMotion_m) continue;
    const double ratio = rivalry(contest, xi, winner);
    rival = std::max(rival, ratio);
    if (ratio >= kRivalLimit && likely(contest, xi) > likely(contest, expected)) expected = xi;
  }
  // Nobody knows: what is expected goes on, unclaimed.
  if (expected != winner) conclude(expected, out, contest.tightest);
  out.rival = rival;
  out.certain = rival < kRivalLimit;
  out.outvoted = out.support < kOutvoted * contest.most_support;
}

}  // namespace perception
