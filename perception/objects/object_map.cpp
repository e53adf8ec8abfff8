#include "perception/objects/object_map.hpp"

#include <algorithm>
#include <cmath>

#include "perception/tsdf/map_reader.hpp"

namespace perception {
namespace {

constexpr int kLeastSeed = 12;            // half-resolution pixels
constexpr int kMostHalfPixels = 36000;    // of a touch's window
constexpr int kWindowHalfPixels = 12000;  // of a window that others may join ...
constexpr int kWindowMore = 1500;         // ... and for each of them
constexpr int kSureWeight = 3;            // of a background that contradicts a mask

bool reads(std::uint16_t mm) noexcept { return mm != 0 && mm != 65535; }

}  // namespace

std::string_view text_of(TouchAnswer answer) noexcept {
  switch (answer) {
    case TouchAnswer::kNone:
      return "no touch";
    case TouchAnswer::kObject:
      return "a new object";
    case TouchAnswer::kKnown:
      return "an object that is followed already";
    case TouchAnswer::kOutOfView:
      return "refused: the touched point is out of the camera's view";
    case TouchAnswer::kHidden:
      return "refused: the touched point is hidden from the camera";
    case TouchAnswer::kNoReading:
      return "refused: no depth at the touched point";
    case TouchAnswer::kMoved:
      return "refused: the touched surface is no longer there";
    case TouchAnswer::kSupport:
      return "refused: the touched surface is what things stand on";
    case TouchAnswer::kNoRoom:
      return "refused: as many objects as there can be";
    case TouchAnswer::kNotTracked:
      return "refused: the camera does not know where it is";
  }
  return "";
}

void ObjectsConfig::describe(config::Section& s) {
  s.flag("enabled", enabled, "a mark on a surface names an object, which is then followed")
      .number("touch_window_m", touch_window_m, 0.1, 3,
              "half edge of the part of the image in which a touch is answered")
      .number("agree_m", agree_m, 0.005, 0.2, "distance of a touched point to the reading there")
      .integer("young_frames", young_frames, 1, 100,
               "masks of a new object that start from the touched point")
      .integer("settled_masks", settled_masks, 1, 100,
               "masks of a new object that are believed whatever they say")
      .number("agreement_drop", agreement_drop, 0.02, 1,
              "below the usual IoU of mask and fused object: the mask is held back")
      .integer("held_masks", held_masks, 1, 100, "the n-th such mask in a row is believed")
      .number("most_growth", most_growth, 1.2, 10, "of a mask against the fused object")
      .integer("gone_frames", gone_frames, 2, 1000,
               "frames of an empty place after which an object is forgotten")
      .integer("summary_period", summary_period, 1, 100, "masks between two summaries");
}

struct ObjectMap::Look {
  const FrameView& frame;
  const TsdfMap& map;
  const Pose& X_WC;
  Pose X_CW;
  CameraBoxes boxes;
  mutable MapReader reader;

  [[nodiscard]] LabelVoxel voted(int u, int v) const noexcept {
    const std::uint16_t mm = frame.depth_mm.at(u, v);
    if (!reads(mm)) return {};
    return reader.voted(X_WC * frame.intrinsics.unproject(u, v, 1e-3 * mm));
  }
  [[nodiscard]] std::uint8_t label(int u, int v) const noexcept { return voted(u, v).label; }
};

ObjectMap::ObjectMap(rt::NonRealtime&, int max_width, int max_height, const ObjectsConfig& config)
    : config_(config),
      max_width_(max_width),
      max_height_(max_height),
      segmenter_(max_width, max_height),
      image_(max_width, max_height),
      voting_(max_width, max_height),
      known_(max_width, max_height),
      points_(kMostPoints),
      colours_(kMostPoints),
      scratch_(kMostPoints) {}

int ObjectMap::count() const noexcept {
  return static_cast<int>(
      std::count_if(objects_.begin(), objects_.end(), [](const auto& o) { return o.id != 0; }));
}

void ObjectMap::clear() noexcept {
  objects_ = {};
  painted_ = false;
}

void ObjectMap::forget(TsdfMap& map, std::uint8_t id) noexcept {
  if (id == 0 || id > kMost) return;
  objects_[id - 1U] = {};
  map.forget_label(id);
}

void ObjectMap::segment(const FrameView& frame, const TsdfMap& map, const Pose& X_WC,
                        const std::optional<Vec3>& touched_W) noexcept {
  stats_ = {};
  painted_ = false;
  wipe_known();
  const Intrinsics& k = frame.intrinsics;
  if (frame.colour.data == nullptr || k.width > max_width_ || k.height > max_height_) return;
  if (!touched_W && count() == 0) return;
  image_.reshape(k.width, k.height);
  voting_.reshape(k.width, k.height);
  known_.reshape(k.width, k.height);
  if (++frame_ == 0) frame_ = 1;
  std::fill_n(image_.data(), k.width * k.height, std::uint8_t{0});
  painted_ = true;
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const Look look{frame, map, X_WC, X_CW, CameraBoxes(k, X_CW), MapReader(map)};
  if (touched_W)
    answer_touch(look, *touched_W);
  else
    follow_next(look);
}

// ---------------------------------------------------------------- a touch

TouchAnswer ObjectMap::check(const Look& look, const Vec3& p_W, int& u, int& v) const noexcept {
  if (!p_W.allFinite()) return TouchAnswer::kOutOfView;
  const Intrinsics& k = look.frame.intrinsics;
  const Vec3 p_C = look.X_CW * p_W;
  if (p_C.z() < 0.05) return TouchAnswer::kOutOfView;
  const double x = k.fx * p_C.x() / p_C.z() + k.cx, y = k.fy * p_C.y() / p_C.z() + k.cy;
  if (!(x >= 0 && y >= 0 && x < k.width - 0.5 && y < k.height - 0.5))
    return TouchAnswer::kOutOfView;
  u = static_cast<int>(x + 0.5), v = static_cast<int>(y + 0.5);
  // The reading next to the point's own depth, among the pixels beside it.
  double off = 1e9;
  for (int b = std::max(0, v - 1); b <= std::min(k.height - 1, v + 1); ++b)
    for (int a = std::max(0, u - 1); a <= std::min(k.width - 1, u + 1); ++a) {
      const std::uint16_t mm = look.frame.depth_mm.at(a, b);
      const double d = 1e-3 * mm - p_C.z();
      if (reads(mm) && std::abs(d) < std::abs(off)) off = d;
    }
  if (off > 1e8) return TouchAnswer::kNoReading;
  if (off < -config_.agree_m) return TouchAnswer::kHidden;
  return off > config_.agree_m ? TouchAnswer::kMoved : TouchAnswer::kObject;
}

void ObjectMap::answer_touch(const Look& look, const Vec3& p_W) noexcept {
  for (const MapObject& o : objects_)
    if (o.id != 0) turn_into(project(look, o.id), 0, kNoVote);
  int u = 0, v = 0;
  stats_.answer = check(look, p_W, u, v);
  if (stats_.answer != TouchAnswer::kObject) return;
  if (const std::uint8_t known = look.reader.label(p_W); known != 0) {
    stats_.answer = TouchAnswer::kKnown;
    stats_.touched = known;
    return;
  }
  const auto free =
      std::find_if(objects_.begin(), objects_.end(), [](const auto& o) { return o.id == 0; });
  if (free == objects_.end()) {
    stats_.answer = TouchAnswer::kNoRoom;
    return;
  }
  const auto id = static_cast<std::uint8_t>(free - objects_.begin() + 1);
  if (!touch_at(look, p_W, id, {0, 0, -1, -1})) {
    stats_.answer = segmenter_.named_support() ? TouchAnswer::kSupport : TouchAnswer::kNoReading;
    return;
  }
  *free = {};
  free->id = id;
  free->serial = ++serial_;
  free->seen = true;
  free->touched_W = p_W;
  stats_.touched = stats_.followed = id;
}

// Segments at the point and paints the mask. The window is about the point, or about what is known of
// the object.
bool ObjectMap::touch_at(const Look& look, const Vec3& p_W, std::uint8_t id,
                         const SeedBox& known) noexcept {
  int u = 0, v = 0;
  if (check(look, p_W, u, v) != TouchAnswer::kObject) return false;
  const Intrinsics& k = look.frame.intrinsics;
  const double reach = std::min(0.5 * config_.touch_window_m * k.fx / (look.X_CW * p_W).z(),
                                0.5 * std::sqrt(static_cast<double>(kMostHalfPixels)));
  const int half = std::max(32, static_cast<int>(reach));
  HalfWindow win;
  win.u0 = std::max(0, u / 2 - half), win.v0 = std::max(0, v / 2 - half);
  win.width = std::min(k.width / 2, u / 2 + half) - win.u0;
  win.height = std::min(k.height / 2, v / 2 + half) - win.v0;
  if (known.u1 >= known.u0) {
    constexpr int kMargin = 16;  // half-resolution pixels
    const int u1 = std::min(win.u0 + win.width, std::max(known.u1, u) / 2 + kMargin);
    const int v1 = std::min(win.v0 + win.height, std::max(known.v1, v) / 2 + kMargin);
    win.u0 = std::max(win.u0, std::min(known.u0, u) / 2 - kMargin), win.width = u1 - win.u0;
    win.v0 = std::max(win.v0, std::min(known.v0, v) / 2 - kMargin), win.height = v1 - win.v0;
  }
  if (win.width < 2 || win.height < 2) return false;
  segmenter_.set_frame(look.frame.colour, look.frame.depth_mm, k, 1.0F, win);
  stats_.work += static_cast<std::uint64_t>(8 * win.width * win.height);
  if (!segmenter_.touch(u, v) || segmenter_.named_support()) return false;
  stats_.mask_pixels = paint(look, id);
  return true;
}

// ---------------------------------------------------------------- following

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
  for (const MapObject& o : objects_)
    if (o.id != 0 && &o != next) turn_into(box[o.id - 1U], 0, kNoVote);
  // Those whose place the same window can hold.
  SeedBox window = box[next->id - 1U];
  const int limit = kWindowHalfPixels + kWindowMore * (count() - 1);
  std::uint32_t near = 0;
  for (const MapObject& o : objects_) {
    if (o.id == 0 || &o == next || young(*next) || young(o) || !visible(o)) continue;
    const SeedBox& b = box[o.id - 1U];
    const SeedBox both{std::min(window.u0, b.u0), std::min(window.v0, b.v0),
                       std::max(window.u1, b.u1), std::max(window.v1, b.v1)};
    if (((both.u1 - both.u0) / 2 + 24) * ((both.v1 - both.v0) / 2 + 24) > limit) continue;
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
  // A few bad masks of a young object would name others for good: the touched point still names it.
  if (young && touch_at(look, object.touched_W, object.id, known)) {
    object.seen = true;
  } else if (turn.planted >= kLeastSeed) {
    const Intrinsics& k = look.frame.intrinsics;
    const SeedBox& window = shared != nullptr ? *shared : turn.seed_box;
    stats_.work +=
        static_cast<std::uint64_t>(2 * (window.u1 - window.u0) * (window.v1 - window.v0));
    object.seen = segmenter_.follow(look.frame.colour, look.frame.depth_mm, k, 1.0F, known_.view(),
                                    window, object.id);
    if (object.seen) stats_.mask_pixels = paint(look, object.id);
  }
  if (object.seen && !young) stats_.with_mask |= 1U << object.id;
  watch_place(look, object, turn.planted);
}

// In the window that another object's turn has made ready.
void ObjectMap::follow_also(const Look& look, MapObject& object, const SeedBox& known) noexcept {
  if (!stands_here(look, object)) return;
  const Turn& turn = find_known(look, object.id, known);
  if (turn.planted < kLeastSeed || !segmenter_.also(known_.view(), object.id)) {
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

// Is there nothing where the object was when it was last summarised? Looks at 27 points of its box: each
// must be in view, with a reading behind it. A flat thing never counts as gone: there the votes decide.
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

// Notes, at even pixels, what the readings lie on, as far round the object as a mask may well be wrong.
ObjectMap::Turn& ObjectMap::find_known(const Look& look, std::uint8_t id, SeedBox within) noexcept {
  Turn& turn = turns_[static_cast<std::size_t>(turn_count_++)];
  turn = {id, 0, {1 << 20, 1 << 20, -1, -1}};
  if (within.u1 < within.u0) return turn;
  within = grown(within);
  SeedBox& seed = turn.seed_box;
  for (int v = (within.v0 + 1) & ~1; v <= within.v1; v += 2)
    for (int u = (within.u0 + 1) & ~1; u <= within.u1; u += 2) {
      const LabelVoxel known = look.voted(u, v);
      known_.at(u, v) = known.label != 0              ? known.label
                        : known.weight >= kSureWeight ? kSureOther
                                                      : std::uint8_t{0};
      if (known.label != id) continue;
      seed.u0 = std::min(seed.u0, u), seed.u1 = std::max(seed.u1, u);
      seed.v0 = std::min(seed.v0, v), seed.v1 = std::max(seed.v1, v);
      ++turn.planted;
    }
  within_ = {std::min(within_.u0, within.u0), std::min(within_.v0, within.v0),
             std::max(within_.u1, within.u1), std::max(within_.v1, within.v1)};
  stats_.work += static_cast<std::uint64_t>((within.u1 - within.u0) * (within.v1 - within.v0) / 4);
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
  int pixels = 0;
  for (int v = box.v0; v < box.v0 + box.height; ++v)
    for (int u = box.u0; u < box.u0 + box.width; ++u) {
      if (!segmenter_.in(u, v)) continue;
      std::uint8_t& said = image_.at(u, v);
      if (said == kNoVote) {
        const std::uint8_t fused = look.label(u, v);
        if (fused != 0 && fused != id) continue;
      }
      said = id;
      ++pixels;
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
