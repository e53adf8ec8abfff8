// Objects in the fusion task: a mark on a surface names one, each claimed frame follows one, the list is
// published. Nothing of this exists unless [fusion.objects] enabled says so.
#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "tasks/fusion/fusion_task.hpp"

namespace tasks {

using perception::TouchAnswer;

namespace {

// Frames that a mark waits for a claimed one.
constexpr int kMarkWaits = 15;

}  // namespace

void ObjectMaterial::describe(config::Section& s, const char* of) {
  const std::string whose(of);
  s.number("stiffness_scale", stiffness_scale, 0.01, 1, whose + ", times the device's stiffness")
      .number("friction_static", friction_static, 0, 2, whose)
      .number("friction_dynamic", friction_dynamic, 0, 2, whose)
      .number("texture_amplitude_m", texture_amplitude_m, 0, 0.005, whose)
      .number("texture_period_m", texture_period_m, 0, 0.1, whose);
}

void FusionConfig::describe_objects(config::Section& s) {
  objects.describe(s);
  object_material.describe(s, "of objects");
  s.list(
      "material",
      [this](config::Section& item) {
        MaterialOfObject& m = object_materials.emplace_back();
        item.integer("id", m.id, 1, perception::ObjectMap::kMost,
                     "which object: they are numbered as they are marked");
        m.material.describe(item, "of this object");
      },
      "surface of one object instead of that of all");
}

void FusionTask::set_up_objects(rt::NonRealtime& nrt) {
  if (!config_.objects.enabled) return;
  objects_ = std::make_unique<perception::ObjectMap>(nrt, setup_.camera.width, setup_.camera.height,
                                                     config_.objects);
  objects_shown_ = {(setup_.camera.width - 1) / config_.view_step + 1,
                    (setup_.camera.height - 1) / config_.view_step + 1};
  const auto of = [](const ObjectMaterial& m) {
    return perception::Material{
        static_cast<float>(m.stiffness_scale), static_cast<float>(m.friction_static),
        static_cast<float>(m.friction_dynamic), static_cast<float>(m.texture_amplitude_m),
        static_cast<float>(m.texture_period_m)};
  };
  for (std::size_t id = 1; id <= perception::ObjectMap::kMost; ++id) {
    setup_.palette[id] = of(config_.object_material);
    slot_of_label_[id] = static_cast<std::uint8_t>(id);
  }
  std::array<bool, perception::ObjectMap::kMost + 1> named{};
  for (const MaterialOfObject& m : config_.object_materials) {
    const auto id = static_cast<std::size_t>(m.id);
    if (named[id]) {
      throw std::invalid_argument("fusion.objects.material: id = " + std::to_string(m.id) +
                                  " twice; each of 1 to 15 at most once");
    }
    named[id] = true;
    setup_.palette[id] = of(m.material);
  }
}

void FusionTask::remember_mark(const HapticState& hand) noexcept {
  if (objects_ == nullptr || hand.mark_seq == mark_seq_) return;
  mark_seq_ = hand.mark_seq;
  mark_W_ = hand.p_mark_W;
  mark_waited_ = 0;
}

void FusionTask::follow_objects(const perception::RgbdFrame& frame, bool integrated,
                                Out& out) noexcept {
  if (objects_ == nullptr) return;
  if (!integrated) {
    if (mark_W_ && ++mark_waited_ > kMarkWaits) answer_mark(TouchAnswer::kNotTracked, 0);
    return;
  }
  objects_->segment(view_of(frame), map_, X_WC_, mark_W_);
  objects_->fuse(map_);
  objects_drawn_ = view_due(out) && objects_->count() > 0;
  if (objects_drawn_)
    objects_->draw(view_of(frame), map_, X_WC_, config_.view_step, objects_shown_.view());
  out.segmentation = objects_->stats();
  out.work += out.segmentation.work;
  if (mark_W_ && out.segmentation.answer != TouchAnswer::kNone)
    answer_mark(out.segmentation.answer, out.segmentation.touched);
}

void FusionTask::answer_mark(TouchAnswer answer, std::uint8_t id) noexcept {
  mark_W_.reset();
  answered_seq_ = mark_seq_;
  answer_ = answer;
  answered_id_ = id;
}

void FusionTask::write_objects(Out& out) noexcept {
  if (objects_ == nullptr || out.objects == nullptr) return;
  if (!out.camera_written && answered_seq_ == published_answer_) return;
  ObjectList& list = *out.objects;
  list.size = 0;
  for (const perception::MapObject& o : objects_->objects()) {
    if (o.id == 0) continue;
    const perception::ObjectSummary& s = o.summary;
    list.entries[static_cast<std::size_t>(list.size++)] = {
        o.id, o.serial, o.seen, s.points > 0, s.X_FO, s.extent_m, s.centre_m, s.colour};
  }
  list.seq = ++objects_seq_;
  list.exposure = seen_;
  list.mark_seq = published_answer_ = answered_seq_;
  list.answer = answer_;
  list.touched = answered_id_;
  out.objects_written = true;
}

}  // namespace tasks
