// Reader of an RGB-D sequence in the layout of the TUM RGB-D benchmark (Sturm et al., IROS 2012) or
// of 7-Scenes (Shotton et al., CVPR 2013), as they are downloaded: sequence_layout.hpp says how the
// images are found.
//
//   depth images             16 bit, one channel; 0 and 65535 = no reading
//   colour images            8 bit, PNG or JPEG, of the depth's size
//   intrinsics.txt           optional: "fx fy cx cy width height depth_units_per_metre" of the
//                            depth camera. Without it TumOptions::pinhole, else what the data set
//                            says of itself, for 640 x 480: TUM 525 525 319.5 239.5 and 5000 a
//                            metre, 7-Scenes 585 585 320 240 and 1000 a metre
//   colour_registration.txt  optional: colour is not registered; pose and pinhole of the colour
//                            camera ("fx v", "fy v", "cx v", "cy v", "R 9 values", "t 3 values in
//                            m", X_colour = R X_depth + t). 7-Scenes is never registered: without
//                            the file it is what was found for one of its rooms
//
// Strict: the first error ends reading with one message that names file, line and value.
// assumed() lists what was assumed. Ground truth beside the images is never opened.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/camera/sequence_layout.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/result.hpp"

namespace cv {
class Mat;
}

namespace drivers {

struct TumOptions {
  // For folders with colour_registration.txt. False: no colour (has_colour = false). True: each
  // depth pixel is looked up in the colour image. Pixels without a reading, outside of that image,
  // or hidden from the colour camera by a nearer surface get no colour (no_colour.hpp). Without
  // that file colour counts as registered.
  bool register_colour = false;
  // 640 x 480 to 512 x 424 by nearest pixel: scale 424/480, then a centre crop; f 585 becomes
  // 516.75.
  bool to_512x424 = false;
  // Depth only: colour files are neither asked for nor opened.
  bool skip_colour = false;
  // Of the depth camera, for a folder without intrinsics.txt; refused with one.
  struct Pinhole {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    double units_per_metre = 0;  // 0: as the data set has it
  };
  std::optional<Pinhole> pinhole = std::nullopt;
};

class TumSequence {
 public:
  [[nodiscard]] static rt::Result<TumSequence> open(const std::string& folder,
                                                    const TumOptions& options = {});

  [[nodiscard]] int size() const noexcept { return static_cast<int>(layout_.images.size()); }
  [[nodiscard]] const perception::Intrinsics& intrinsics() const noexcept { return intrinsics_; }
  [[nodiscard]] double depth_units_per_metre() const noexcept { return units_per_metre_; }
  // Stamp of the depth image, s, as the file has it.
  [[nodiscard]] double stamp_s(int i) const noexcept {
    return layout_.images[static_cast<std::size_t>(i)].depth_s;
  }
  // The same as text, to be written back without a digit lost.
  [[nodiscard]] const std::string& stamp_text(int i) const noexcept {
    return layout_.images[static_cast<std::size_t>(i)].depth_stamp;
  }
  // Lines for the user: values that are not in the folder and were assumed, and images that were
  // left out.
  [[nodiscard]] const std::vector<std::string>& assumed() const noexcept { return assumed_; }
  // Decodes frame i. exposure = stamp_s since the epoch, seq = i.
  [[nodiscard]] rt::Result<bool> read(int i, perception::RgbdFrame& out) const;

 private:
  struct ColourCamera {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    perception::Mat3 R = perception::Mat3::Identity();
    perception::Vec3 t = perception::Vec3::Zero();
  };
  [[nodiscard]] rt::Result<bool> assume_pinhole();
  [[nodiscard]] rt::Result<bool> find_registration();
  [[nodiscard]] rt::Result<bool> read_registration(const std::string& path);
  void register_colour(const cv::Mat& colour, perception::RgbdFrame& out) const;

  std::string folder_;
  TumOptions options_;
  perception::Intrinsics source_, intrinsics_;  // of the files; of the frames
  double units_per_metre_ = 1000;
  std::optional<ColourCamera> registration_;
  SequenceLayout layout_;
  std::vector<std::string> assumed_;
};

}  // namespace drivers
