// A mark becomes an object: labels in the map, a slot in the patch, an entry in the list.
#include <gtest/gtest.h>

#include <iostream>
#include <limits>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "tasks/fusion/given_boxes.hpp"
#include "tests/unit/tasks_fusion/rig.hpp"

namespace tasks {
namespace {

using perception::ObjectMap;
using perception::Rgb;
using perception::TouchAnswer;
using tests::AnalyticScene;
using tests::kDt;
using tests::Rig;

constexpr std::size_t kBox = 1;  // of test_room(): 0.5 x 0.4 x 0.7 m
constexpr Rgb kBoxColour{190, 60, 40};

FusionConfig with_objects() {
  FusionConfig c = tests::coarse();
  c.objects.enabled = true;
  c.object_material.stiffness_scale = 0.5;
  c.object_material.friction_static = 0.4;
  return c;
}

struct ObjectRig : Rig {
  AnalyticScene room = tests::test_room();
  std::unique_ptr<ObjectList> list = std::make_unique<ObjectList>();
  int frames = 0;

  explicit ObjectRig(const FusionConfig& config = with_objects()) : Rig(config) {
    out.objects = list.get();
    in.hand.seq = 1;
    in.hand.p_WH = surface();
  }
  static bool on_box(const AnalyticScene& scene, const Vec3& p_W, double margin_m) {
    const AnalyticScene::Box& b = scene.boxes[kBox];
    const Vec3 p = (b.X_WS.inverse() * p_W).cwiseAbs() - b.half;
    return p.maxCoeff() <= margin_m;
  }
  // The room with colours: what stands in it differs from the floor and the walls.
  void look(double sigma = 0.001) {
    const Pose X_WC = eye(frames++);
    fill_frame(room, setup.camera, X_WC, sigma, random, *frame);
    const auto& k = setup.camera;
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) {
        const Vec3 d = X_WC.linear() * k.unproject(u, v, 1.0);
        const tests::Hit h = room.cast(X_WC.translation(), d);
        if (!std::isfinite(h.t)) continue;
        const Vec3 p = X_WC.translation() + h.t * d;
        const auto shade = static_cast<std::uint8_t>(random.integer(0, 10));
        Rgb c{static_cast<std::uint8_t>(150 + shade), 150, 140};
        if (on_box(room, p, 1e-6))
          c = {kBoxColour.r, kBoxColour.g, static_cast<std::uint8_t>(40 + shade)};
        frame->colour[static_cast<std::size_t>(v * k.width + u)] = c;
      }
    frame->exposure = rt::Time{rt::nanos_from_seconds(static_cast<double>(period) * kDt - 0.02)};
    ++frame->seq;
    step(true);
  }
  // A point of the box that the camera sees.
  [[nodiscard]] Vec3 surface() const {
    const Vec3 o = eye(0).translation(), to = room.boxes[kBox].X_WS.translation() - o;
    return o + room.cast(o, to).t * to;
  }
  void mark(std::uint64_t seq, const Vec3& p_W) {
    in.hand.mark_seq = seq;
    in.hand.p_mark_W = p_W;
  }
};

TEST(FusionObjects, AMarkBecomesAnObjectEverywhere) {
  ObjectRig rig;
  for (int i = 0; i < 4; ++i) {
    rig.look();
    ASSERT_TRUE(rig.out.objects_written && rig.out.integrated);
    EXPECT_EQ(rig.list->seq, static_cast<std::uint64_t>(i + 1));
    EXPECT_EQ(rig.list->size, 0);
    EXPECT_EQ(rig.list->mark_seq, 0U);
    EXPECT_EQ(rig.out.segmentation.work, 0U) << "nothing to follow, nothing spent";
  }
  rig.step(false);
  EXPECT_FALSE(rig.out.objects_written) << "nothing new to say";
  rig.mark(17, rig.surface());
  rig.step(false);
  EXPECT_FALSE(rig.out.objects_written) << "a mark waits for an image";
  rig.look();
  ASSERT_TRUE(rig.out.objects_written);
  EXPECT_EQ(rig.list->mark_seq, 17U);
  EXPECT_EQ(rig.list->answer, TouchAnswer::kObject);
  ASSERT_EQ(rig.list->size, 1);
  const std::uint8_t id = rig.list->touched;
  EXPECT_EQ(rig.list->entries[0].id, id);
  EXPECT_TRUE(rig.list->entries[0].summarised);
  EXPECT_EQ(rig.list->exposure, rig.frame->exposure);
  for (int i = 0; i < 16; ++i) {
    rig.look();
    EXPECT_EQ(rig.list->mark_seq, 17U) << "answered once";
    EXPECT_EQ(rig.out.segmentation.followed, id);
  }

  // In the map: what is seen of the box is labelled, nothing away from it is.
  const auto& map = rig.task->map();
  perception::MapReader reader(map);
  const Pose X_WC = Rig::eye(rig.frames - 1);
  int seen = 0, right = 0, labelled = 0, stray = 0;
  for (int v = 0; v < rig.setup.camera.height; ++v)
    for (int u = 0; u < rig.setup.camera.width; ++u) {
      const Vec3 d = X_WC.linear() * rig.setup.camera.unproject(u, v, 1.0);
      const Vec3 p = X_WC.translation() + rig.room.cast(X_WC.translation(), d).t * d;
      const bool box = ObjectRig::on_box(rig.room, p, 1e-6);
      const bool said = reader.label(p) == id;
      seen += box;
      right += box && said;
      labelled += said;
      stray += said && !ObjectRig::on_box(rig.room, p, 0.03);
    }
  std::cout << "box seen at " << seen << " pixels, labelled " << right << ", elsewhere "
            << labelled - right << " (" << stray << " beyond 30 mm)\n";
  EXPECT_GT(seen, 1000);
  EXPECT_GE(right, 0.95 * seen);
  EXPECT_LE(labelled - right, 0.05 * seen);
  EXPECT_LE(stray, 0.01 * seen);

  // In the view from the camera.
  while (!rig.out.view_written) rig.look();
  const auto& view = *rig.view;
  int both = 0, either = 0;
  for (int y = 0; y < view.intrinsics.height; ++y)
    for (int x = 0; x < view.intrinsics.width; ++x) {
      const Pose X = Rig::eye(rig.frames - 1);
      const Vec3 d = X.linear() * view.intrinsics.unproject(x, y, 1.0);
      const Vec3 p = X.translation() + rig.room.cast(X.translation(), d).t * d;
      const bool box = ObjectRig::on_box(rig.room, p, 1e-6);
      const int shown = view.object[static_cast<std::size_t>(y * view.intrinsics.width + x)];
      EXPECT_TRUE(shown == 0 || shown == id);
      both += box && shown == id;
      either += box || shown == id;
    }
  std::cout << "IoU in the view " << static_cast<double>(both) / either << "\n";
  EXPECT_GT(either, 200);
  EXPECT_GE(both, 0.95 * either);

  // In the patch: the object's slot with its material, the rest in slot 0.
  const auto& patch = *rig.patch;
  EXPECT_FLOAT_EQ(patch.palette[id].stiffness_scale, 0.5F);
  EXPECT_FLOAT_EQ(patch.palette[id].friction_static, 0.4F);
  EXPECT_FLOAT_EQ(patch.palette[0].stiffness_scale, 1.0F);
  int object_nodes = 0, other_nodes = 0, misplaced = 0;
  for (int z = 0; z < patch.nodes; ++z)
    for (int y = 0; y < patch.nodes; ++y)
      for (int x = 0; x < patch.nodes; ++x) {
        const Vec3 p = patch.node_W(x, y, z);
        const perception::LabelVoxel voxel =
            map.label_at(static_cast<int>(std::lround(p.x() / 0.02)),
                         static_cast<int>(std::lround(p.y() / 0.02)),
                         static_cast<int>(std::lround(p.z() / 0.02)));
        const int slot = patch.material[patch.index(x, y, z)];
        if (slot == 0) continue;
        (slot == 1 + id ? object_nodes : other_nodes) += 1;
        misplaced += slot != 1 + voxel.label;
      }
  std::cout << object_nodes << " nodes of the object in the patch, " << other_nodes << " others\n";
  EXPECT_GT(object_nodes, 300);
  EXPECT_GT(other_nodes, 100);
  EXPECT_EQ(misplaced, 0);

  // In the list.
  const ObjectList::Entry& e = rig.list->entries[0];
  EXPECT_TRUE(e.seen);
  const Vec3 centre = e.X_WO * e.centre_m;
  std::cout << "centre off " << (centre - rig.room.boxes[kBox].X_WS.translation()).transpose()
            << " m, extent " << e.extent_m.transpose() << " m\n";
  // Its two far sides were never seen.
  EXPECT_LT((centre - rig.room.boxes[kBox].X_WS.translation()).norm(), 0.15);
  EXPECT_NEAR(e.extent_m.maxCoeff(), 0.75, 0.12);
  EXPECT_NEAR(e.X_WO.linear().determinant(), 1, 1e-9);
  EXPECT_LT(std::abs(int{e.colour.r} - int{kBoxColour.r}), 12);
  EXPECT_LT(std::abs(int{e.colour.g} - int{kBoxColour.g}), 12);

  // A second mark on it names the same object; the serial stays.
  const std::uint32_t serial = e.serial;
  rig.mark(23, rig.surface());
  rig.look();
  EXPECT_EQ(rig.list->mark_seq, 23U);
  EXPECT_EQ(rig.list->answer, TouchAnswer::kKnown);
  EXPECT_EQ(rig.list->touched, id);
  ASSERT_EQ(rig.list->size, 1);
  EXPECT_EQ(rig.list->entries[0].serial, serial);
}

TEST(FusionObjects, MarksThatNameNothingSayWhy) {
  ObjectRig rig;
  rig.look();
  rig.look();
  const Vec3 eye = Rig::eye(0).translation(), p = rig.surface(), ray = (p - eye).normalized();
  const auto answer = [&](std::uint64_t seq, const Vec3& at) {
    rig.mark(seq, at);
    rig.look();
    EXPECT_EQ(rig.list->mark_seq, seq);
    EXPECT_EQ(rig.list->size, 0);
    return rig.list->answer;
  };
  EXPECT_EQ(answer(2, eye - ray), TouchAnswer::kOutOfView);
  EXPECT_EQ(answer(3, p + 0.2 * ray), TouchAnswer::kHidden);
  EXPECT_EQ(answer(4, p - 0.2 * ray), TouchAnswer::kMoved);
  // While the camera is lost a mark waits, but not for ever.
  AnalyticScene other;
  other.planes = {{Vec3(1.0, 0, 0.5), Vec3(-1, 0.9, 0.7).normalized()}};
  std::swap(rig.room, other);
  rig.mark(5, p);
  int waited = 0;
  for (; waited < 40 && rig.list->mark_seq != 5; ++waited) {
    fill_frame(rig.room, rig.setup.camera, Rig::eye(rig.frames), 0.001, rig.random, *rig.frame);
    rig.frame->exposure =
        rt::Time{rt::nanos_from_seconds(static_cast<double>(rig.period) * kDt - 0.02)};
    rig.step(true);
    EXPECT_FALSE(rig.out.integrated);
  }
  EXPECT_EQ(rig.list->answer, TouchAnswer::kNotTracked);
  EXPECT_NEAR(waited, 16, 1);
  EXPECT_EQ(rig.list->size, 0);
}

// Each object its own surface, by its number; the others have that of all.
TEST(FusionObjects, ASceneNamesTheSurfaceOfAnObject) {
  const std::string text =
      "enabled = true\nstiffness_scale = 0.5\n[[material]]\nid = 2\nstiffness_scale = 0.25\n"
      "texture_amplitude_m = 3e-4\ntexture_period_m = 2e-3\n[[material]]\nid = 15\n";
  FusionConfig c = tests::coarse();
  config::Section section;
  c.describe_objects(section);
  const auto ok = config::load_text(text, "test", section);
  ASSERT_TRUE(ok) << ok.error();
  ObjectRig rig(c);
  rig.look();
  EXPECT_FLOAT_EQ(rig.patch->palette[1].stiffness_scale, 0.5F);
  EXPECT_FLOAT_EQ(rig.patch->palette[2].stiffness_scale, 0.25F);
  EXPECT_FLOAT_EQ(rig.patch->palette[2].texture_period_m, 2e-3F);
  EXPECT_FLOAT_EQ(rig.patch->palette[15].stiffness_scale, 1.0F);
  for (const char* bad : {"[[material]]\nid = 16\n", "[[material]]\nid = 1\ncolour = 2\n"}) {
    FusionConfig other;
    config::Section again;
    other.describe_objects(again);
    EXPECT_FALSE(config::load_text(bad, "test", again)) << bad;
  }
  c.object_materials.push_back(c.object_materials.front());
  EXPECT_THROW(ObjectRig{c}, std::invalid_argument);
}

// What a person at a page would accept: all pixels of the box in the newest image.
perception::GivenObject accepted(const ObjectRig& rig) {
  const auto& k = rig.setup.camera;
  const Pose X_WC = Rig::eye(rig.frames - 1);
  perception::Image<std::uint8_t> mask(k.width, k.height);
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u) {
      const Vec3 d = X_WC.linear() * k.unproject(u, v, 1.0);
      const Vec3 p = X_WC.translation() + rig.room.cast(X_WC.translation(), d).t * d;
      mask.at(u, v) = ObjectRig::on_box(rig.room, p, 1e-6) ? 1 : 0;
    }
  const Eigen::Vector2d at = k.project(X_WC.inverse(Eigen::Isometry) * rig.surface());
  const perception::Click click{static_cast<int>(at.x()), static_cast<int>(at.y()), true};
  return boxes_of(perception::FrameView::of(*rig.frame), mask.view(), X_WC, click);
}

SceneEdit box_edit(const perception::GivenObject& object, int n) {
  SceneEdit e;
  e.kind = SceneEdit::Kind::kObjectBox;
  e.id = static_cast<std::uint16_t>(n + 1);
  const auto& box_W = object.boxes_W[static_cast<std::size_t>(n)];
  const Vec3 centre_W = box_W.center(), half_m = 0.5 * box_W.sizes();
  for (int i = 0; i < 3; ++i) {
    e.centre_W[static_cast<std::size_t>(i)] = centre_W(i);
    e.half_m[static_cast<std::size_t>(i)] = half_m(i);
  }
  return e;
}
SceneEdit point_edit(const perception::GivenObject& object) {
  SceneEdit e;
  e.kind = SceneEdit::Kind::kObjectPoint;
  e.id = static_cast<std::uint16_t>(object.count);
  for (int i = 0; i < 3; ++i) e.centre_W[static_cast<std::size_t>(i)] = object.p_W(i);
  return e;
}

TEST(FusionObjects, AnAcceptedObjectIsNamedWithTheNextImageAndDroppedByItsSerial) {
  ObjectRig rig;
  for (int i = 0; i < 4; ++i) rig.look();
  const perception::GivenObject object = accepted(rig);
  ASSERT_GE(object.count, 1);
  GivenBoxes boxes;
  for (int n = 0; n < object.count; ++n) {
    ASSERT_TRUE(boxes.apply(box_edit(object, n)));
    EXPECT_EQ(boxes.whole(), nullptr);
  }
  ASSERT_TRUE(boxes.apply(point_edit(object)));
  ASSERT_NE(boxes.whole(), nullptr);
  rig.in.given = boxes.whole();
  rig.step(false);
  rig.in.given = nullptr;
  EXPECT_FALSE(rig.out.objects_written) << "it waits for an image";
  rig.look();
  ASSERT_EQ(rig.list->size, 1);
  EXPECT_TRUE(rig.list->entries[0].summarised);
  EXPECT_EQ(rig.list->mark_seq, 0U) << "no mark of the hand was answered";
  for (int i = 0; i < 16; ++i) rig.look();
  ASSERT_EQ(rig.list->size, 1);
  const ObjectList::Entry& e = rig.list->entries[0];
  const Vec3 centre_W = e.X_WO * e.centre_m;
  // Its back was never seen: the middle of what was lies nearer to the camera.
  EXPECT_LT((centre_W - rig.room.boxes[kBox].X_WS.translation()).norm(), 0.25);
  EXPECT_NEAR(e.extent_m.maxCoeff(), 0.75, 0.15);

  rig.in.drop_object = static_cast<std::uint16_t>(e.serial + 1);
  rig.look();
  EXPECT_EQ(rig.list->size, 1) << "another one's serial";
  rig.in.drop_object = static_cast<std::uint16_t>(e.serial);
  rig.look();
  rig.in.drop_object = 0;
  EXPECT_EQ(rig.list->size, 0);
  rig.look();
  EXPECT_EQ(rig.list->size, 0);
}

TEST(FusionObjects, BoxesOutOfOrderOrOfNoNumbersNameNothing) {
  perception::GivenObject object;
  object.count = 2;
  object.boxes_W[0] = {Vec3(0, 0, 0), Vec3(1, 1, 1)};
  object.boxes_W[1] = {Vec3(1, 0, 0), Vec3(2, 1, 1)};
  object.p_W = Vec3(0.5, 0.5, 0.5);
  const SceneEdit first = box_edit(object, 0), second = box_edit(object, 1);
  const SceneEdit end = point_edit(object);
  const auto takes = [](std::initializer_list<SceneEdit> edits) {
    GivenBoxes boxes;
    bool good = true;
    for (const SceneEdit& e : edits) good = boxes.apply(e);
    EXPECT_EQ(good && edits.size() > 2, boxes.whole() != nullptr);
    return boxes.whole() != nullptr;
  };
  EXPECT_TRUE(takes({first, second, end}));
  EXPECT_TRUE(takes({first, first, second, end})) << "begun anew";
  EXPECT_FALSE(takes({first, end})) << "one is missing";
  EXPECT_FALSE(takes({second, first, end}));
  EXPECT_FALSE(takes({first, second, second, end}));
  EXPECT_FALSE(takes({end}));
  SceneEdit wrong = second;
  wrong.half_m[1] = 0;
  EXPECT_FALSE(takes({first, wrong, end}));
  wrong.half_m[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(takes({first, wrong, end}));
  wrong = second;
  wrong.centre_W[2] = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(takes({first, wrong, end}));
  wrong = end;
  wrong.centre_W[0] = 7;
  EXPECT_FALSE(takes({first, second, wrong})) << "a point beside its boxes";
  wrong.centre_W[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(takes({first, second, wrong}));
  wrong = first;
  wrong.kind = SceneEdit::Kind::kErase;
  EXPECT_FALSE(takes({first, wrong, second, end}));
  GivenBoxes boxes;
  for (int n = 0; n < perception::GivenObject::kMost; ++n) {
    SceneEdit e = first;
    e.id = static_cast<std::uint16_t>(n + 1);
    EXPECT_TRUE(boxes.apply(e));
  }
  SceneEdit more = first;
  more.id = perception::GivenObject::kMost + 1;
  EXPECT_FALSE(boxes.apply(more));
}

TEST(FusionObjects, OffThereIsNothing) {
  ObjectRig rig(tests::coarse());
  rig.look();
  rig.mark(2, rig.surface());
  rig.look();
  EXPECT_FALSE(rig.out.objects_written);
  EXPECT_EQ(rig.list->seq, 0U);
  EXPECT_EQ(rig.task->objects(), nullptr);
  EXPECT_EQ(rig.task->map().label_block_count(), 0);
}

}  // namespace
}  // namespace tasks
