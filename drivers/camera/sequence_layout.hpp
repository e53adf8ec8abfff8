// Finds the images of a recording, in each layout of such folders as they are downloaded:
//
//   associations.txt      TUM RGB-D benchmark, paired: "t_colour colour_file t_depth depth_file"
//   depth.txt, rgb.txt    TUM RGB-D benchmark, as it comes: "t file" each. A depth image goes with
//                         the colour image nearest in time, at most 20 ms away; one that has none
//                         is left out
//   frame-NNNNNN.*.png    7-Scenes (Shotton et al., CVPR 2013): .depth.png, .color.png; no stamps:
//                         30 Hz
//
// The first layout that is found is used. Seconds; '#' begins a comment line; depth stamps rise
// strictly.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rt/result.hpp"

namespace drivers {

inline constexpr double kPairGap_s = 0.020;
inline constexpr double kSevenScenesRate_hz = 30;

struct RecordedImage {
  double depth_s = 0;
  std::string depth_stamp;  // as the file has it
  std::string depth_file, colour_file;
};

struct SequenceLayout {
  enum class Kind { kAssociations, kLists, kSevenScenes } kind = Kind::kAssociations;
  std::vector<RecordedImage> images;
  int left_out = 0;  // depth images without a colour image
};

// Every image is a file, at least one. An error names file, line and value.
[[nodiscard]] rt::Result<SequenceLayout> find_images(const std::string& folder, bool with_colour);

// N of "frame-NNNNNN<suffix>", for example ".depth.png".
[[nodiscard]] std::optional<int> seven_scenes_number(const std::string& file_name,
                                                     const std::string& suffix);

[[nodiscard]] bool regular_file(const std::string& path);

}  // namespace drivers
