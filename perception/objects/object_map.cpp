#include "perception/objects/object_map.hpp"

#include <algorithm>
#include <cmath>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

constexpr int kMostHalfPixels = 36000;  // of a touch's window

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

ObjectMap::ObjectMap(rt::NonRealtime&, int max_width, int max_height, const ObjectsConfig& config)
    : config_(config),
      max_width_(max_width),
      max_height_(max_height),
      segmenter_(max_width, max_height),
      reduced_(max_width, max_height),
      image_(max_width, max_height),
      voting_(max_width, max_height),
      settled_(max_width, max_height),
      outlines_(max_width, max_height),
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

// A frame begins. False: it can say nothing of objects.
bool ObjectMap::ready(const FrameView& frame) noexcept {
  stats_ = {};
  painted_ = false;
  scale_ = 1;
  wipe_known();
  const Intrinsics& k = frame.intrinsics;
  if (frame.colour.data == nullptr || k.width > max_width_ || k.height > max_height_) return false;
  image_.reshape(k.width, k.height);
  voting_.reshape(k.width, k.height);
  known_.reshape(k.width, k.height);
  return true;
}

void ObjectMap::segment(const FrameView& frame, const MapView& map, const Pose& X_WC,
                        const std::optional<Vec3>& touched_W) noexcept {
  if (!ready(frame) || (!touched_W && count() == 0)) return;
  begin_image();
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  const Look look{frame, map, X_WC, X_CW, CameraBoxes(frame.intrinsics, X_CW), MapReader(map)};
  if (touched_W)
    answer_touch(look, *touched_W);
  else
    follow_next(look);
}

void ObjectMap::segment_given(const FrameView& frame, const MapView& map, const Pose& X_WC,
                              const GivenObject& given) noexcept {
  if (!ready(frame)) return;
  begin_image();
  const Pose X_CW = X_WC.inverse(Eigen::Isometry);
  answer_given({frame, map, X_WC, X_CW, CameraBoxes(frame.intrinsics, X_CW), MapReader(map)},
               given);
}

void ObjectMap::begin_image() noexcept {
  if (++frame_ == 0) frame_ = 1;
  std::fill_n(image_.data(), image_.width() * image_.height(), std::uint8_t{0});
  painted_ = true;
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
  MapObject* place = free_place(look, p_W);
  if (place == nullptr) return;
  if (!touch_at(look, p_W, id_of(*place), {0, 0, -1, -1})) {
    stats_.answer = segmenter_.named_support() ? TouchAnswer::kSupport : TouchAnswer::kNoReading;
    return;
  }
  name(*place, p_W);
}

// Where a new object may be noted; null, and answered: it is known already, or there is no room.
MapObject* ObjectMap::free_place(const Look& look, const Vec3& p_W) noexcept {
  if (const std::uint8_t known = look.reader.label(p_W); known != 0) {
    stats_.answer = TouchAnswer::kKnown;
    stats_.touched = known;
    return nullptr;
  }
  const auto free =
      std::find_if(objects_.begin(), objects_.end(), [](const auto& o) { return o.id == 0; });
  if (free != objects_.end()) return &*free;
  stats_.answer = TouchAnswer::kNoRoom;
  return nullptr;
}

// Its mask is painted.
void ObjectMap::name(MapObject& place, const Vec3& p_W) noexcept {
  const std::uint8_t id = id_of(place);
  place = {};
  place.id = id;
  place.serial = ++serial_;
  place.seen = true;
  place.touched_W = p_W;
  place.usual_seed = 0.25F * static_cast<float>(stats_.mask_pixels);
  stats_.touched = stats_.followed = id;
}

// Segments at the point and paints the mask. The window is about the point, or about what is known
// of the object.
bool ObjectMap::touch_at(const Look& look, const Vec3& p_W, std::uint8_t id,
                         const SeedBox& known) noexcept {
  int u = 0, v = 0;
  if (check(look, p_W, u, v) != TouchAnswer::kObject) return false;
  const Intrinsics& k = look.frame.intrinsics;
  const int step = 2 * scale_;  // pixels to one of the pieces' resolution
  const double reach = std::min(config_.touch_window_m * k.fx / (step * (look.X_CW * p_W).z()),
                                0.5 * std::sqrt(static_cast<double>(kMostHalfPixels)));
  const int half = std::max(32, static_cast<int>(reach)), x = u / step, y = v / step;
  HalfWindow win;
  win.u0 = std::max(0, x - half), win.v0 = std::max(0, y - half);
  win.width = std::min(k.width / step, x + half) - win.u0;
  win.height = std::min(k.height / step, y + half) - win.v0;
  if (known.u1 >= known.u0) {
    constexpr int kMargin = 16;  // at the pieces' resolution
    const int u1 = std::min(win.u0 + win.width, std::max(known.u1, u) / step + kMargin);
    const int v1 = std::min(win.v0 + win.height, std::max(known.v1, v) / step + kMargin);
    win.u0 = std::max(win.u0, std::min(known.u0, u) / step - kMargin), win.width = u1 - win.u0;
    win.v0 = std::max(win.v0, std::min(known.v0, v) / step - kMargin), win.height = v1 - win.v0;
  }
  if (win.width < 2 || win.height < 2) return false;
  const Work work = at_scale(
      look, {2 * win.u0, 2 * win.v0, 2 * (win.u0 + win.width) - 1, 2 * (win.v0 + win.height) - 1});
  segmenter_.set_frame(work.colour, work.depth_mm, work.k, 1.0F, win);
  stats_.work += static_cast<std::uint64_t>(8 * win.width * win.height);
  if (!segmenter_.touch(u / scale_, v / scale_) || segmenter_.named_support()) return false;
  stats_.mask_pixels = paint(look, id);
  return true;
}

}  // namespace perception
