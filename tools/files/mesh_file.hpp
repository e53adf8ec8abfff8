// A mesh as a PLY file.
#pragma once

#include <string>

#include "perception/tsdf/mesh/mesh.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace teletact {

// Binary little-endian PLY: x y z nx ny nz (float) red green blue (uchar), faces as uchar + 3 ints.
// Written beside and renamed, so `path` never holds half a file.
[[nodiscard]] rt::Result<bool> write_ply(rt::NonRealtime&, const std::string& path,
                                         const perception::Mesh& mesh);

}  // namespace teletact
