// teletact bench table2: whole-image segmentation against people, beside the paper's table.
//
// DIR/images/ID.jpg|png and DIR/segmentations/ID_K.png (K = 0, 1, ...: label map of person K). Scores:
// mean over an image's people, then over images (perception/segmentation/measures.hpp). Rows:
//   people     each person against the others of the image: the yardstick
//   teletact   segment_whole(), one fixed parameter set, no depth
//   ... odd / even images: two halves, so that a setting fitted to one would show
//   paper's protocol   one seed a human region, method `paper` without depth
//   mean shift (OpenCV)   a packaged method on the same images
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "perception/segmentation/measures.hpp"
#include "perception/segmentation/region_merge.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct Table2Row {
  std::string name;
  perception::SegmentationScores mean;
  double region_ratio = 0;
  double ms = 0;  // thread CPU an image
};

struct Table2Result {
  int images = 0, maps = 0;
  Table2Row people, ours, odd, even, paper_protocol, mean_shift;

  // Of ours: PRI >= .80, BDE <= 12.5 px, GCE <= .22, VOI <= 2.2 bit, .5 to 2 times as many regions
  // as people see.
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Throws std::runtime_error with one line when the folder is not as above.
// With ours_only neither the people, nor the paper's protocol, nor the packaged method are scored:
// their rows stay 0.
[[nodiscard]] Table2Result bench_table2(std::ostream& progress, const std::string& folder,
                                        bool ours_only = false,
                                        const perception::WholeImageConfig& config = {});

}  // namespace teletact
