// teletact accuracy choice: are the parameters of segmentation fitted to the data that judges them?
//
// Draws settings round the default, each value times 2^u with u uniform in [-.7, .7]. Scores each
// on the odd images and on the even ones. A choice on one half has not seen the other half; its
// result there shows what a choice on such data is worth. The default was chosen with an eye on
// both halves. It must not be worse than that, and if it were much better it would be overfitted.
//   images, segmentations    whole images against people (bench table2): PRI - GCE - VOI / 10 bit -
//                            BDE / 100 px
//   rgb, depth, label        one touch (bench segmentation): mean IoU
#pragma once

#include <array>
#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct ChoiceOptions {
  std::string data;  // folder of either kind, or of folders of the second
  int settings = 40;
  std::uint64_t seed = 1;  // of the settings and touches
};

// Scores by half: first the default, then what was drawn.
struct ChoiceRow {
  std::string data, score;
  std::vector<std::array<double, 2>> scores;

  [[nodiscard]] std::size_t best(std::size_t half) const;  // of all, the default included
  [[nodiscard]] int better(std::size_t half) const;        // settings above the default
  // What choosing on the other half is worth on this one, less what the default is.
  [[nodiscard]] double unseen_gain(std::size_t half) const;
};

struct Choice {
  std::vector<ChoiceRow> rows;
  // unseen_gain <= .01 of either half of each.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Throws std::runtime_error with one line when the folder is of neither kind.
[[nodiscard]] Choice study_choice(std::ostream& progress, const ChoiceOptions& options);

}  // namespace teletact
