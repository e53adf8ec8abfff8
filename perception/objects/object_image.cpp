// Which object each pixel of a frame shows, from map and mask together.
//
// A reading on a surface, away from depth edges, gets the label that was voted there, since many
// frames agreed on it. At an edge a reading may belong to either side or to neither, and voxels are
// coarser than pixels. There, and where nothing was read or voted, the frame's own mask decides,
// with its outline corrected by the masks so far (outline_memory.hpp). Where a mask is withheld, or
// this frame was not segmented, the map alone decides.
#include <algorithm>
#include <utility>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

constexpr int kSureWeight = 3;  // of votes that outweigh a mask

}  // namespace

// Label that segment() found in the map at all looked-up pixels round this one; kNoVote: they
// differ.
std::uint8_t ObjectMap::known_round(int u, int v) const noexcept {
  const int step = known_step(), u0 = u / step * step, v0 = v / step * step;
  const int u1 = u0 == u ? u0 : u0 + step, v1 = v0 == v ? v0 : v0 + step;
  if (u0 < within_.u0 || v0 < within_.v0 || u1 > within_.u1 || v1 > within_.v1) return kNoVote;
  const auto label = [&](int a, int b) {
    const std::uint8_t known = known_.at(a, b);
    return known == kSureOther ? std::uint8_t{0} : known;
  };
  const std::uint8_t first = label(u0, v0);
  const bool same = label(u1, v0) == first && label(u0, v1) == first && label(u1, v1) == first;
  return same ? first : kNoVote;
}

std::uint8_t ObjectMap::shows(const Look& look, int u, int v) const noexcept {
  const std::uint8_t said = painted_ ? settled_.at(u, v) : kNoVote;
  const auto& depth = look.frame.depth_mm;
  if (said <= kMostLabel) {
    if (said == known_round(u, v)) return said;
    if (!reads(depth.at(u, v)) || on_edge(look.frame, look.map.config(), u, v)) return said;
    const LabelVoxel voted = look.voted(u, v);
    return voted.weight < kSureWeight ? said : voted.label;
  }
  if (reads(depth.at(u, v))) return look.label(u, v);
  // A hole shows what a pixel beside it shows.
  for (const auto& [a, b] :
       {std::pair{u - 1, v}, std::pair{u + 1, v}, std::pair{u, v - 1}, std::pair{u, v + 1}})
    if (depth.contains(a, b) && reads(depth.at(a, b))) return look.label(a, b);
  return 0;
}

void ObjectMap::draw(const FrameView& frame, const MapView& map, const Pose& X_WC, int step,
                     ImageView<std::uint8_t> out) noexcept {
  for (int y = 0; y < out.height; ++y) std::fill_n(out.row(y), out.width, std::uint8_t{0});
  const Intrinsics& k = frame.intrinsics;
  if (step < 1 || k.width > max_width_ || k.height > max_height_) return;
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const Look look{frame, map, X_WC, X_CW, CameraBoxes(k, X_CW), MapReader(map)};
  if (painted_) {
    settled_.reshape(k.width, k.height);
    std::copy_n(image_.data(), k.width * k.height, settled_.data());
  }
  for (std::uint8_t id = 1; id <= kMost; ++id)
    if (objects_[id - 1U].id == 0) outlines_.forget(id);
  for (const MapObject& o : objects_) {
    if (o.id == 0) continue;
    const SeedBox mask = painted_ ? shown(o.id) : SeedBox{1 << 20, 1 << 20, -1, -1};
    outlines_.settle(frame, X_WC, o.id, {mask.u0, mask.v0, mask.u1, mask.v1}, map.config(),
                     settled_.view());
  }
  for (const MapObject& o : objects_) {
    if (o.id == 0) continue;
    const SeedBox fused = project(look, o.id);
    const SeedBox mask = painted_ ? shown(o.id) : SeedBox{1 << 20, 1 << 20, -1, -1};
    const int u1 = std::min(std::max(fused.u1, mask.u1 + 1) / step, out.width - 1);
    const int v1 = std::min(std::max(fused.v1, mask.v1 + 1) / step, out.height - 1);
    for (int y = (std::max(0, std::min(fused.v0, mask.v0 - 1)) + step - 1) / step; y <= v1; ++y)
      for (int x = (std::max(0, std::min(fused.u0, mask.u0 - 1)) + step - 1) / step; x <= u1;
           ++x, ++stats_.work)
        out.at(x, y) = shows(look, x * step, y * step);
  }
}

}  // namespace perception
