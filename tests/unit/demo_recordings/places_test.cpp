// Places in pictures that are drawn here ray by ray, and what is remembered of them. The drawing
// shares nothing with the map's ray cast.
#include "tools/touch/touch_places.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "perception/motion/motion_mask.hpp"
#include "tools/touch/touch_script.hpp"

namespace {

using perception::Pose;
using perception::Vec3;
using tasks::SceneView;
using teletact::Reach;
using teletact::TouchPlace;
using teletact::TouchPlaces;
using Kind = TouchPlace::Kind;

// W as in a recording: x right, y down, z ahead.
const Vec3 kUp(0, -1, 0);

struct Box {
  Vec3 from, to;
};

// Distance along `ray` to a box; none: it passes.
std::optional<double> meet(const Box& b, const Vec3& eye, const Vec3& ray) {
  double near = 0, far = 1e9;
  for (int a = 0; a < 3; ++a) {
    const double s0 = (b.from[a] - eye[a]) / ray[a], s1 = (b.to[a] - eye[a]) / ray[a];
    near = std::max(near, std::min(s0, s1));
    far = std::min(far, std::max(s0, s1));
  }
  return near < far ? std::optional(near) : std::nullopt;
}

// Looks ahead and `pitch` down from the origin.
std::unique_ptr<SceneView> draw(const std::vector<Box>& boxes, double pitch, std::uint64_t seq = 1,
                                const Vec3& eye = Vec3::Zero()) {
  auto v = std::make_unique<SceneView>();
  v->seq = seq;
  v->intrinsics = {91, 91, 63.5, 52.5, 128, 106};
  v->X_WV.linear() = Eigen::AngleAxisd(-pitch, Vec3::UnitX()).toRotationMatrix();
  v->X_WV.translation() = eye;
  for (int y = 0; y < 106; ++y) {
    for (int x = 0; x < 128; ++x) {
      // A little off the axes: no ray is parallel to a face.
      const Vec3 ray_V = v->intrinsics.unproject(x + 1e-4, y + 1e-4, 1);
      const Vec3 ray = v->X_WV.linear() * ray_V;
      double nearest = 1e9;
      for (const Box& b : boxes) nearest = std::min(nearest, meet(b, eye, ray).value_or(1e9));
      if (nearest > 5) continue;
      const Vec3 p = eye + nearest * ray;
      v->points[static_cast<std::size_t>(y * 128 + x)] = {
          static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()),
          static_cast<float>(nearest)};
    }
  }
  return v;
}

// A table's top 0.4 m below the eye and 0.8 m ahead, a wall behind it.
const Box kTable{Vec3(-0.3, 0.4, 0.7), Vec3(0.3, 0.43, 1.1)};
const Box kWall{Vec3(-3, -3, 1.8), Vec3(3, 3, 1.9)};

bool any(const std::vector<TouchPlace>& places, Kind kind) {
  return std::any_of(places.begin(), places.end(), [&](const auto& p) { return p.kind == kind; });
}

TEST(ViewPlaces, TopWallEdgeAndCornerAreWhereTheyAre) {
  const auto view = draw({kTable, kWall}, 0.35);
  const auto places = teletact::places_in_view(*view, kUp, {});
  for (const Kind kind : {Kind::kTop, Kind::kWall, Kind::kEdge, Kind::kCorner})
    EXPECT_TRUE(any(places, kind)) << teletact::name_of(kind);
  for (const TouchPlace& p : places) {
    SCOPED_TRACE(std::string(teletact::name_of(p.kind)) + " at " + std::to_string(p.p_W.x()) + " " +
                 std::to_string(p.p_W.y()) + " " + std::to_string(p.p_W.z()));
    const bool on_table = std::abs(p.p_W.y() - 0.4) < 2e-3,
               on_wall = std::abs(p.p_W.z() - 1.8) < 2e-3;
    ASSERT_TRUE(on_table || on_wall);
    EXPECT_GT(p.n_W.dot(on_table ? kUp : Vec3(0, 0, -1)), 0.999);
    if (!on_table) continue;
    // To the rim.
    const double x = 0.3 - std::abs(p.p_W.x()), z = std::min(p.p_W.z() - 0.7, 1.1 - p.p_W.z());
    EXPECT_GT(std::min(x, z), 0.015);
    if (p.kind == Kind::kTop) {
      EXPECT_GT(std::min(x, z), 0.05);
    }
    if (p.kind == Kind::kEdge) {
      EXPECT_LT(std::min(x, z), 0.065);
    }
    if (p.kind == Kind::kCorner) {
      EXPECT_LT(std::max(x, z), 0.065);
    }
    if (p.wide) {
      EXPECT_GT(std::min(x, z), 0.085);
    }
  }
}

TEST(ViewPlaces, NotUnderSomethingThatStandsThere) {
  const Box cup{Vec3(-0.04, 0.3, 0.86), Vec3(0.04, 0.4, 0.94)};
  const auto view = draw({kTable, kWall, cup}, 0.35);
  for (const TouchPlace& p : teletact::places_in_view(*view, kUp, {})) {
    if (std::abs(p.p_W.y() - 0.4) > 2e-3) continue;
    const double x = std::max(0.0, std::abs(p.p_W.x()) - 0.04),
                 z = std::max({0.0, 0.86 - p.p_W.z(), p.p_W.z() - 0.94});
    EXPECT_GT(std::hypot(x, z), 0.055) << p.p_W.transpose();
  }
}

TEST(ViewPlaces, NotAtAHoleNorWhereSomethingMoves) {
  auto view = draw({kTable, kWall}, 0.35);
  const auto pixel_of = [&](const Vec3& p) {
    const auto uv = view->intrinsics.project(view->X_WV.inverse() * p);
    return std::pair{static_cast<int>(std::lround(uv.x())), static_cast<int>(std::lround(uv.y()))};
  };
  const Vec3 hole(0, 0.4, 0.9);
  const auto [u, v] = pixel_of(hole);
  for (int y = v - 1; y <= v + 1; ++y) {
    for (int x = u - 1; x <= u + 1; ++x) view->points[static_cast<std::size_t>(y * 128 + x)] = {};
  }
  const auto near = [&](const TouchPlace& p) { return (p.p_W - hole).norm() < 0.05; };
  auto places = teletact::places_in_view(*view, kUp, {});
  EXPECT_TRUE(std::none_of(places.begin(), places.end(), near));
  EXPECT_TRUE(any(places, Kind::kTop));
  view->masked = true;
  view->what.fill(static_cast<std::uint8_t>(perception::PixelOf::kMoving));
  EXPECT_TRUE(teletact::places_in_view(*view, kUp, {}).empty());
}

TEST(ViewPlaces, AnEmptyPictureHasNone) {
  EXPECT_TRUE(teletact::places_in_view(*draw({}, 0.35), kUp, {}).empty());
  EXPECT_TRUE(teletact::places_in_view(SceneView{}, kUp, {}).empty());
}

int sure(const TouchPlaces& m) {
  return static_cast<int>(
      std::count_if(m.known().begin(), m.known().end(), [](const auto& k) { return k.sure(); }));
}

TEST(PlaceMemory, TwoPicturesMakeItSureAndTwoThatLookThroughItForgetIt) {
  TouchPlaces m;
  m.see(*draw({kTable}, 0.35), kUp, nullptr);
  ASSERT_FALSE(m.known().empty());
  EXPECT_EQ(sure(m), 0);
  m.see(*draw({kTable}, 0.35), kUp, nullptr);
  EXPECT_GT(sure(m), 0);
  const Vec3 p = m.known().front().place.p_W;
  EXPECT_NE(m.at(p), nullptr);
  m.see(*draw({}, 0.35), kUp, nullptr);
  EXPECT_EQ(m.at(p), nullptr) << "not chosen while it does not show";
  EXPECT_FALSE(m.known().empty());
  m.see(*draw({}, 0.35), kUp, nullptr);
  EXPECT_TRUE(m.known().empty());
}

TEST(PlaceMemory, OutOfViewIsKeptHiddenIsNotChosen) {
  TouchPlaces m;
  for (int i = 0; i < 2; ++i) m.see(*draw({kTable}, 0.35), kUp, nullptr);
  const int before = sure(m);
  ASSERT_GT(before, 0);
  for (int i = 0; i < 5; ++i) m.see(*draw({kTable}, -1.0), kUp, nullptr);  // looks up
  EXPECT_EQ(sure(m), before);
  const Box curtain{Vec3(-1, -1, 0.40), Vec3(1, 1, 0.41)};
  m.see(*draw({kTable, curtain}, 0.35), kUp, nullptr);
  const auto table = [](const auto& k) { return k.place.p_W.z() > 0.6 && k.sure(); };
  EXPECT_TRUE(std::none_of(m.known().begin(), m.known().end(), table));
  m.see(*draw({kTable}, 0.35), kUp, nullptr);
  EXPECT_TRUE(std::any_of(m.known().begin(), m.known().end(), table)) << "seen again";
}

Reach reach_at(const Vec3& centre_W) {
  Reach r;
  r.map = drivers::WorkspaceMap(centre_W, 5.5, 0);
  return r;
}

TEST(NextPlace, InReachInTurnAndNotTheSameTwice) {
  TouchPlaces m;
  const auto view = draw({kTable, kWall}, 0.35);
  for (int i = 0; i < 2; ++i) m.see(*view, kUp, nullptr);
  const Reach reach = reach_at(Vec3(0.05, 0.2, 0.92));
  std::vector<TouchPlace> touched;
  Vec3 at = reach.map.to_world(Vec3::Zero());
  for (int i = 0; i < 5; ++i) {
    const auto next = teletact::next_place(m, *view, reach, at, touched);
    ASSERT_TRUE(next.has_value());
    EXPECT_TRUE(reach.holds(next->place)) << "the wall is out of reach";
    EXPECT_TRUE(reach.holds(next->via_W));
    for (const TouchPlace& t : touched) EXPECT_GT((t.p_W - next->place.p_W).norm(), 0.04);
    touched.push_back(next->place);
    at = next->place.p_W + reach.standoff_m * next->place.n_W;
  }
  EXPECT_EQ(touched[0].kind, Kind::kTop);
  EXPECT_EQ(touched[3].kind, Kind::kEdge);
  EXPECT_EQ(touched[4].kind, Kind::kCorner);
  EXPECT_FALSE(
      teletact::next_place(m, *view, reach_at(Vec3(0, 0, -3)), Vec3(0, 0, -3), {}).has_value());
}

// The straight from one side to the other goes through a thing between them: the hand is drawn back
// on its way.
TEST(NextPlace, AroundWhatIsInTheWay) {
  const Box block{Vec3(-0.06, 0.28, 0.7), Vec3(0.06, 0.4, 1.1)};
  TouchPlaces m;
  const auto view = draw({kTable, kWall, block}, 0.5);
  for (int i = 0; i < 2; ++i) m.see(*view, kUp, nullptr);
  Reach reach = reach_at(Vec3(0, 0.2, 0.9));
  const Vec3 from(-0.2, 0.34, 0.95);
  // Everything but what is on the right has been touched.
  std::vector<TouchPlace> touched;
  for (const auto& k : m.known()) {
    if (k.place.p_W.x() < 0.1) touched.push_back(k.place);
  }
  while (touched.size() % 5 != 0) touched.push_back(touched.back());
  const auto next = teletact::next_place(m, *view, reach, from, touched);
  ASSERT_TRUE(next.has_value());
  ASSERT_GT(next->place.p_W.x(), 0.1);
  const Vec3 to = next->place.p_W + reach.standoff_m * next->place.n_W;
  for (const auto& [a, b] : {std::pair{from, next->via_W}, std::pair{next->via_W, to}}) {
    for (double s = 0; s <= 1; s += 0.01) {
      const Vec3 p = a + s * (b - a);
      const bool inside = std::abs(p.x()) < 0.06 && p.y() > 0.28 && p.z() > 0.7 && p.z() < 1.1;
      EXPECT_FALSE(inside) << p.transpose();
    }
  }
}

TEST(Up, OfATableSeenFromAboveIsItsNormal) {
  TouchPlaces m;
  const double pitch = 0.75;  // in the picture's own frame, as a recording's world is
  const auto tilted = [&] {
    auto v = draw({kTable, kWall}, pitch);
    const Eigen::Matrix3d to_V = v->X_WV.linear().transpose();
    for (auto& q : v->points) {
      const Eigen::Vector3f p = (to_V * Vec3(static_cast<double>(q.x), static_cast<double>(q.y),
                                             static_cast<double>(q.z)))
                                    .cast<float>();
      q.x = p.x(), q.y = p.y(), q.z = p.z();
    }
    v->X_WV = Pose::Identity();
    return v;
  }();
  EXPECT_EQ(teletact::up_of({}, m), kUp) << "nothing seen yet";
  for (int i = 0; i < 2; ++i) m.see(*tilted, kUp, nullptr);
  const Vec3 up(0, -std::cos(pitch), -std::sin(pitch));
  EXPECT_GT(teletact::up_of({}, m).dot(up), 0.999);
  auto ground = std::make_unique<perception::CostMap>();
  ground->seq = 1;
  ground->ground_found = true;
  EXPECT_EQ(teletact::up_of(*ground, m), Vec3(0, 0, 1));
}

// What came of visits, from samples made here.
TEST(Visits, AreCountedByContactWhilePressed) {
  std::vector<teletact::Visit> visits(3);
  visits[0].kind = Kind::kWall;
  visits[0].chosen = visits[0].pressed = true;
  visits[0].from_s = 1, visits[0].until_s = 2;
  visits[1] = visits[0];
  visits[1].from_s = 3, visits[1].until_s = 4;
  std::vector<tasks::HapticSample> samples(5000);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].stamp = rt::time_from_ns(static_cast<std::int64_t>(i) * 1000000);
    samples[i].in_contact = i >= 1500 && i < 2500;
    samples[i].force_N = 3;
  }
  const auto t = teletact::touched_places(visits, samples, 0);
  EXPECT_EQ(t.met(), 1);
  EXPECT_NEAR(t.visits[0].contact_s, 0.5, 2e-3);
  EXPECT_EQ(t.visits[1].contact_s, 0);
  EXPECT_EQ(t.none, 1);
  EXPECT_EQ(t.text(), "1 wall");
  EXPECT_EQ(teletact::too_few_touches(t, 1), "");
  EXPECT_NE(teletact::too_few_touches(t, 3).find("touched 1 times, wanted 3"), std::string::npos);
}

}  // namespace
