// The field lists of the messages between tasks (rt/message/fields.hpp). Their order is that of a
// run's hash.
#pragma once

#include "drivers/link/frame_demand.hpp"
#include "drivers/link/messages.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/patch/surface_patch.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "rt/message/fields.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/object_list.hpp"
#include "tasks/contract/operator_act.hpp"
#include "tasks/contract/scene_edit.hpp"
#include "tasks/contract/scene_view.hpp"
#include "tasks/contract/surface_points.hpp"

namespace rt {

template <>
struct Fields<tasks::ModeMsg> {
  using M = tasks::ModeMsg;
  static constexpr auto kList = fields(value(&M::seq), datum(&M::stamp), value(&M::mode),
                                       value(&M::cause), value(&M::clear), value(&M::resumes));
};
static_assert(lists_every_field<tasks::ModeMsg>());

template <>
struct Fields<tasks::HapticState> {
  using M = tasks::HapticState;
  static constexpr auto kList =
      fields(value(&M::seq), datum(&M::stamp), number(&M::p_WH), number(&M::v_WH), number(&M::p_WP),
             number(&M::f_H_W), number(&M::normal_W), value(&M::contacts), value(&M::button),
             value(&M::patch_seq), value(&M::mark_seq), value(&M::p_mark_W));
};
static_assert(lists_every_field<tasks::HapticState>());

template <>
struct Fields<tasks::TouchEvent> {
  using M = tasks::TouchEvent;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::stamp), value(&M::kind), on_the_way(&M::gap),
             number(&M::p_W), number(&M::normal_W), number(&M::force_N));
};
static_assert(lists_every_field<tasks::TouchEvent>());

template <>
struct Fields<tasks::CameraPose> {
  using M = tasks::CameraPose;
  static constexpr auto kList = fields(value(&M::seq), instant(&M::exposure), number(&M::X_WC),
                                       value(&M::tracking), value(&M::claimed), datum(&M::seen));
};
static_assert(lists_every_field<tasks::CameraPose>());

template <>
struct Fields<tasks::OdometryFrame> {
  using M = tasks::OdometryFrame;
  static constexpr auto kList =
      fields(value(&M::seq), datum(&M::taken), instant(&M::claimed), number(&M::error_m),
             number(&M::error_rad), value(&M::known), value(&M::follows_camera), value(&M::unsure),
             value(&M::held), value(&M::held_ms), value(&M::held_limit_ms), number(&M::X_WO),
             number(&M::covariance));
};
static_assert(lists_every_field<tasks::OdometryFrame>());

template <>
struct Fields<tasks::Path> {
  using M = tasks::Path;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::made), value(&M::mark_seq), instant(&M::mark_stamp),
             value(&M::size), number(&M::marked_W), datum(&M::seen));
  static constexpr int kApart = 1;  // points
};
static_assert(lists_every_field<tasks::Path>());

template <>
struct Fields<tasks::TaskState> {
  using M = tasks::TaskState;
  static constexpr auto kList =
      fields(value(&M::seq), datum(&M::stamp), value(&M::phase), value(&M::marks), value(&M::paths),
             value(&M::failures), value(&M::off_m), value(&M::is_short), value(&M::failure));
};
static_assert(lists_every_field<tasks::TaskState>());

template <>
struct Fields<tasks::SceneEdit> {
  using M = tasks::SceneEdit;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::stamp), value(&M::kind), value(&M::id),
             number(&M::centre_W), number(&M::half_m), number(&M::yaw_rad));
};
static_assert(lists_every_field<tasks::SceneEdit>());

template <>
struct Fields<tasks::OperatorAct> {
  using M = tasks::OperatorAct;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::stamp), value(&M::kind), value(&M::turns), number(&M::p_W),
             number(&M::normal_W), number(&M::yaw_rad));
};
static_assert(lists_every_field<tasks::OperatorAct>());

template <>
struct Fields<tasks::DriveIntent> {
  using M = tasks::DriveIntent;
  static constexpr auto kList = fields(value(&M::seq), datum(&M::stamp), value(&M::held),
                                       number(&M::vx), number(&M::vy), number(&M::wz));
};
static_assert(lists_every_field<tasks::DriveIntent>());

template <>
struct Fields<tasks::SurfacePoints> {
  using M = tasks::SurfacePoints;
  static constexpr auto kList = fields(value(&M::seq), instant(&M::fused), datum(&M::exposure),
                                       number(&M::X_WC), value(&M::count));
  static constexpr int kApart = 6;  // the coordinates
};
static_assert(lists_every_field<tasks::SurfacePoints>());

template <>
struct Fields<tasks::SceneView> {
  using M = tasks::SceneView;
  static constexpr auto kList = fields(value(&M::seq), instant(&M::fused), datum(&M::exposure),
                                       value(&M::X_WV), value(&M::intrinsics));
  static constexpr int kApart = 5;  // what each pixel shows
};
static_assert(lists_every_field<tasks::SceneView>());

template <>
struct Fields<tasks::ObjectList> {
  using M = tasks::ObjectList;
  static constexpr auto kList = fields(value(&M::seq), datum(&M::exposure), value(&M::size),
                                       value(&M::mark_seq), value(&M::answer), value(&M::touched));
  static constexpr int kApart = 1;  // entries
};
static_assert(lists_every_field<tasks::ObjectList>());

template <>
struct Fields<perception::SurfacePatch> {
  using M = perception::SurfacePatch;
  static constexpr auto kList =
      fields(value(&M::map_id), value(&M::seq), instant(&M::fused), datum(&M::exposure),
             number(&M::voxel_size), number(&M::metres_per_unit), value(&M::nodes),
             value(&M::touched_moves), value(&M::origin_node), value(&M::palette));
  static constexpr int kApart = 4;  // checksum, distance, material, free
};
static_assert(lists_every_field<perception::SurfacePatch>());

template <>
struct Fields<perception::MeshDelta> {
  using M = perception::MeshDelta;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::fused), datum(&M::exposure), value(&M::restart),
             value(&M::block_count), value(&M::vertex_count), value(&M::triangle_count));
  static constexpr int kApart = 3;  // blocks, vertices, triangles
};
static_assert(lists_every_field<perception::MeshDelta>());

template <>
struct Fields<perception::CostMap> {
  using M = perception::CostMap;
  static constexpr auto kList =
      fields(value(&M::seq), instant(&M::fused), datum(&M::exposure), value(&M::ground_found),
             number(&M::resolution), value(&M::width), value(&M::height), number(&M::X_WM));
  static constexpr int kApart = 4;  // cost, height_m, moving_count, moving
};
static_assert(lists_every_field<perception::CostMap>());

// Decoded from an EncodedFrame, which is what a run's hash weighs; here only its instant matters.
template <>
struct Fields<perception::RgbdFrame> {
  using M = perception::RgbdFrame;
  static constexpr auto kList = fields(datum(&M::exposure));
};

}  // namespace rt
