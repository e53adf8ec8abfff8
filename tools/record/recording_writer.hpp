// Writes a sequence to a folder that drivers/camera/tum_reader.hpp reads: associations.txt,
// intrinsics.txt, depth/ and rgb/ as PNG, depth in mm; groundtruth.txt if all poses are known. The
// same sequence gives the same bytes.
#pragma once

#include <string>

#include "tools/record/fusion_sequence.hpp"

namespace teletact {

// `backwards`: the last image first, at the stamps of the first. A sequence without colour gets grey. Throws
// std::runtime_error naming what can not be written.
void write_recording(const FusionSequence& sequence, const std::string& folder,
                     bool backwards = false);

}  // namespace teletact
