// Masks into the map: which of them are believed, what of them votes, what became of the objects.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/geometry/no_colour.hpp"
#include "perception/objects/object_map.hpp"

namespace perception {

void ObjectMap::fuse(TsdfMap& map) noexcept {
  if (!painted_) return;
  const bool fresh = stats_.answer == TouchAnswer::kObject;
  for (int n = 0; n < turn_count_; ++n) {
    const Turn& turn = turns_[static_cast<std::size_t>(n)];
    judge(objects_[turn.id - 1U], turn);
  }
  std::copy_n(image_.data(), image_.width() * image_.height(), voting_.data());
  if (fresh) leave_out_rim(stats_.touched);
  for (int n = 0; n < turn_count_; ++n) leave_out_rim(turns_[static_cast<std::size_t>(n)].id);
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
    bool mine = stats_.answer == TouchAnswer::kObject && o.id == stats_.touched;
    for (int n = 0; n < turn_count_; ++n) mine |= turns_[static_cast<std::size_t>(n)].id == o.id;
    if (mine && o.seen) ++o.masks;
    const bool left = ((present >> o.id) & 1U) != 0;
    const bool young = o.masks < config_.young_frames;
    if (o.gone || (!left && (!young || o.unseen > config_.young_frames))) {
      if (left) map.forget_label(o.id);
      o = {};
      continue;
    }
    // By turns: not all of those that have a mask in every frame in the same one.
    const bool due = o.masks == 1 || (o.masks + o.id) % config_.summary_period == 0;
    if (mine && o.seen && due) summarise_object(map, o);
  }
}

// Sets what is usual of the object, or takes a mask that is not believed out of the image.
void ObjectMap::judge(MapObject& object, const Turn& turn) noexcept {
  int mask = 0, both = 0, against = 0;
  const SeedBox box = shown(object.id);
  const int step = known_step(), each = scale_ * scale_;
  for (int v = known_from(box.v0); v <= box.v1; v += step) {
    const std::uint8_t *said = &image_.at(0, v), *known = &known_.at(0, v);
    for (int u = known_from(box.u0); u <= box.u1; u += step) {
      if (said[u] != object.id) continue;
      mask += each;
      both += known[u] == object.id ? each : 0;
      against += known[u] != object.id && known[u] != 0 ? each : 0;
    }
  }
  const float agreement =
      static_cast<float>(both) / static_cast<float>(std::max(1, turn.planted + against));
  const bool settled = object.masks >= config_.settled_masks;
  const bool there = static_cast<float>(turn.planted) > kStillThere * object.usual_seed;
  const bool young = object.masks < config_.young_frames;
  const bool odd = !young && (mask > config_.most_growth * turn.planted ||
                              mask * config_.most_growth < turn.planted);
  bool withheld = false;
  object.seen = object.seen && mask > 0;
  if (settled && mask > 0) {
    const bool agrees = static_cast<double>(agreement) >=
                        static_cast<double>(object.usual_agreement) - config_.agreement_drop;
    object.held = agrees && !odd ? 0 : object.held + 1;
    withheld = odd || (object.held > 0 && object.held < config_.held_masks);
  } else {
    withheld = settled && there;  // nothing is seen of it where it still is
  }
  if (withheld) {
    // Where hardly anything is left of an established object, what shows in its place votes.
    replace(object.id, there || !odd ? kNoVote : std::uint8_t{0});
    if (there) turn_into(turn.seed_box, 0, kNoVote);
    object.seen = false;
  } else if (object.seen) {
    const float share = object.masks <= 1 ? 1.0F : 0.2F;
    object.usual_agreement += share * (agreement - object.usual_agreement);
    object.usual_seed += share * (static_cast<float>(turn.planted) - object.usual_seed);
  }
  object.unseen = object.seen ? 0 : object.unseen + 1;
  if (object.id != stats_.followed) return;
  stats_.agreement = agreement;
  stats_.withheld = withheld;
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

// Pixels on both sides of the mask's outline do not vote, unless the mask consists of little else.
void ObjectMap::leave_out_rim(std::uint8_t id) noexcept {
  const int w = image_.width(), h = image_.height(), s = scale_;
  const SeedBox box = shown(id);
  int inner = 0, all = 0;
  for (int v = std::max(0, box.v0 - s); v <= std::min(h - 1, box.v1 + s); ++v) {
    const std::uint8_t* row = &image_.at(0, v);
    const std::uint8_t *up = &image_.at(0, std::max(v - s, 0)),
                       *down = &image_.at(0, std::min(v + s, h - 1));
    std::uint8_t* out = &voting_.at(0, v);
    for (int u = std::max(0, box.u0 - s); u <= std::min(w - 1, box.u1 + s); ++u) {
      const bool in = row[u] == id;
      const bool left = row[std::max(u - s, 0)] == id, right = row[std::min(u + s, w - 1)] == id;
      const bool rim = left != in || right != in || (up[u] == id) != in || (down[u] == id) != in;
      if (rim) out[u] = kNoVote;
      all += in ? 1 : 0;
      inner += in && !rim ? 1 : 0;
    }
  }
  if (4 * inner >= all) return;
  for (int v = std::max(0, box.v0 - s); v <= std::min(h - 1, box.v1 + s); ++v)
    for (int u = std::max(0, box.u0 - s); u <= std::min(w - 1, box.u1 + s); ++u)
      if (image_.at(u, v) == id || image_.at(u, v) == 0) voting_.at(u, v) = image_.at(u, v);
}

// Of the labelled nodes next to the surface, thinned evenly where there are too many.
void ObjectMap::summarise_object(const MapView& map, MapObject& object) noexcept {
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
    if (coloured_readings_of(c) > 0) colours_[coloured++] = colour_of(c);
  });
  object.summary = summarise({points_.data(), points}, {colours_.data(), coloured}, scratch_);
  stats_.work += 4 * points;
}

}  // namespace perception
