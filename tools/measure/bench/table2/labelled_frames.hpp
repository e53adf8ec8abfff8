// Folders of RGB-D frames with true masks (their layout: touches.hpp), for whatever judges
// segmentation.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace teletact {

inline constexpr std::uint16_t kUnlabelled = 65535;

struct FrameKind {
  perception::Intrinsics k;
  float mm_per_unit = 1;
  bool parts = false;  // label / 10 is the object
};

struct LabelledFolder {
  std::string path, name;  // name: the path's last word
  FrameKind kind;
  std::vector<std::string> frames;  // sorted, at least one
};

struct LabelledFrame {
  perception::Image<perception::Rgb> rgb;
  perception::Image<std::uint16_t> depth, label;  // label: object, 0 rest, kUnlabelled not judged
};

// `folder` itself or those in it. One without intrinsics is left out, which is said on
// `progress`; none left:
// std::runtime_error.
[[nodiscard]] std::vector<LabelledFolder> labelled_folders(std::ostream& progress,
                                                           const std::string& folder);
// Throws std::runtime_error with one line.
[[nodiscard]] LabelledFrame load_frame(const LabelledFolder& folder, const std::string& frame);

// Objects of the frame, ascending.
[[nodiscard]] std::vector<std::uint16_t> objects_of(const LabelledFrame& frame);
// Of metrics: a-z, 0-9, _; of mosd_learn: mosd.
[[nodiscard]] std::string metric_name(const std::string& folder);

// Over the pixels that are judged; 0 where neither has one.
template <class In>
double iou(const perception::Image<std::uint16_t>& label, std::uint16_t object, const In& in) {
  double both = 0, either = 0;
  for (int v = 0; v < label.height(); ++v) {
    for (int u = 0; u < label.width(); ++u) {
      const std::uint16_t l = label.at(u, v);
      if (l == kUnlabelled) continue;
      const bool a = in(u, v), b = l == object;
      both += a && b ? 1 : 0;
      either += a || b ? 1 : 0;
    }
  }
  return either > 0 ? both / either : 0;
}

}  // namespace teletact
