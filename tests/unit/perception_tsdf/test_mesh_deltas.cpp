// Deltas of the mesh against the mesh of the whole map, over runs in which the map is fused,
// cleared, put away and forgotten.
#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <map>
#include <memory>
#include <numbers>

#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using Corners = std::array<float, 9>;

// Each triangle by the bits of its corners, begun at the least one: the order and the numbering do
// not count.
std::vector<Corners> triangles_of(const Mesh& mesh) {
  std::vector<Corners> out;
  for (const auto& t : mesh.triangles) {
    std::array<std::array<float, 3>, 3> p;
    for (std::size_t v = 0; v < 3; ++v) {
      const auto& x = mesh.vertices_W[t[v]];
      p[v] = {x.x(), x.y(), x.z()};
    }
    std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
    out.push_back(
        {p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2], p[2][0], p[2][1], p[2][2]});
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<Corners> whole_mesh(rt::NonRealtime& nrt, const TsdfMap& map) {
  MeshOptions options;
  options.refined = false;
  return triangles_of(extract_mesh(nrt, map, options));
}

// A map, its sender and a viewer.
struct Scenery {
  rt::Startup startup;
  TsdfMap map;
  MeshSender sender;
  MeshStore store;
  std::unique_ptr<MeshDelta> delta = std::make_unique<MeshDelta>();
  std::uint64_t seq = 0;
  int messages = 0, most_cut = 0;
  rt::Hash64 bytes;

  explicit Scenery(const TsdfConfig& config)
      : map(startup.token(), config), sender(startup.token(), map) {}

  bool send(int budget) {
    rt_guard::reset();
    bool any = false;
    {
      rt::Section section;
      any = sender.next(budget, *delta);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    EXPECT_LE(sender.cut_last(), budget);
    EXPECT_LE(delta->block_count, MeshDelta::kMostBlocks);
    most_cut = std::max(most_cut, sender.cut_last());
    if (!any) return false;
    delta->seq = ++seq;
    ++messages;
    bytes.bytes(delta->vertices.data(),
                static_cast<std::size_t>(delta->vertex_count) * sizeof(MeshDelta::Vertex));
    bytes.bytes(delta->triangles.data(),
                static_cast<std::size_t>(delta->triangle_count) * sizeof(MeshDelta::Triangle));
    for (int n = 0; n < delta->block_count; ++n) {
      const auto& b = delta->blocks[static_cast<std::size_t>(n)];
      bytes.value(b.at);
      bytes.word(b.version);
    }
    EXPECT_TRUE(store.take(*delta));
    return true;
  }
  // Until there is nothing more; a call that only cut blocks without a surface sends nothing.
  int settle(int budget) {
    int calls = 1;
    while ((send(budget) || sender.cut_last() > 0) && calls < 100000) ++calls;
    return calls;
  }
  void expect_equal(const char* when) {
    const auto want = whole_mesh(startup.token(), map);
    const auto have = triangles_of(store.mesh());
    EXPECT_GT(want.size(), 100U) << when;
    EXPECT_EQ(have.size(), store.triangles());
    EXPECT_EQ(have.size(), want.size()) << when;
    EXPECT_TRUE(have == want) << when;
  }
};

Pose wander(int n) {
  const double a = 0.11 * n;
  const Vec3 eye(0.5 * std::cos(a), 0.4 * std::sin(a), 1.1 + 0.2 * std::sin(0.3 * n));
  return look_at(eye, eye + Vec3(std::cos(0.17 * n), std::sin(0.17 * n), -0.3));
}

TEST(MeshDeltas, OfAMovingCameraComposeToTheMesh) {
  Scenery s(small_map());
  const Scene place = room();
  for (int n = 0; n < 40; ++n) {
    // Colour comes later, as from a camera that was late: what is a surface changes by it
    // everywhere.
    s.map.integrate(render(place, small_camera(), wander(n), 0.002).view(n >= 6), wander(n), 1);
    s.send(64);
    if (n == 5 || n == 7 || n == 20) {
      s.settle(64);
      s.expect_equal("on the way");
    }
    if (n == 25) {
      s.map.clear_region(Eigen::AlignedBox3d(Vec3(0.3, -1.3, -0.1), Vec3(1.3, -0.1, 0.9)));
      s.send(64);
    }
  }
  const int calls = s.settle(64);
  s.expect_equal("at the end");
  EXPECT_EQ(s.most_cut, 64);
  std::cout << s.messages << " messages, " << s.store.blocks() << " blocks, " << s.store.triangles()
            << " triangles; at rest after " << calls << " calls\n";
  EXPECT_FALSE(s.send(64)) << "a map at rest sends nothing";
  // Everything is forgotten: so does the viewer.
  s.map.clear();
  s.settle(64);
  EXPECT_EQ(s.store.triangles(), 0U);
  s.map.integrate(render(place, small_camera(), wander(3)).view(true), wander(3), 1);
  s.map.integrate(render(place, small_camera(), wander(3)).view(true), wander(3), 1);
  s.settle(64);
  s.expect_equal("after it began anew");
}

TEST(MeshDeltas, DecayAndPagingTakeBlocksAwayAndBringThemBack) {
  TsdfConfig config = small_map(0.04);
  config.max_depth_m = 3;
  config.far_m = 4;
  config.decay_half_life_s = 8;
  Scenery s(config);
  Scene hall;
  hall.planes = {{{0, 0, 0}, Vec3::UnitZ()}, {{0, 1.2, 0}, -Vec3::UnitY()}};
  for (int i = 0; i < 14; ++i) hall.boxes.push_back({{i + 0.2, 0.3, 0}, {i + 0.5, 0.7, 0.4}});
  std::size_t least = 1U << 30U, most = 0;
  int put_away = 0, brought_back = 0;
  for (int n = 0; n < 120; ++n) {
    const double x = 5.0 * (1 - std::cos(n * std::numbers::pi / 40));
    const Pose X = look_at(Vec3(x, -0.8, 1.0), Vec3(x + 0.8, 0.6, 0.2));
    s.map.decay(0.1);
    s.map.integrate(render(hall, small_camera(), X).view(true), X, 1);
    const Vec3 at = X.translation();
    const PageStats paged = s.map.page({&at, 1}, 64);
    put_away += paged.put_away, brought_back += paged.brought_back;
    s.send(100);
    if (n % 30 != 29) continue;
    s.settle(100);
    s.expect_equal("on the way");
    least = std::min(least, s.store.blocks()), most = std::max(most, s.store.blocks());
  }
  EXPECT_GT(put_away, 0);
  EXPECT_GT(brought_back, 0);
  EXPECT_LT(least, most);
  std::cout << put_away << " chunks put away, " << brought_back << " back\n";
  // With nothing seen any more all of it is forgotten.
  for (int n = 0; n < 4000 && s.map.block_count() > 0; ++n) s.map.decay(0.1);
  s.settle(100);
  EXPECT_EQ(s.store.triangles(), 0U);
}

// Every block in view changes with every image, and the budget is a fraction of them: still each is
// sent again within a round.
TEST(MeshDeltas, NoBlockStarves) {
  Scenery s(small_map());
  const Scene place = table_top();
  const Pose X = around(3);
  const auto image = render(place, small_camera(), X);
  for (int n = 0; n < 3; ++n) s.map.integrate(image.view(true), X, 1);
  constexpr int kBudget = 24;
  const int live = s.map.block_count(), round = live / kBudget + 2;
  std::map<std::array<std::int32_t, 3>, int> last;
  for (int n = 0; n < 3 * round; ++n) {
    s.map.integrate(image.view(true), X, 1);
    if (s.send(kBudget)) {
      for (int b = 0; b < s.delta->block_count; ++b) {
        const auto& at = s.delta->blocks[static_cast<std::size_t>(b)].at;
        last[{at.x, at.y, at.z}] = n;
      }
    }
    EXPECT_EQ(s.sender.cut_last(), kBudget);
  }
  EXPECT_GT(last.size(), 100U);
  for (const auto& [at, n] : last) EXPECT_GE(n, 2 * round - 1);
  s.settle(kBudget);
  s.expect_equal("in the end");
}

TEST(MeshDeltas, SameCallsSameBytesAndWhoLostOneGetsAllAgain) {
  const Scene place = room();
  std::array<std::uint64_t, 2> digest{};
  for (auto& d : digest) {
    Scenery s(small_map());
    MeshStore lossy;
    for (int n = 0; n < 8; ++n) {
      s.map.integrate(render(place, small_camera(), wander(n)).view(true), wander(n), 1);
      if (s.send(100) && n % 3 != 1) {
        EXPECT_TRUE(lossy.take(*s.delta));
      }
    }
    s.sender.restart();
    for (bool first = true; s.send(100) || s.sender.cut_last() > 0; first = false) {
      EXPECT_EQ(s.delta->restart, first);
      EXPECT_TRUE(lossy.take(*s.delta));
    }
    s.expect_equal("the one that had all");
    EXPECT_TRUE(triangles_of(lossy.mesh()) == whole_mesh(s.startup.token(), s.map));
    d = s.bytes.digest();
  }
  EXPECT_EQ(digest[0], digest[1]);
}

TEST(MeshDeltas, AStoreTakesNothingOfAMessageThatDoesNotFit) {
  Scenery s(small_map());
  for (int n = 0; n < 2; ++n)
    s.map.integrate(render(table_top(), small_camera(), around(0)).view(true), around(0), 1);
  ASSERT_TRUE(s.send(200));
  const auto before = triangles_of(s.store.mesh());
  const auto refused = [&](const char* what, auto&& spoil) {
    auto bad = std::make_unique<MeshDelta>(*s.delta);
    spoil(*bad);
    EXPECT_FALSE(s.store.take(*bad)) << what;
    EXPECT_TRUE(triangles_of(s.store.mesh()) == before) << what;
  };
  refused("an index", [](MeshDelta& d) { d.triangles[0][1] = d.blocks[0].vertices; });
  refused("too many", [](MeshDelta& d) { d.block_count = MeshDelta::kMostBlocks + 1; });
  refused("fewer than none", [](MeshDelta& d) { d.vertex_count = -1; });
  refused("a block more", [](MeshDelta& d) { ++d.blocks[0].triangles; });
  refused("a vertex less", [](MeshDelta& d) { --d.vertex_count; });
  refused("no number", [](MeshDelta& d) { d.vertices[3].y = std::nanf(""); });
  EXPECT_TRUE(s.store.take(*s.delta)) << "the same again";
  EXPECT_TRUE(triangles_of(s.store.mesh()) == before);
}

TEST(MeshDeltas, Cost) {
  Scenery s(small_map(0.01));
  const Scene place = room();
  for (int n = 0; n < 3; ++n)
    s.map.integrate(render(place, kinect2(), wander(n)).view(true), wander(n), 2);
  std::vector<double> us;
  int looked = 0;
  const double t0 = thread_cpu_ms();
  s.settle(128);
  const double all = thread_cpu_ms() - t0;
  looked = s.map.block_count();
  for (int n = 0; n < 20; ++n) {
    const double t = thread_cpu_ms();
    EXPECT_FALSE(s.sender.next(128, *s.delta));
    us.push_back(1e3 * (thread_cpu_ms() - t));
  }
  std::cout << looked << " blocks, " << 1e3 * all / looked
            << " us each, message and store with it; " << quantile(us, 0.5)
            << " us a call when nothing has changed\n";
}

}  // namespace
}  // namespace tests
