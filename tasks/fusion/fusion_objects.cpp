#include "tasks/fusion/fusion_objects.hpp"

#include <stdexcept>
#include <string>

namespace tasks {

using perception::TouchAnswer;

namespace {

// Frames that a mark waits for a claimed one.
constexpr int kMarkWaits = 15;

perception::Material material_of(const ObjectMaterial& m) noexcept {
  return {static_cast<float>(m.stiffness_scale), static_cast<float>(m.friction_static),
          static_cast<float>(m.friction_dynamic), static_cast<float>(m.texture_amplitude_m),
          static_cast<float>(m.texture_period_m)};
}

}  // namespace

FusionObjects::FusionObjects(rt::NonRealtime& nrt, const FusionConfig& config,
                             const perception::Intrinsics& camera, Palette& palette)
    : view_step_(config.view_step),
      objects_(nrt, camera.width, camera.height, config.objects),
      shown_((camera.width - 1) / config.view_step + 1,
             (camera.height - 1) / config.view_step + 1) {
  for (std::size_t id = 1; id <= perception::ObjectMap::kMost; ++id) {
    palette[id] = material_of(config.object_material);
    slot_of_label_[id] = static_cast<std::uint8_t>(id);
  }
  std::array<bool, perception::ObjectMap::kMost + 1> named{};
  for (const MaterialOfObject& m : config.object_materials) {
    const auto id = static_cast<std::size_t>(m.id);
    if (named[id]) {
      throw std::invalid_argument("fusion.objects.material: id = " + std::to_string(m.id) +
                                  " twice; each of 1 to 15 at most once");
    }
    named[id] = true;
    palette[id] = material_of(m.material);
  }
}

void FusionObjects::begin(const HapticState& hand) noexcept {
  drawn_ = false;
  if (hand.mark_seq == mark_seq_) return;
  mark_seq_ = hand.mark_seq;
  mark_W_ = hand.p_mark_W;
  mark_waited_ = 0;
}

void FusionObjects::follow(const perception::FrameView& seen, perception::TsdfMap& map,
                           const Pose& X_WC, bool draw, FusionOut& out) noexcept {
  if (!out.integrated) {
    if (mark_W_ && ++mark_waited_ > kMarkWaits) answer(TouchAnswer::kNotTracked, 0);
    if (given_ && ++given_waited_ > kMarkWaits) given_.reset();
    return;
  }
  segment(seen, map, X_WC);
  objects_.fuse(map);
  drawn_ = draw && objects_.count() > 0;
  if (drawn_) objects_.draw(seen, map, X_WC, view_step_, shown_.view());
  out.segmentation = objects_.stats();
  out.work += out.segmentation.work;
  if (mark_W_ && out.segmentation.answer != TouchAnswer::kNone)
    answer(out.segmentation.answer, out.segmentation.touched);
}

// Whoever gave an object sees it in the list, or does not: there is no other answer.
void FusionObjects::segment(const perception::FrameView& seen, const perception::TsdfMap& map,
                            const Pose& X_WC) noexcept {
  if (!given_ || mark_W_) return objects_.segment(seen, map, X_WC, mark_W_);
  objects_.segment_given(seen, map, X_WC, *given_);
  given_.reset();
}

void FusionObjects::edit(perception::TsdfMap& map, const perception::GivenObject* given,
                         std::uint16_t drop) noexcept {
  if (given != nullptr) {
    given_ = *given;
    given_waited_ = 0;
  }
  if (drop == 0) return;
  for (const perception::MapObject& o : objects_.objects()) {
    if (o.id == 0 || static_cast<std::uint16_t>(o.serial) != drop) continue;
    objects_.forget(map, o.id);
    return;
  }
}

void FusionObjects::answer(TouchAnswer answer, std::uint8_t id) noexcept {
  mark_W_.reset();
  answered_seq_ = mark_seq_;
  answer_ = answer;
  answered_id_ = id;
}

void FusionObjects::write(rt::Time seen, FusionOut& out) noexcept {
  if (out.objects == nullptr) return;
  if (!out.camera_written && answered_seq_ == published_answer_) return;
  ObjectList& list = *out.objects;
  list.size = 0;
  for (const perception::MapObject& o : objects_.objects()) {
    if (o.id == 0) continue;
    const perception::ObjectSummary& s = o.summary;
    list.entries[static_cast<std::size_t>(list.size++)] = {
        o.id, o.serial, o.seen, s.points > 0, s.X_FO, s.extent_m, s.centre_m, s.colour};
  }
  list.seq = ++list_seq_;
  list.exposure = seen;
  list.mark_seq = published_answer_ = answered_seq_;
  list.answer = answer_;
  list.touched = answered_id_;
  out.objects_written = true;
}

}  // namespace tasks
