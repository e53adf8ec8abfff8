// Following: whose turn it is, what the map shows of it, what the image says.
#include <algorithm>
#include <cmath>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

constexpr int kLeastSeed = 12;           // half-resolution pixels
constexpr int kWindowHalfPixels = 6000;  // of a window that others may join ...
constexpr int kWindowMore = 1000;        // ... and for each of them
constexpr int kSureBackground = 3;       // of a background that contradicts a mask
constexpr int kMargin_px = 48;           // of a window beyond what is known, both sides together
constexpr int kFullWindow = 5000;        // half-resolution pixels that are looked at in full

int half_pixels(int width_px, int height_px) noexcept {
  return (width_px + kMargin_px) / 2 * ((height_px + kMargin_px) / 2);
}

// A frame's cost is bounded, and a voxel covers several pixels of what is that near.
int scale_for(const MapObject& object) noexcept {
  if (object.window > 3 * kFullWindow) return 4;
  return object.window > kFullWindow ? 2 : 1;
}

}  // namespace

void ObjectMap::follow_next(const Look& look) noexcept {
  std::array<SeedBox, kMost> box;
  for (const MapObject& o : objects_)
    if (o.id != 0) box[o.id - 1U] = project(look, o.id);
  const auto young = [&](const MapObject& o) { return o.masks < config_.young_frames; };
  const auto visible = [&](const MapObject& o) { return box[o.id - 1U].u1 >= box[o.id - 1U].u0; };
  // The next one in turn that the image can show; one that it can not has nothing to be followed.
  MapObject* next = nullptr;
  for (int n = 1; n <= kMost && next == nullptr; ++n) {
    MapObject& o = objects_[static_cast<std::size_t>((turn_ + n) % kMost)];
    if (o.id != 0 && (visible(o) || young(o))) next = &o;
  }
  if (next == nullptr) return;
  turn_ = next->id - 1;
  stats_.followed = next->id;
  scale_ = scale_for(*next);
  for (const MapObject& o : objects_)
    if (o.id != 0 && &o != next) turn_into(box[o.id - 1U], 0, kNoVote);
  // Those whose place the same window can hold.
  SeedBox window = place_of(look, *next, box[next->id - 1U]);
  const int limit = scale_ * scale_ * (kWindowHalfPixels + kWindowMore * (count() - 1));
  const int margin = 24 * scale_;
  std::uint32_t near = 0;
  for (const MapObject& o : objects_) {
    if (o.id == 0 || &o == next || young(*next) || young(o) || !visible(o)) continue;
    if (scale_for(o) < scale_) continue;  // it would be seen too coarsely
    const SeedBox b = place_of(look, o, box[o.id - 1U]);
    const SeedBox both{std::min(window.u0, b.u0), std::min(window.v0, b.v0),
                       std::max(window.u1, b.u1), std::max(window.v1, b.v1)};
    if (((both.u1 - both.u0) / 2 + margin) * ((both.v1 - both.v0) / 2 + margin) > limit) continue;
    window = both;
    near |= 1U << o.id;
  }
  follow(look, *next, box[next->id - 1U], near != 0 ? &window : nullptr);
  if ((stats_.with_mask >> next->id & 1U) == 0) return;
  for (MapObject& o : objects_)
    if (o.id != 0 && (near >> o.id & 1U) != 0) follow_also(look, o, box[o.id - 1U]);
  // Round those that were found the image speaks of everything but of those that were not.
  for (const MapObject& o : objects_)
    if (o.id != 0 && (stats_.with_mask >> o.id & 1U) != 0) turn_into(box[o.id - 1U], kNoVote, 0);
  for (const MapObject& o : objects_)
    if (o.id != 0 && (stats_.with_mask >> o.id & 1U) == 0) turn_into(box[o.id - 1U], 0, kNoVote);
}

void ObjectMap::follow(const Look& look, MapObject& object, const SeedBox& known,
                       const SeedBox* shared) noexcept {
  const bool young = object.masks < config_.young_frames;
  const Turn& turn = find_known(look, object.id, known);
  object.seen = false;
  if (turn.planted > 0)
    object.window =
        half_pixels(turn.seed_box.u1 - turn.seed_box.u0, turn.seed_box.v1 - turn.seed_box.v0);
  // A few bad masks of a young object would name others for good: what was touched, or given, still
  // names it.
  if (young && (object.given ? given_at(look, object.id)
                             : touch_at(look, object.touched_W, object.id, known))) {
    object.seen = true;
  } else if (turn.planted >= kLeastSeed) {
    const SeedBox& full = shared != nullptr ? *shared : turn.seed_box;
    const SeedBox window{full.u0 / scale_, full.v0 / scale_, full.u1 / scale_, full.v1 / scale_};
    stats_.work +=
        static_cast<std::uint64_t>(2 * (window.u1 - window.u0) * (window.v1 - window.v0));
    constexpr int kMargin = 28;  // the segmenter's own and the rounding of its window
    const Work work = at_scale(
        look, {window.u0 - kMargin, window.v0 - kMargin, window.u1 + kMargin, window.v1 + kMargin});
    object.seen = segmenter_.follow(work.colour, work.depth_mm, work.k, 1.0F,
                                    {known_.view(), object.id, scale_}, window);
    if (object.seen) stats_.mask_pixels = paint(look, object.id);
  }
  if (object.seen && !young) stats_.with_mask |= 1U << object.id;
  watch_place(look, object, turn.planted);
}

// In the window that another object's turn has made ready.
void ObjectMap::follow_also(const Look& look, MapObject& object, const SeedBox& known) noexcept {
  if (!stands_here(look, object)) return;
  const Turn& turn = find_known(look, object.id, known);
  if (turn.planted < kLeastSeed || !segmenter_.also({known_.view(), object.id, scale_})) {
    --turn_count_;  // what became of it is seen in its own turn
    return;
  }
  object.seen = true;
  stats_.mask_pixels += paint(look, object.id);
  stats_.with_mask |= 1U << object.id;
  watch_place(look, object, turn.planted);
}

// Its lowest corner is near the support that was taken out.
bool ObjectMap::stands_here(const Look& look, const MapObject& object) const noexcept {
  constexpr float kNear_m = 0.05F;
  const ObjectSummary& s = object.summary;
  if (s.points == 0 || !segmenter_.support().valid()) return false;
  float lowest = 1e9F;
  for (int n = 0; n < 8; ++n) {
    const Vec3 corner((n & 4) - 2, 2 * (n & 2) - 2, 4 * (n & 1) - 2);
    const Vec3 p_C = look.X_CW * (s.X_FO * (s.centre_m + 0.25 * s.extent_m.cwiseProduct(corner)));
    lowest = std::min(lowest, segmenter_.support().height(p_C.cast<float>()));
  }
  return std::abs(lowest) < kNear_m;
}

// Is there nothing where the object was when it was last summarised? Looks at 27 points of its box:
// each must be in view, with a reading behind it. A flat thing never counts as gone: there the
// votes decide.
bool ObjectMap::place_is_empty(const Look& look, const MapObject& object) const noexcept {
  const ObjectSummary& s = object.summary;
  if (s.points == 0) return false;
  constexpr double kReach = 0.35, kBehind_m = 0.005;  // of the extent, either side
  constexpr int kLeast = 22;                          // of 27
  const Intrinsics& k = look.frame.intrinsics;
  int empty = 0;
  for (int n = 0; n < 27; ++n) {
    const int i = n / 9, j = n / 3 % 3;
    const Vec3 at(i - 1, j - 1, n % 3 - 1);
    const Vec3 p_C = look.X_CW * (s.X_FO * (s.centre_m + kReach * s.extent_m.cwiseProduct(at)));
    if (p_C.z() < 0.05) continue;
    const double u = k.fx * p_C.x() / p_C.z() + k.cx, v = k.fy * p_C.y() / p_C.z() + k.cy;
    if (!(u >= 0 && v >= 0 && u < k.width - 0.5 && v < k.height - 0.5)) continue;
    const std::uint16_t mm =
        look.frame.depth_mm.at(static_cast<int>(u + 0.5), static_cast<int>(v + 0.5));
    empty += reads(mm) && 1e-3 * mm > p_C.z() + kBehind_m ? 1 : 0;
  }
  return empty >= kLeast;
}

void ObjectMap::watch_place(const Look& look, MapObject& object, int planted) noexcept {
  const bool missing = static_cast<float>(planted) <= kStillThere * object.usual_seed;
  if (!missing || !place_is_empty(look, object)) {
    object.empty_since = 0;
  } else if (object.empty_since == 0) {
    object.empty_since = frame_;
  } else {
    object.gone = frame_ - object.empty_since >= static_cast<std::uint32_t>(config_.gone_frames);
  }
}

// Pixels that the blocks with this label can fall on; u1 < u0: none.
ObjectMap::SeedBox ObjectMap::project(const Look& look, std::uint8_t id) const noexcept {
  SeedBox out{1 << 20, 1 << 20, -1, -1};
  const double voxel = look.map.voxel_size();
  look.map.for_each_label_block([&](std::int32_t b, std::uint32_t bits) {
    if (((bits >> id) & 1U) == 0) return;
    const BlockCoord at = look.map.block_coord(b);
    const BoxView box = look.boxes.view((at.x * 8 + 3.5) * voxel, (at.y * 8 + 3.5) * voxel,
                                        (at.z * 8 + 3.5) * voxel, static_cast<float>(4 * voxel));
    if (!box.visible) return;
    out.u0 = std::min(out.u0, box.u0), out.v0 = std::min(out.v0, box.v0);
    out.u1 = std::max(out.u1, box.u1), out.v1 = std::max(out.v1, box.v1);
  });
  return out;
}

// Of that, the part where it was when last summarised, slightly enlarged, because blocks reach far
// beyond it.
ObjectMap::SeedBox ObjectMap::place_of(const Look& look, const MapObject& object,
                                       const SeedBox& blocks) const noexcept {
  constexpr double kMoved_m = 0.03;
  const ObjectSummary& s = object.summary;
  if (s.points == 0) return blocks;
  const Intrinsics& k = look.frame.intrinsics;
  const Vec3 half = 0.5 * s.extent_m + Vec3::Constant(kMoved_m);
  Vec3 low(1e9, 1e9, 1), high(-1e9, -1e9, 1);
  for (int n = 0; n < 8; ++n) {
    const Vec3 corner((n & 1) != 0 ? 1 : -1, (n & 2) != 0 ? 1 : -1, (n & 4) != 0 ? 1 : -1);
    const Vec3 p_C = look.X_CW * (s.X_FO * (s.centre_m + half.cwiseProduct(corner)));
    if (p_C.z() < 0.05) return blocks;
    const Vec3 at(k.fx * p_C.x() / p_C.z() + k.cx, k.fy * p_C.y() / p_C.z() + k.cy, 1);
    low = low.cwiseMin(at), high = high.cwiseMax(at);
  }
  const auto pixel = [](double x) { return static_cast<int>(std::clamp(x, -1.0, 1e5)); };
  const SeedBox both{std::max(blocks.u0, pixel(low.x())), std::max(blocks.v0, pixel(low.y())),
                     std::min(blocks.u1, pixel(high.x())), std::min(blocks.v1, pixel(high.y()))};
  return both.u1 < both.u0 || both.v1 < both.v0 ? blocks : both;
}

// The input of the segmenter: the frame, or the part of it (in pixels of the reduced image) that is
// segmented.
ObjectMap::Work ObjectMap::at_scale(const Look& look, const SeedBox& part) noexcept {
  const FrameView& f = look.frame;
  if (scale_ == 1) return {f.colour, f.depth_mm, f.intrinsics};
  reduced_.set(f.colour, f.depth_mm, f.intrinsics, scale_, part.u0, part.v0, part.u1, part.v1);
  return {reduced_.colour(), reduced_.depth(), reduced_.intrinsics()};
}

// Notes what the readings lie on, as far round the object as a mask may well be wrong.
ObjectMap::Turn& ObjectMap::find_known(const Look& look, std::uint8_t id, SeedBox within) noexcept {
  Turn& turn = turns_[static_cast<std::size_t>(turn_count_++)];
  turn = {id, 0, {1 << 20, 1 << 20, -1, -1}};
  if (within.u1 < within.u0) return turn;
  within = grown(within);
  SeedBox& seed = turn.seed_box;
  const int step = known_step(), each = scale_ * scale_;
  const auto ask = [&](int u, int v) {
    const LabelVoxel known = look.voted(u, v);
    known_.at(u, v) = known.label != 0                  ? known.label
                      : known.weight >= kSureBackground ? kSureOther
                                                        : std::uint8_t{0};
  };
  // Near pixels are first looked up at every second position. Between two that agree the label is
  // the same.
  const int apart = scale_ > 1 ? 2 * step : step;
  const auto on_grid = [apart](int u, int v) { return u % apart == 0 && v % apart == 0; };
  const auto agree = [&](int u, int v) {
    const int u0 = u - u % apart, u1 = u % apart == 0 ? u0 : u0 + apart;
    const int v0 = v - v % apart, v1 = v % apart == 0 ? v0 : v0 + apart;
    if (u0 < within.u0 || v0 < within.v0 || u1 > within.u1 || v1 > within.v1) return false;
    const std::uint8_t first = known_.at(u0, v0);
    if (known_.at(u1, v0) != first || known_.at(u0, v1) != first || known_.at(u1, v1) != first)
      return false;
    known_.at(u, v) = first;
    return true;
  };
  for (int v = known_from(within.v0); v <= within.v1; v += step)
    for (int u = known_from(within.u0); u <= within.u1; u += step)
      if (on_grid(u, v)) ask(u, v);
  for (int v = known_from(within.v0); v <= within.v1; v += step)
    for (int u = known_from(within.u0); u <= within.u1; u += step) {
      if (!on_grid(u, v) && !agree(u, v)) ask(u, v);
      if (known_.at(u, v) != id) continue;
      seed.u0 = std::min(seed.u0, u), seed.u1 = std::max(seed.u1, u);
      seed.v0 = std::min(seed.v0, v), seed.v1 = std::max(seed.v1, v);
      turn.planted += each;
    }
  within_ = {std::min(within_.u0, within.u0), std::min(within_.v0, within.v0),
             std::max(within_.u1, within.u1), std::max(within_.v1, within.v1)};
  stats_.work +=
      static_cast<std::uint64_t>((within.u1 - within.u0) * (within.v1 - within.v0) / (step * step));
  return turn;
}

void ObjectMap::wipe_known() noexcept {
  for (int v = within_.v0; v <= within_.v1; ++v)
    std::fill_n(&known_.at(within_.u0, v), within_.u1 - within_.u0 + 1, std::uint8_t{0});
  within_ = {1 << 20, 1 << 20, -1, -1};
  turn_count_ = 0;
}

// The segmenter's mask, but not over what the map gives to another object.
int ObjectMap::paint(const Look& look, std::uint8_t id) noexcept {
  const auto& box = segmenter_.box();
  const int s = scale_;
  int pixels = 0;
  for (int y = box.v0; y < box.v0 + box.height; ++y)
    for (int x = box.u0; x < box.u0 + box.width; ++x) {
      if (!segmenter_.in(x, y)) continue;
      for (int v = s * y; v < s * (y + 1); ++v)
        for (int u = s * x; u < s * (x + 1); ++u) {
          std::uint8_t& said = image_.at(u, v);
          if (said == kNoVote) {
            const std::uint8_t fused = look.label(u, v);
            if (fused != 0 && fused != id) continue;
          }
          said = id;
          ++pixels;
        }
    }
  return pixels;
}

ObjectMap::SeedBox ObjectMap::grown(const SeedBox& box) const noexcept {
  return {std::max(0, box.u0 - kOthersMargin_px), std::max(0, box.v0 - kOthersMargin_px),
          std::min(image_.width() - 1, box.u1 + kOthersMargin_px),
          std::min(image_.height() - 1, box.v1 + kOthersMargin_px)};
}

void ObjectMap::turn_into(const SeedBox& box, std::uint8_t from, std::uint8_t to) noexcept {
  if (box.u1 < box.u0) return;
  const SeedBox b = grown(box);
  for (int v = b.v0; v <= b.v1; ++v) {
    std::uint8_t* row = &image_.at(0, v);
    for (int u = b.u0; u <= b.u1; ++u) row[u] = row[u] == from ? to : row[u];
  }
}

}  // namespace perception
