// Images to a folder that drivers/camera/tum_reader.hpp reads: associations.txt, intrinsics.txt,
// depth/ and rgb/ as PNG, depth in mm; groundtruth.txt where all poses are known. The same images
// give the same bytes. A pixel without colour is written black.
#pragma once

#include <string>

#include "tools/record/fusion_sequence.hpp"

namespace teletact {

// One image after the other. Throws std::runtime_error naming what can not be written.
class RecordingWriter {
 public:
  explicit RecordingWriter(std::string folder);
  // `stamp`: seconds as text, as the lists are to have it. Images without colour get grey.
  void add(const perception::RgbdFrame& frame, const std::string& stamp);
  // The lists; all images had the first one's lens.
  void finish();

 private:
  std::string folder_, lists_;
  perception::Intrinsics intrinsics_{};
  int count_ = 0;
};

// A sequence held in memory. `backwards`: the last image first, at the stamps of the first.
void write_recording(const FusionSequence& sequence, const std::string& folder,
                     bool backwards = false);

}  // namespace teletact
