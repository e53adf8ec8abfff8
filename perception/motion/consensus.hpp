// Which part of the image stands still, and how has the camera moved against it?
//
// An image in which something moves holds several rigid motions. Each of them explains its cells
// (icp/cell_sums.hpp); the camera's is the one that explains most of the IMAGE, counted in pixels,
// not in information: a thing at arm's length outweighs a far wall some hundredfold when readings
// weigh by their noise.
//
//   start     the prior, no motion at all, what all cells together say, quarters and halves of the
//             image, the cells that were static in the last frame, random handfuls of cells
//   refine    least squares over cells, reweighed by how well each fits (Geman and McClure; scale
//             from the noise model and the map's own error at first, then what half of the cells
//             keep, never above the former)
//   support   sum over cells of pixels / (1 + e / tau^2), e the mean square residual
//   winner    most support. A wall agrees with every motion along itself, so two poses are compared
//             by the cells that fit one and not the other; a rival of another motion with nearly
//             as many makes the frame ambiguous.
//
// A direction in which the cells say nothing stays at the prior.
#pragma once

#include <array>
#include <cstdint>

#include "perception/icp/cell_sums.hpp"

namespace perception {

struct ConsensusConfig {
  icp::NoiseRule noise{0.0015F, 0.004F, 0.8F};  // of a reading at full resolution
  double noise_share = 0.7;  // of it that is left in a pixel of the coarse image, pattern included
  double map_error_m = 0.002;     // of the ray cast, RMS, at fine voxels ...
  double map_error_voxel = 0.10;  // ... plus this share of a voxel
  double voxel_m = 0.01;
};

struct ConsensusResult {
  static constexpr std::array<float, 4> kScales{0.03F, 0.1F, 0.3F, 1.0F};
  Vec6 xi = Vec6::Zero();  // left twist about the centre, from the pose that the sums were taken at
  double support = 0;      // pixels
  float scale = 1;         // of that: what the cells leave by themselves
  std::array<double, 4> support_at{};  // by kScales, to compare two that were taken apart
  double pairs = 0;                    // pixels that met a surface within the gates
  double rival = 0;       // of the strongest other motion: its own cells' pixels over ours
  bool certain = false;   // no rival comes near
  bool outvoted = false;  // another motion explains more, and is not expected
  // By the tighter of both.
  [[nodiscard]] bool better_than(const ConsensusResult& other) const noexcept;
  int misfits = 0;         // cells that do not fit the winner
  double unexplained = 0;  // share of the pixels in such cells, of those that may be static
};

class Consensus {
 public:
  using Cells = std::array<float, CellSums::kMost>;

  // Of the level, against the model, from X_FC. `length_m` mean depth: scales rotation. `rows` of
  // each cell; `again`: the image is that of the last call.
  void look(const DepthLevel& live, const ModelView& model, const Pose& X_FC, const Vec3& centre_F,
            double length_m, const ConsensusConfig& config, int rows = CellSums::kEdge,
            bool again = false) noexcept;
  // Least squares, reweighed, from xi = 0 alone: for images in which nothing new moves. Cheap.
  // `remembered`: share of each cell that may be static, by what is known of it before.
  void settle(const Cells& remembered, ConsensusResult& out) noexcept;
  // The same of a pose that is believed: only cells that fit it have a part.
  void stay(const Cells& remembered, ConsensusResult& out) noexcept;
  // All hypotheses. `still`: twist of a camera that has not moved; `prior`, which may be off by
  // `prior_sigma_m` (mean over the points).
  void compete(const Cells& remembered, const Vec6& still, const Vec6& prior, double prior_sigma_m,
               std::uint64_t seed, ConsensusResult& out) noexcept;

  [[nodiscard]] const CellSums& sums() const noexcept { return sums_; }
  // Does a cell fit the winner, as well as half of them do or to the limit?
  [[nodiscard]] bool fits(int cell) const noexcept;
  // To the limit of the noise model.
  [[nodiscard]] bool fits_noise(int cell) const noexcept {
    return misfit_[static_cast<std::size_t>(cell)] <= 1;
  }
  // The sums were taken anew, at the winner: its cells by these, by the scale that they had. Its
  // support.
  double reconsider() noexcept;
  // How well each cell meets the map at the winner, to compare two poses that are too far apart for
  // one set of sums.
  struct Stand {
    Cells misfit{}, pairs{};
    float scale = 1;
  };
  void stand(Stand& out) const noexcept;
  // Pixels that may be static in cells that fit `a` and not `b`, by their scales and `most_scale`.
  [[nodiscard]] double only(const Stand& a, const Stand& b, float most_scale) const noexcept;
  // Share of the pixels that may be static in cells that fit a pose and not the winner.
  [[nodiscard]] double own_share(const Vec6& xi) const noexcept;
  // Support of a pose, of the cells that may be static; and over the winner's.
  [[nodiscard]] double support_of(const Vec6& xi) const noexcept;
  [[nodiscard]] double share_of_winner(const Vec6& xi) const noexcept;
  [[nodiscard]] double mean_way(const Vec6& a, const Vec6& b) const noexcept;

  static constexpr float kLeastPairs = 12;  // pixels of a cell that counts
  // A pose `way_m` from what was expected, which may be off by `sigma_m`: a leap counts with a
  // share of its pixels.
  [[nodiscard]] static double likely(double way_m, double sigma_m) noexcept;
  // chosen on: not recorded; judged on: moving 606, moving 707
  static constexpr double kOtherMotion_m = 0.004;  // poses nearer to each other are one
  static constexpr double kRivalLimit = 0.7;       // of the winner's own pixels, and nobody knows

 private:
  void fit(const Vec6& xi, Cells& misfit) const noexcept;
  [[nodiscard]] double support(const Cells& misfit, const Cells& weight) const noexcept;
  [[nodiscard]] bool solve(const Cells& weight, const Vec6& from, Vec6& xi) const noexcept;
  [[nodiscard]] float scale_of(const Cells& misfit, const Cells& memory) const noexcept;
  // By a scale of at most `most_scale`: another motion may fit its cells more tightly than half of
  // all fit this one.
  void conclude(const Vec6& xi, ConsensusResult& out, float most_scale = 1) noexcept;
  void refine(const Cells& memory, float scale, int rounds, Vec6& xi) const noexcept;

  static constexpr int kRounds = 6;
  // chosen on: not recorded; judged on: moving 606, moving 707
  static constexpr float kStay = 0.3F;  // scale from which a believed pose is refined
  static constexpr float kMisfit = 2;   // scales, and a cell does not fit
  // Of compete(): what is proposed, what was expected, who wins.
  struct Contest {
    static constexpr int kHandfuls = 32;  // random hypotheses

    std::array<Vec6, 16 + kHandfuls> pose;
    int count = 0, best = -1;
    Vec6 prior = Vec6::Zero();
    double prior_sigma_m = 1;
    float tightest = 1;  // scale
    double most_support = 0;
  };
  [[nodiscard]] double likely(const Contest& contest, const Vec6& xi) const noexcept;
  void add_from(Contest& contest, Vec6 xi, float scale) const noexcept;
  void add_of_part(Contest& contest, const Cells& part, float scale) const noexcept;
  void propose(Contest& contest, const Vec6& still, std::uint64_t seed) const noexcept;
  void propose_rest(Contest& contest) noexcept;
  void choose(Contest& contest) noexcept;
  [[nodiscard]] double rivalry(const Contest& contest, const Vec6& xi,
                               const Vec6& winner) const noexcept;

  CellSums sums_;
  Cells limit2_{};  // m^2
  Cells misfit_{};
  float scale_ = 1;  // of misfit_
  Cells remembered_{};
  double total_pairs_ = 0;
  double length_m_ = 1;
};

}  // namespace perception
