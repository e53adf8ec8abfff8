// What waits for a viewer: the mesh by blocks, the newest of each kind, answers in order.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <set>

#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "rt/random.hpp"
#include "tools/console/viewer_mailbox.hpp"

namespace {

using perception::MeshDelta;
using teletact::ConsoleMesh;
using teletact::make_view;
using teletact::ViewBytes;
using teletact::ViewerMailbox;
using teletact::ViewKind;

constexpr double kEdge = 0.08;

// A page's side, from the contract's text alone.
struct Page {
  struct Block {
    std::uint32_t version = 0;
    std::vector<std::array<double, 3>> vertices;
    std::vector<std::array<int, 3>> colours, triangles;
  };
  std::map<std::array<int, 3>, Block> blocks;
  std::uint32_t expected = 0;
  int restarts = 0, messages = 0;
  std::size_t longest = 0;

  void take(const ViewBytes& bytes) {
    const std::vector<std::uint8_t>& b = *bytes;
    std::size_t at = 24;
    const auto number = [&](std::size_t n) {
      std::uint64_t v = 0;
      for (std::size_t i = 0; i < n; ++i) v |= std::uint64_t{b.at(at + i)} << (8 * i);
      at += n;
      return v;
    };
    ASSERT_EQ(b.at(0), 3);
    ASSERT_EQ(b.at(1), 1);
    ++messages;
    longest = std::max(longest, b.size());
    const auto seq = static_cast<std::uint32_t>(number(4));
    const bool restart = number(1) == 1;
    at += 3;
    if (restart) {
      blocks.clear();
      expected = 0;
      ++restarts;
    }
    ASSERT_EQ(seq, expected++);
    struct Head {
      std::array<int, 3> at;
      std::uint32_t version;
      std::size_t vertices, triangles;
    };
    std::vector<Head> heads(number(4));
    for (Head& h : heads) {
      for (int& c : h.at) c = static_cast<std::int32_t>(number(4));
      h.version = static_cast<std::uint32_t>(number(4));
      h.vertices = number(2);
      h.triangles = number(2);
    }
    const auto edge_bits = static_cast<std::uint32_t>(number(4));
    float edge = 0;
    std::memcpy(&edge, &edge_bits, 4);
    for (const Head& h : heads) {
      Block& block = blocks[h.at] = {h.version, {}, {}, {}};
      for (std::size_t i = 0; i < h.vertices; ++i) {
        std::array<double, 3> p{};
        for (std::size_t a = 0; a < 3; ++a)
          p[a] = h.at[a] * double{edge} - double{edge} / 8 +
                 static_cast<double>(number(2)) / 65535 * 1.25 * double{edge};
        block.vertices.push_back(p);
        block.colours.push_back({static_cast<int>(number(1)), static_cast<int>(number(1)),
                                 static_cast<int>(number(1))});
        ASSERT_EQ(number(1), 0U);
      }
    }
    for (const Head& h : heads)
      for (std::size_t i = 0; i < h.triangles; ++i)
        blocks[h.at].triangles.push_back({static_cast<int>(number(2)), static_cast<int>(number(2)),
                                          static_cast<int>(number(2))});
    ASSERT_EQ(at, b.size());
  }
};

// Blocks with a strip of triangles each.
struct Maker {
  std::unique_ptr<MeshDelta> d = std::make_unique<MeshDelta>();
  rt::Random random{11, 1};
  void begin(bool restart) {
    d->restart = restart;
    d->block_count = d->vertex_count = d->triangle_count = 0;
  }
  void block(std::array<int, 3> at, std::uint32_t version, int vertices) {
    MeshDelta::Block& b = d->blocks[static_cast<std::size_t>(d->block_count++)];
    b.at = {at[0], at[1], at[2]};
    b.version = version;
    b.vertices = static_cast<std::uint16_t>(vertices);
    b.triangles = static_cast<std::uint16_t>(std::max(0, vertices - 2));
    for (int i = 0; i < vertices; ++i) {
      auto& v = d->vertices[static_cast<std::size_t>(d->vertex_count++)];
      const auto place = [&](int c) {
        return static_cast<float>((c - 0.12 + 1.24 * random.uniform()) * kEdge);
      };
      v = {place(at[0]), place(at[1]), place(at[2]), {10, 20, static_cast<std::uint8_t>(i)}, 0};
    }
    for (int i = 0; i + 2 < vertices; ++i)
      d->triangles[static_cast<std::size_t>(d->triangle_count++)] = {
          static_cast<std::uint16_t>(i), static_cast<std::uint16_t>(i + 1),
          static_cast<std::uint16_t>(i + 2)};
  }
};

TEST(ConsoleMeshTest, APageGetsEveryBlockWithinATenthOfAMillimetre) {
  ConsoleMesh mesh;
  Maker m;
  m.begin(true);
  m.block({0, 0, 0}, 1, 6);
  m.block({-3, 5, 1}, 1, 9);
  ASSERT_TRUE(mesh.take(*m.d, {1.5, 1.25, 0}, kEdge));
  ConsoleMesh::Cursor cursor;
  Page page;
  while (const auto bytes = mesh.next(cursor)) page.take(bytes);
  ASSERT_EQ(page.blocks.size(), 2U);
  const auto& block = page.blocks.at({-3, 5, 1});
  ASSERT_EQ(block.vertices.size(), 9U);
  ASSERT_EQ(block.triangles.size(), 7U);
  for (std::size_t i = 0; i < 9; ++i) {
    const auto& v = m.d->vertices[6 + i];
    EXPECT_NEAR(block.vertices[i][0], v.x, 1e-4);
    EXPECT_NEAR(block.vertices[i][1], v.y, 1e-4);
    EXPECT_NEAR(block.vertices[i][2], v.z, 1e-4);
    EXPECT_EQ(block.colours[i], (std::array<int, 3>{10, 20, static_cast<int>(i)}));
    if (i < 7) {
      const int n = static_cast<int>(i);
      EXPECT_EQ(block.triangles[i], (std::array<int, 3>{n, n + 1, n + 2}));
    }
  }
  EXPECT_FALSE(mesh.has_news(cursor));
}

TEST(ConsoleMeshTest, ASlowViewerAndALateOneEndWithTheSameMesh) {
  ConsoleMesh mesh;
  Maker m;
  ConsoleMesh::Cursor quick, slow, late;
  Page quick_page, slow_page, late_page;
  std::map<std::array<int, 3>, std::uint32_t> truth;
  for (std::uint32_t n = 0; n < 200; ++n) {
    m.begin(n == 0);
    std::set<std::array<int, 3>> once;
    for (int i = 0; i < 20; ++i) {
      const std::array<int, 3> at{static_cast<int>(5 * m.random.uniform()),
                                  static_cast<int>(5 * m.random.uniform()),
                                  static_cast<int>(3 * m.random.uniform())};
      if (!once.insert(at).second) continue;
      m.block(at, n, m.random.uniform() < 0.1 ? 0 : 40);
      truth[at] = n;
    }
    ASSERT_TRUE(mesh.take(*m.d, {}, kEdge));
    while (const auto bytes = mesh.next(quick)) quick_page.take(bytes);
    if (n % 17 == 0)
      if (const auto bytes = mesh.next(slow)) slow_page.take(bytes);
  }
  while (const auto bytes = mesh.next(slow)) slow_page.take(bytes);
  while (const auto bytes = mesh.next(late)) late_page.take(bytes);
  for (const Page* p : {&quick_page, &slow_page, &late_page}) {
    ASSERT_EQ(p->blocks.size(), truth.size());
    EXPECT_EQ(p->restarts, 1);
    for (const auto& [at, version] : truth) EXPECT_EQ(p->blocks.at(at).version, version);
    EXPECT_LT(p->longest, ConsoleMesh::kMessageBytes + 4096);
  }
  EXPECT_LT(slow_page.messages, quick_page.messages / 4);
}

TEST(ConsoleMeshTest, ARestartReachesEachViewerOnce) {
  ConsoleMesh mesh;
  Maker m;
  ConsoleMesh::Cursor cursor;
  Page page;
  m.begin(false);
  m.block({1, 1, 1}, 1, 5);
  EXPECT_FALSE(mesh.take(*m.d, {}, kEdge)) << "waits for a restart";
  EXPECT_EQ(mesh.next(cursor), nullptr);
  for (int round = 1; round <= 3; ++round) {
    m.begin(true);
    m.block({round, 0, 0}, 1, 5);
    ASSERT_TRUE(mesh.take(*m.d, {}, kEdge));
    while (const auto bytes = mesh.next(cursor)) page.take(bytes);
    EXPECT_EQ(page.restarts, round);
    ASSERT_EQ(page.blocks.size(), 1U);
    EXPECT_EQ(page.blocks.begin()->first[0], round);
  }
  mesh.clear();
  EXPECT_EQ(mesh.bytes(), 0U);
  EXPECT_EQ(mesh.next(cursor), nullptr);
  m.begin(true);  // a map without a surface
  ASSERT_TRUE(mesh.take(*m.d, {}, kEdge));
  while (const auto bytes = mesh.next(cursor)) page.take(bytes);
  EXPECT_EQ(page.restarts, 4);
  EXPECT_TRUE(page.blocks.empty());
}

TEST(ConsoleMeshTest, WhatIsNoMeshIsRefused) {
  ConsoleMesh mesh;
  Maker m;
  const auto spoiled = [&](auto spoil) {
    m.begin(true);
    m.block({0, 0, 0}, 1, 6);
    spoil(*m.d);
    return mesh.take(*m.d, {}, kEdge);
  };
  EXPECT_FALSE(spoiled([](MeshDelta& d) { d.vertex_count = 5; }));
  EXPECT_FALSE(spoiled([](MeshDelta& d) { d.triangle_count = 5; }));
  EXPECT_FALSE(spoiled([](MeshDelta& d) { d.block_count = -1; }));
  EXPECT_FALSE(spoiled([](MeshDelta& d) { d.block_count = MeshDelta::kMostBlocks + 1; }));
  EXPECT_FALSE(spoiled([](MeshDelta& d) { d.triangles[0][1] = 6; }));
  EXPECT_FALSE(
      spoiled([](MeshDelta& d) { d.vertices[2].y = std::numeric_limits<float>::quiet_NaN(); }));
  EXPECT_FALSE(mesh.take(*m.d, {}, 0));
  EXPECT_EQ(mesh.blocks(), 0U);
  EXPECT_TRUE(spoiled([](MeshDelta&) {}));
  m.begin(false);
  EXPECT_FALSE(mesh.take(*m.d, {}, 2 * kEdge)) << "blocks of another size";
}

TEST(ViewerMailboxTest, TheNewestWinsAnswersGoFirstAndNoneStarves) {
  const ConsoleMesh mesh;
  ViewerMailbox box;
  const auto view = [](ViewKind kind, std::uint32_t n) {
    return make_view(kind, n, {}, std::vector<std::uint8_t>(10));
  };
  EXPECT_FALSE(box.put(ViewKind::kPose, view(ViewKind::kPose, 1)));
  EXPECT_TRUE(box.put(ViewKind::kPose, view(ViewKind::kPose, 2)));
  EXPECT_FALSE(box.put(ViewKind::kPicture, view(ViewKind::kPicture, 1)));
  EXPECT_TRUE(box.put_answer(view(ViewKind::kAnswer, 1)));
  EXPECT_TRUE(box.put_answer(view(ViewKind::kAnswer, 2)));
  const auto next = [&] {
    const ViewBytes v = box.next(mesh);
    return v ? std::pair(int{(*v)[0]}, int{(*v)[4]}) : std::pair(0, 0);
  };
  EXPECT_EQ(next(), std::pair(7, 1));
  EXPECT_EQ(next(), std::pair(7, 2));
  EXPECT_EQ(next(), std::pair(2, 2));
  // A pose that is always there does not hold up the picture.
  box.put(ViewKind::kPose, view(ViewKind::kPose, 3));
  EXPECT_EQ(next(), std::pair(4, 1));
  EXPECT_EQ(next(), std::pair(2, 3));
  EXPECT_EQ(next(), std::pair(0, 0));
  EXPECT_EQ(box.bytes(), 0U);
}

TEST(ViewerMailboxTest, WhatIsSmallGoesPastWhatIsHeldBack) {
  const ConsoleMesh mesh;
  ViewerMailbox box;
  for (const ViewKind kind : {ViewKind::kPicture, ViewKind::kCostMap, ViewKind::kMoving,
                              ViewKind::kText, ViewKind::kPose, ViewKind::kSelection})
    box.put(kind, make_view(kind, 1, {}, std::vector<std::uint8_t>(10)));
  std::vector<int> left;
  for (const bool bulk : {false, true})
    while (const ViewBytes v = box.next(mesh, bulk)) left.push_back(int{(*v)[0]});
  EXPECT_EQ(left.size(), 6U);
  std::sort(left.begin(), left.begin() + 3);
  EXPECT_EQ((std::vector<int>{left.begin(), left.begin() + 3}), (std::vector<int>{1, 2, 8}));
}

TEST(ViewerMailboxTest, AnswersHaveACap) {
  ViewerMailbox box;
  int n = 0;
  while (n < 100000 &&
         box.put_answer(make_view(ViewKind::kAnswer, 0, {}, std::vector<std::uint8_t>(100))))
    ++n;
  EXPECT_LE(box.bytes(), ViewerMailbox::kMostAnswerBytes);
  EXPECT_GT(n, 1000);
  EXPECT_LT(n, 100000);
}

}  // namespace
