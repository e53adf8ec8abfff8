// The operator's view: cast in parts while the camera moves.
#include <algorithm>
#include <vector>

#include "rig.hpp"

namespace tasks {
namespace {

using tests::Rig;

// Shares of the view's pixels: with a surface, and of these off the true one.
struct Seen {
  double share = 0, off = 0;
};

Seen seen_of(const tests::AnalyticScene& room, const SceneView& view) {
  const auto& k = view.intrinsics;
  int seen = 0, off = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const auto& p = view.points[static_cast<std::size_t>(v * k.width + u)];
      if (p.depth <= 0) continue;
      ++seen;
      const Vec3 d = view.X_WV.linear() * k.unproject(u, v, 1);
      const Vec3 q = view.X_WV.translation() + room.cast(view.X_WV.translation(), d).t * d;
      off += (q - Vec3(p.x, p.y, p.z)).norm() > 0.03 ? 1 : 0;
    }
  }
  const double pixels = static_cast<double>(k.width) * k.height;
  return {seen / pixels, static_cast<double>(off) / std::max(1, seen)};
}

// Ten periods from one view to the next, five of them cast: each row from where the camera was when
// the cast began, and no job does more than about its share.
TEST(FusionView, IsCastInPartsFromOnePlace) {
  const tests::AnalyticScene room = tests::test_room();
  FusionConfig config = tests::coarse();
  config.view_period_frames = 10;
  Rig rig(config);
  std::vector<std::uint64_t> work;
  std::vector<int> written;
  rt::Time begun{};
  perception::Pose eye = perception::Pose::Identity();
  for (int i = 0; i < 45; ++i) {
    rig.see(room, Rig::eye(i));
    work.push_back(rig.out.work_view);
    if (i % 10 == 0) {
      begun = rig.frame->exposure;
      eye = rig.task->camera();
    }
    if (!rig.out.view_written) continue;
    written.push_back(i);
    EXPECT_EQ(rig.view->exposure, begun);
    EXPECT_EQ(rig.view->X_WV.matrix(), eye.matrix());
    EXPECT_GT((rig.task->camera().translation() - eye.translation()).norm(), 0.02) << "it moves";
    const Seen seen = seen_of(room, *rig.view);
    EXPECT_GT(seen.share, 0.75);
    EXPECT_LT(seen.off, 0.05);
  }
  EXPECT_EQ(written, (std::vector<int>{4, 14, 24, 34, 44}));
  std::uint64_t all = 0, most = 0;
  for (int i = 30; i < 40; ++i) {
    all += work[static_cast<std::size_t>(i)];
    most = std::max(most, work[static_cast<std::size_t>(i)]);
    EXPECT_EQ(work[static_cast<std::size_t>(i)] > 0, i < 35);
  }
  EXPECT_LT(static_cast<double>(most), 0.35 * static_cast<double>(all));
}

// Of a map that stands still the parts are, byte for byte, the picture that one piece is.
TEST(FusionView, InPartsItHasTheBytesOfOnePiece) {
  const tests::AnalyticScene room = tests::test_room();
  const auto view_of = [&](int period) {
    FusionConfig config = tests::coarse();
    config.view_period_frames = period;
    Rig rig(config);
    for (int i = 0; i < 30; ++i) rig.see(room, Rig::eye(0));
    do {
      rig.step(false);  // nothing new: the map is as it was
    } while (rig.out.view_written);
    do {
      rig.step(false);
    } while (!rig.out.view_written);
    return std::move(rig.view);
  };
  const auto whole = view_of(3), parts = view_of(10);
  const auto n = static_cast<std::ptrdiff_t>(whole->intrinsics.width) * whole->intrinsics.height;
  EXPECT_EQ(whole->intrinsics, parts->intrinsics);
  int other = 0;
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const auto &a = whole->points[at], &b = parts->points[at];
    other += a.x != b.x || a.y != b.y || a.z != b.z || a.depth != b.depth ||
             whole->colour[at].r != parts->colour[at].r;
  }
  // A row of a part has another centre, so its rays may differ in the last bit of a float.
  EXPECT_LT(other, n / 50);
}

}  // namespace
}  // namespace tasks
