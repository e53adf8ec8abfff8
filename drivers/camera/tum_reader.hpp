// Reader of an RGB-D sequence in the layout of the TUM RGB-D benchmark (Sturm et al., IROS 2012).
//
//   associations.txt         "t_colour colour_file t_depth depth_file", seconds, paths in the
//   folder;
//                            depth stamps rise strictly; '#' begins a comment line
//   depth/*.png              16 bit, one channel; 0 and 65535 = no reading
//   rgb/*.jpg|png            8 bit colour, of the depth's size
//   intrinsics.txt           "fx fy cx cy width height depth_units_per_metre"
//   colour_registration.txt  optional: colour is not registered; pose and pinhole of the colour
//                            camera ("fx v", "fy v", "cx v", "cy v", "R 9 values", "t 3 values in
//                            m", X_colour = R X_depth + t)
//
// Strict: the first thing that is wrong ends it with one message that names file, line, value.
// Ground truth beside the images is never opened.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/result.hpp"

namespace cv {
class Mat;
}

namespace drivers {

struct TumOptions {
  // Files with colour_registration.txt: false leaves colour out (has_colour = false), true looks
  // each depth pixel up in the colour image, hidden ones (behind a nearer surface as the colour
  // camera sees it) get black. Without that file colour counts as registered.
  bool register_colour = false;
  // 640 x 480 to 512 x 424 by nearest pixel: scale 424/480, then a centre crop; f 585 becomes
  // 516.75.
  bool to_512x424 = false;
  // Depth only: colour files are neither asked for nor opened.
  bool skip_colour = false;
};

class TumSequence {
 public:
  [[nodiscard]] static rt::Result<TumSequence> open(const std::string& folder,
                                                    const TumOptions& options = {});

  [[nodiscard]] int size() const noexcept { return static_cast<int>(entries_.size()); }
  [[nodiscard]] const perception::Intrinsics& intrinsics() const noexcept { return intrinsics_; }
  [[nodiscard]] double depth_units_per_metre() const noexcept { return units_per_metre_; }
  // Stamp of the depth image, s, as the file has it.
  [[nodiscard]] double stamp_s(int i) const noexcept {
    return entries_[static_cast<std::size_t>(i)].depth_s;
  }
  // The same as text, to be written back without a digit lost.
  [[nodiscard]] const std::string& stamp_text(int i) const noexcept {
    return entries_[static_cast<std::size_t>(i)].depth_stamp;
  }
  // Decodes frame i. exposure = stamp_s since the epoch, seq = i.
  [[nodiscard]] rt::Result<bool> read(int i, perception::RgbdFrame& out) const;

 private:
  struct Entry {
    double depth_s = 0;
    std::string depth_stamp, depth_file, colour_file;
    int line = 0;
  };
  struct ColourCamera {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    perception::Mat3 R = perception::Mat3::Identity();
    perception::Vec3 t = perception::Vec3::Zero();
  };
  [[nodiscard]] rt::Result<bool> read_registration(const std::string& path);
  void register_colour(const cv::Mat& colour, perception::RgbdFrame& out) const;

  std::string folder_;
  TumOptions options_;
  perception::Intrinsics source_, intrinsics_;  // of the files; of the frames
  double units_per_metre_ = 1000;
  std::optional<ColourCamera> registration_;
  std::vector<Entry> entries_;
};

}  // namespace drivers
