// Masks into the map: which of them are believed, what of them votes, what became of the objects.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/objects/object_map.hpp"

namespace perception {

void ObjectMap::fuse(TsdfMap& map) noexcept {
  if (!painted_) return;
  const bool fresh = stats_.answer == TouchAnswer::kObject;
  if (stats_.followed != 0) {
    MapObject& o = objects_[stats_.followed - 1U];
    if (!fresh) judge(o);
    leave_out_rim(o.id);
  } else {
    std::copy_n(image_.data(), image_.width() * image_.height(), voting_.data());
  }
  stats_.votes = map.vote_labels(voting_.view(), fresh ? stats_.touched : std::uint8_t{0});
  stats_.work += static_cast<std::uint64_t>(stats_.votes.blocks_voted) * TsdfMap::kBlockVoxels;
  settle(map);
}

// What became of the objects.
void ObjectMap::settle(TsdfMap& map) noexcept {
  std::uint32_t present = 0;
  map.for_each_label_block([&](std::int32_t, std::uint32_t bits) { present |= bits; });
  for (MapObject& o : objects_) {
    if (o.id == 0) continue;
    const bool mine = o.id == stats_.followed;
    if (mine && o.seen) ++o.masks;
    const bool left = ((present >> o.id) & 1U) != 0;
    const bool young = o.masks < config_.young_frames;
    if (o.gone || (!left && (!young || o.unseen > config_.young_frames))) {
      if (left) map.forget_label(o.id);
      o = {};
      continue;
    }
    if (mine && o.seen && (o.masks - 1) % config_.summary_period == 0) summarise_object(map, o);
  }
}

// Sets what is usual of the object, or takes a mask that is not believed out of the image.
void ObjectMap::judge(MapObject& object) noexcept {
  int mask = 0, both = 0, against = 0;
  const SeedBox box = shown(object.id);
  for (int v = (box.v0 + 1) & ~1; v <= box.v1; v += 2) {
    const std::uint8_t *said = &image_.at(0, v), *seed = &seed_.at(0, v), *other = &other_.at(0, v);
    for (int u = (box.u0 + 1) & ~1; u <= box.u1; u += 2) {
      const int in = said[u] == object.id ? 1 : 0;
      mask += in;
      both += in & seed[u];
      against += in & other[u];
    }
  }
  stats_.agreement = static_cast<float>(both) / static_cast<float>(std::max(1, planted_ + against));
  const bool settled = object.masks >= config_.settled_masks;
  const bool there = static_cast<float>(planted_) > kStillThere * object.usual_seed;
  const bool odd = mask > config_.most_growth * planted_ || mask * config_.most_growth < planted_;
  object.seen = object.seen && mask > 0;
  if (settled && mask > 0) {
    const bool agrees = static_cast<double>(stats_.agreement) >=
                        static_cast<double>(object.usual_agreement) - config_.agreement_drop;
    object.held = agrees && !odd ? 0 : object.held + 1;
    const bool young = object.masks < config_.young_frames;
    stats_.withheld = (odd && !young) || (object.held > 0 && object.held < config_.held_masks);
  } else {
    stats_.withheld = settled && there;  // nothing is seen of it where it still is
  }
  if (stats_.withheld) {
    // Where hardly anything is left of it, what shows in its place votes.
    replace(object.id, there ? kNoVote : std::uint8_t{0});
    if (there) fill(seed_box_, kOthersMargin_px, kNoVote);
    object.seen = false;
  } else if (object.seen) {
    const float share = object.masks <= 1 ? 1.0F : 0.2F;
    object.usual_agreement += share * (stats_.agreement - object.usual_agreement);
    object.usual_seed += share * (static_cast<float>(planted_) - object.usual_seed);
  }
  object.unseen = object.seen ? 0 : object.unseen + 1;
}

void ObjectMap::replace(std::uint8_t id, std::uint8_t by) noexcept {
  std::uint8_t* p = image_.data();
  for (int i = 0; i < image_.width() * image_.height(); ++i) p[i] = p[i] == id ? by : p[i];
}

// Pixels that the image gives to the object; u1 < u0: none.
ObjectMap::SeedBox ObjectMap::shown(std::uint8_t id) const noexcept {
  SeedBox out{1 << 20, 1 << 20, -1, -1};
  const int w = image_.width();
  for (int v = 0; v < image_.height(); ++v) {
    const std::uint8_t* row = image_.data() + static_cast<std::ptrdiff_t>(v) * w;
    const void* first = std::memchr(row, id, static_cast<std::size_t>(w));
    if (first == nullptr) continue;
    int last = w - 1;
    while (row[last] != id) --last;
    out.u0 = std::min(out.u0, static_cast<int>(static_cast<const std::uint8_t*>(first) - row));
    out.u1 = std::max(out.u1, last);
    out.v0 = std::min(out.v0, v), out.v1 = v;
  }
  return out;
}

// Copies the image into what votes, without the pixels at both sides of the mask's outline. A mask that is
// little else but outline keeps them.
void ObjectMap::leave_out_rim(std::uint8_t id) noexcept {
  const int w = image_.width(), h = image_.height();
  std::copy_n(image_.data(), w * h, voting_.data());
  const SeedBox box = shown(id);
  int inner = 0, all = 0;
  for (int v = std::max(0, box.v0 - 1); v <= std::min(h - 1, box.v1 + 1); ++v) {
    const std::uint8_t* row = &image_.at(0, v);
    const std::uint8_t *up = v > 0 ? row - w : row, *down = v + 1 < h ? row + w : row;
    std::uint8_t* out = &voting_.at(0, v);
    for (int u = std::max(0, box.u0 - 1); u <= std::min(w - 1, box.u1 + 1); ++u) {
      const bool in = row[u] == id;
      const bool left = row[std::max(u - 1, 0)] == id, right = row[std::min(u + 1, w - 1)] == id;
      const bool rim = left != in || right != in || (up[u] == id) != in || (down[u] == id) != in;
      if (rim) out[u] = kNoVote;
      all += in ? 1 : 0;
      inner += in && !rim ? 1 : 0;
    }
  }
  if (4 * inner < all) std::copy_n(image_.data(), w * h, voting_.data());
}

// Of the labelled nodes next to the surface, thinned evenly where there are too many.
void ObjectMap::summarise_object(const TsdfMap& map, MapObject& object) noexcept {
  const int near = static_cast<int>(
      std::min(0.6 * map.voxel_size() / static_cast<double>(map.metres_per_unit()), 32767.0));
  const auto each = [&](auto&& fn) {
    map.for_each_label_block([&](std::int32_t b, std::uint32_t bits) {
      if (((bits >> object.id) & 1U) == 0) return;
      const LabelVoxel* labels = map.block_labels(b);
      const std::uint32_t* words = map.block_words(b);
      for (int n = 0; n < TsdfMap::kBlockVoxels; ++n)
        if (labels[n].label == object.id &&
            TsdfMap::word_weight(words[n]) >= TsdfMap::kObservedWeight &&
            std::abs(static_cast<int>(TsdfMap::word_distance(words[n]))) <= near)
          fn(b, n);
    });
  };
  std::size_t total = 0;
  each([&](std::int32_t, int) { ++total; });
  const std::size_t step = total / kMostPoints + 1;
  std::size_t seen = 0, points = 0, coloured = 0;
  each([&](std::int32_t b, int n) {
    if (seen++ % step != 0 || points == kMostPoints) return;
    const BlockCoord at = map.block_coord(b);
    points_[points++] = (map.voxel_size() *
                         Vec3(8 * at.x + (n >> 6), 8 * at.y + ((n >> 3) & 7), 8 * at.z + (n & 7)))
                            .cast<float>();
    const std::uint32_t c = map.block_colours(b)[n];
    if (c >> 24U == 0) return;
    colours_[coloured++] = {static_cast<std::uint8_t>(c & 0xffU),
                            static_cast<std::uint8_t>((c >> 8U) & 0xffU),
                            static_cast<std::uint8_t>((c >> 16U) & 0xffU)};
  });
  object.summary = summarise({points_.data(), points}, {colours_.data(), coloured}, scratch_);
  stats_.work += 4 * points;
}

}  // namespace perception
