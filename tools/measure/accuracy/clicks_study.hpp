// teletact accuracy clicks: error of 1, 2, 3 and 5 clicks (1 - mean IoU) against thread CPU, over
// the knobs of
// perception/segmentation/click_segmenter.hpp, on folders of RGB-D frames with true masks and on
// drawn clutter.
//
// The clicks are put by rule. The first: the middle of the object, its pixel farthest from all
// others'. Each next
// one: the middle of the largest error, that is of the largest 4-connected part of what is
// missing or too much; at
// equal size the one whose first pixel comes first. Missing: add. Too much: take away. No error:
// no click.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "perception/segmentation/click.hpp"
#include "tools/measure/accuracy/study.hpp"
#include "tools/measure/bench/table2/labelled_frames.hpp"

namespace teletact {

struct ClicksStudyOptions {
  std::string data;          // folder of frames, or of such folders; empty: clutter alone
  int clutter = 12;          // scenes; 0: none
  std::uint64_t seed = 100;  // of the first scene; the next ones follow
  bool knobs = true;         // false: the default alone
};

// The next click by the rule; u < 0: there is no error.
[[nodiscard]] perception::Click next_click(const perception::Image<std::uint16_t>& label,
                                           std::uint16_t object,
                                           perception::ImageView<const std::uint8_t> mask);

// Throws std::runtime_error with one line.
[[nodiscard]] Study study_clicks(std::ostream& progress, const ClicksStudyOptions& options);

}  // namespace teletact
