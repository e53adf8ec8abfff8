// Objects in the fusion task: a mark on a surface names one, each claimed frame follows one, the
// list is published. Nothing of this exists unless [fusion.objects] enabled says so.
//
// Frames: W world (= map). SI. Noexcept and without allocation after construction.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "perception/geometry/image.hpp"
#include "perception/objects/object_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_config.hpp"
#include "tasks/fusion/fusion_io.hpp"

namespace tasks {

class FusionObjects {
 public:
  using Palette = std::array<perception::Material, perception::SurfacePatch::kMaxMaterials>;

  // Throws std::invalid_argument where the material of an object is given twice. Writes the
  // objects' slots of `palette`.
  FusionObjects(rt::NonRealtime&, const FusionConfig& config, const perception::Intrinsics& camera,
                Palette& palette);

  // A period begins: nothing is drawn; a mark that the hand made waits for an image.
  void begin(const HapticState& hand) noexcept;
  // What the operator asks of objects; null, 0: nothing. One that is given waits for an image.
  void edit(perception::TsdfMap& map, const perception::GivenObject* given,
            std::uint16_t drop) noexcept;
  // Is there a mark that was not answered yet, or an object that was not named yet?
  [[nodiscard]] bool marked() const noexcept { return mark_W_ || given_; }
  // The image at X_WC, `out`.integrated into `map` or not; `draw`: for the view.
  void follow(const perception::FrameView& seen, perception::TsdfMap& map, const Pose& X_WC,
              bool draw, FusionOut& out) noexcept;
  // The list, where there is something new to say. `seen`: exposure of the last frame that was
  // claimed.
  void write(rt::Time seen, FusionOut& out) noexcept;

  [[nodiscard]] const perception::ObjectMap& map() const noexcept { return objects_; }
  [[nodiscard]] int count() const noexcept { return objects_.count(); }
  // Slot of the palette, by label of the map.
  [[nodiscard]] std::span<const std::uint8_t> slots() const noexcept { return slot_of_label_; }
  // Were this period's objects drawn in the camera's own image? Then their ids, a pixel of the view
  // each.
  [[nodiscard]] bool drawn() const noexcept { return drawn_; }
  [[nodiscard]] perception::ImageView<const std::uint8_t> shown() const noexcept {
    return shown_.view();
  }

 private:
  void answer(perception::TouchAnswer answer, std::uint8_t id) noexcept;
  void segment(const perception::FrameView& seen, const perception::TsdfMap& map,
               const Pose& X_WC) noexcept;

  int view_step_;
  perception::ObjectMap objects_;
  std::array<std::uint8_t, 256> slot_of_label_{};
  perception::Image<std::uint8_t> shown_;
  bool drawn_ = false;
  std::optional<Vec3> mark_W_;                    // not answered yet
  int mark_waited_ = 0;                           // frames
  std::optional<perception::GivenObject> given_;  // not named yet; a mark goes before it
  int given_waited_ = 0;                          // frames
  std::uint64_t mark_seq_ = 0, answered_seq_ = 0, published_answer_ = 0, list_seq_ = 0;
  perception::TouchAnswer answer_ = perception::TouchAnswer::kNone;
  std::uint8_t answered_id_ = 0;
};

}  // namespace tasks
