#include <gtest/gtest.h>

#include <map>
#include <set>

#include "perception/tsdf/mesh/marching_cubes.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

namespace mc = marching_cubes;

TEST(MarchingCubes, EveryCaseIsClosedWithinItsFaces) {
  for (int c = 0; c < 256; ++c) {
    const mc::Case& m = mc::kCases[static_cast<std::size_t>(c)];
    std::set<int> used, crossed;
    std::map<std::pair<int, int>, int> sides;
    for (std::size_t t = 0; t < m.triangles; ++t)
      for (std::size_t v = 0; v < 3; ++v) {
        used.insert(m.edge[t][v]);
        ++sides[{m.edge[t][v], m.edge[t][(v + 1) % 3]}];
      }
    for (int e = 0; e < 12; ++e) {
      const int a = mc::kEdges[static_cast<std::size_t>(e)].corner,
                b = a | mc::axis_bit(mc::kEdges[static_cast<std::size_t>(e)].axis);
      if (((c >> a) & 1) != ((c >> b) & 1)) crossed.insert(e);
    }
    EXPECT_EQ(used, crossed) << c;
    // A side without its reverse lies on a face of the cell: both edges share that face.
    for (const auto& [side, count] : sides) {
      EXPECT_EQ(count, 1) << c;
      if (sides.contains({side.second, side.first})) continue;
      const auto corners = [](int e) {
        const int a = mc::kEdges[static_cast<std::size_t>(e)].corner;
        return std::pair{a, a | mc::axis_bit(mc::kEdges[static_cast<std::size_t>(e)].axis)};
      };
      const auto [a, b] = corners(side.first);
      const auto [d, e] = corners(side.second);
      bool face = false;
      for (const int bit : {1, 2, 4})
        face |= ((a & bit) == (b & bit)) && ((d & bit) == (e & bit)) && ((a & bit) == (d & bit));
      EXPECT_TRUE(face) << c;
    }
  }
  EXPECT_EQ(mc::kCases[0].triangles, 0);
  EXPECT_EQ(mc::kCases[255].triangles, 0);
  EXPECT_EQ(mc::kCases[1].triangles, 1);
  EXPECT_EQ(mc::kCases[0x0f].triangles, 2);
}

// Two cells side by side, any signs: what one leaves open on the shared face the other closes.
TEST(MarchingCubes, NeighboursAgreeOnTheSharedFace) {
  for (int axis = 0; axis < 3; ++axis) {
    const int bit = mc::axis_bit(axis);
    for (int face = 0; face < 16; ++face) {
      // Corners of the shared face in this cell (bit set) and in the next one (bit clear).
      int low = 0, high = 0, n = 0;
      for (int corner = 0; corner < 8; ++corner)
        if ((corner & bit) == 0) {
          if (((face >> n) & 1) != 0) low |= 1 << corner, high |= 1 << (corner | bit);
          ++n;
        }
      const auto open = [&](int c, bool upper) {
        std::multiset<std::pair<int, int>> sides;
        const mc::Case& m = mc::kCases[static_cast<std::size_t>(c)];
        const auto on_face = [&](int e) {
          const mc::Edge& edge = mc::kEdges[static_cast<std::size_t>(e)];
          return edge.axis != axis && ((edge.corner & bit) != 0) == upper;
        };
        const auto name = [&](int e) {  // the same name in both cells
          const mc::Edge& edge = mc::kEdges[static_cast<std::size_t>(e)];
          return (edge.corner & ~bit) * 3 + edge.axis;
        };
        std::set<std::pair<int, int>> all;
        for (std::size_t t = 0; t < m.triangles; ++t)
          for (std::size_t v = 0; v < 3; ++v) all.insert({m.edge[t][v], m.edge[t][(v + 1) % 3]});
        for (const auto& [a, b] : all)
          if (!all.contains({b, a}) && on_face(a) && on_face(b))
            sides.insert(upper ? std::pair{name(a), name(b)} : std::pair{name(b), name(a)});
        return sides;
      };
      for (int rest = 0; rest < 16; ++rest) {
        int below = high, above = low, m = 0;
        for (int corner = 0; corner < 8; ++corner)
          if ((corner & bit) == 0) {
            if (((rest >> m) & 1) != 0) below |= 1 << corner;
            if (((rest >> (m ^ 1)) & 1) != 0) above |= 1 << (corner | bit);
            ++m;
          }
        EXPECT_EQ(open(below, true), open(above, false)) << axis << " " << face << " " << rest;
      }
    }
  }
}

// A map that holds the exact field of a shape: views from all round would leave gaps.
struct Field {
  rt::Startup startup;
  TsdfMap map{startup.token(), small_map(0.02)};
  Mesh mesh;

  explicit Field(const Scene& scene) {
    // Frames from all sides allocate the blocks; then every node gets the true distance.
    for (int n = 0; n < 14; ++n) {
      const double a = 0.9 * n, b = -1.2 + 0.18 * n;
      const Pose X =
          look_at(Vec3(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b)) * 1.2,
                  Vec3(1e-4, 0, 0));
      map.integrate(render(scene, small_camera(), X).view(true), X, 1);
    }
    map.for_each_block([&](std::int32_t b, BlockCoord at) {
      auto* words = const_cast<std::uint32_t*>(map.block_words(b));
      for (int n = 0; n < 512; ++n) {
        const Vec3 p =
            0.02 * Vec3(at.x * 8 + (n >> 6), at.y * 8 + ((n >> 3) & 7), at.z * 8 + (n & 7));
        const double d = std::clamp(scene.distance(p) / 0.05, -1.0, 1.0);
        words[n] = TsdfMap::make_word(static_cast<int>(std::lround(d * 32767)), 1280);
      }
    });
    // Not every node beside the true surface was seen near.
    mesh = extract_mesh(startup.token(), map, {.needs_readings = false});
  }
};

struct Topology {
  long vertices = 0, edges = 0, faces = 0, open = 0, twisted = 0;
};

Topology topology(const Mesh& m) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> sides;
  std::set<std::uint32_t> used;
  for (const auto& t : m.triangles)
    for (std::size_t v = 0; v < 3; ++v) ++sides[{t[v], t[(v + 1) % 3]}], used.insert(t[v]);
  Topology r;
  r.vertices = static_cast<long>(used.size()), r.faces = static_cast<long>(m.triangles.size());
  for (const auto& [s, count] : sides) {
    r.twisted += count != 1;
    const bool paired = sides.contains({s.second, s.first});
    r.open += !paired;
    if (!paired || s.first < s.second) ++r.edges;
  }
  return r;
}

TEST(Mesh, SphereIsClosedRoundAndOnTheSurface) {
  Scene scene;
  const Vec3 centre(0.013, -0.007, 0.021);  // off the grid, across the origin
  scene.spheres = {{centre, 0.25}};
  const Field f(scene);
  const Topology t = topology(f.mesh);
  EXPECT_EQ(t.open, 0);
  EXPECT_EQ(t.twisted, 0);
  EXPECT_EQ(t.vertices - t.edges + t.faces, 2);
  EXPECT_EQ(static_cast<std::size_t>(t.vertices), f.mesh.vertices_W.size());
  double worst = 0, area = 0, volume = 0;
  for (std::size_t i = 0; i < f.mesh.vertices_W.size(); ++i) {
    const Vec3 r = f.mesh.vertices_W[i].cast<double>() - centre;
    worst = std::max(worst, std::fabs(r.norm() - 0.25));
    EXPECT_GT(f.mesh.normals_W[i].cast<double>().dot(r.normalized()), 0.99);
    EXPECT_NEAR(f.mesh.normals_W[i].norm(), 1, 1e-5);
  }
  for (const auto& tri : f.mesh.triangles) {
    const Vec3 a = f.mesh.vertices_W[tri[0]].cast<double>() - centre,
               b = f.mesh.vertices_W[tri[1]].cast<double>() - centre,
               c = f.mesh.vertices_W[tri[2]].cast<double>() - centre;
    area += 0.5 * (b - a).cross(c - a).norm();
    volume += a.dot(b.cross(c)) / 6;
  }
  std::printf("sphere: %ld vertices, worst %.3f mm, area %.4f of %.4f m2\n", t.vertices,
              worst * 1e3, area, 4 * M_PI * 0.0625);
  EXPECT_LT(worst, 0.0006);  // second order: voxel^2 / (8 r)
  EXPECT_NEAR(area, 4 * M_PI * 0.0625, 0.01);
  EXPECT_NEAR(volume, 4.0 / 3 * M_PI * 0.25 * 0.25 * 0.25, 5e-4);  // positive: seen from outside
}

TEST(Mesh, TwoTouchingBoxesStayClosed) {
  Scene scene;  // a shared edge makes ambiguous faces
  scene.boxes = {{{-0.21, -0.21, -0.15}, {-0.01, -0.01, 0.15}},
                 {{-0.011, -0.009, -0.15}, {0.2, 0.21, 0.15}}};
  const Topology t = topology(Field(scene).mesh);
  EXPECT_EQ(t.open, 0);
  EXPECT_EQ(t.twisted, 0);
  EXPECT_GT(t.faces, 1000);
}

TEST(Mesh, FusedRoomLiesOnTheWallsWithoutShadowSurfaces) {
  rt::Startup startup;
  TsdfMap map(startup.token(), small_map(0.02));
  const Scene scene = room();
  for (int n = 0; n < 6; ++n) {
    const Pose X = look_at(Vec3(-1.0 + 0.2 * n, -0.3, 1.3), Vec3(1.5, 0.3 * n - 0.5, 0.6));
    map.integrate(render(scene, small_camera(), X).view(true), X, 1);
  }
  const Mesh m = extract_mesh(startup.token(), map);
  std::vector<double> mm;
  for (const auto& v : m.vertices_W) {
    ASSERT_TRUE(v.allFinite());
    mm.push_back(std::fabs(scene.distance(v.cast<double>())) * 1e3);
  }
  std::printf("room: %zu vertices, median %.2f p95 %.2f p99 %.2f mm\n", mm.size(),
              quantile(mm, 0.5), quantile(mm, 0.95), quantile(mm, 0.99));
  EXPECT_GT(mm.size(), 10000U);
  EXPECT_LT(quantile(mm, 0.5), 2.0);
  EXPECT_LT(quantile(mm, 0.95), 12.0);
}

// Things before a wall, seen from all over: where their shadows meet what was seen past them there
// is no surface.
TEST(Mesh, NothingIsMadeWhereNoReadingEnded) {
  rt::Startup startup;
  TsdfMap coloured(startup.token(), small_map(0.01)), plain(startup.token(), small_map(0.01));
  const Scene scene = table_top();
  for (int n = 0; n < 40; ++n) {
    const Pose X = around(n);
    const Frame f = render(scene, small_camera(), X);
    coloured.integrate(f.view(true), X, 1);
    plain.integrate(f.view(false), X, 1);
  }
  struct Count {
    std::size_t near = 0, stray = 0;
  };
  const auto count = [&](const TsdfMap& map, bool needs_readings) {
    Count c;
    const Mesh m =
        extract_mesh(startup.token(), map, {.needs_readings = needs_readings, .refined = false});
    for (const auto& v : m.vertices_W) {
      const double d = std::fabs(scene.distance(v.cast<double>()));
      c.near += d < 0.005 ? 1 : 0;
      c.stray += d > 0.010 ? 1 : 0;
    }
    return c;
  };
  const Count with = count(coloured, true), without = count(coloured, false);
  std::printf("things before a wall: %zu of %zu stray vertices stay, %zu of %zu good ones\n",
              with.stray, without.stray, with.near, without.near);
  EXPECT_GT(without.stray, 10U);
  EXPECT_LE(3 * with.stray, without.stray);
  EXPECT_GE(with.near, without.near * 98 / 100) << "what is seen at a grazing angle goes too";
  // Without colour nobody knows where readings ended.
  const Count a = count(plain, true), b = count(plain, false);
  EXPECT_EQ(a.stray, b.stray);
  EXPECT_EQ(a.near, b.near);
}

}  // namespace
}  // namespace tests
