// What is put away far from the camera: bytes, pages, and a map that is the same as one that never
// did it.
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <vector>

#include "perception/geometry/no_colour.hpp"
#include "perception/tsdf/pager/chunk_record.hpp"
#include "perception/tsdf/pager/far_store.hpp"
#include "rt/memory/section.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace tests {
namespace {

using Body = std::array<std::uint8_t, kMostBlockBytes>;

std::size_t encode(const BlockImage& b, Body& out) {
  const std::span<const LabelVoxel> labels(b.labels);
  return encode_block(b.words, b.colours, b.free,
                      b.labelled ? labels : std::span<const LabelVoxel>{}, out);
}

// Read 1 to 15 times, coloured as often, less often or never.
std::uint32_t random_colour(rt::Random& random) {
  const std::int64_t read = random.integer(1, kMostCounted), some = random.integer(0, read);
  const auto coloured = static_cast<std::uint32_t>(random.uniform() < 0.5 ? read : some);
  const std::uint32_t rgb = static_cast<std::uint32_t>(random()) & 0xffffffU;
  return (coloured > 0 ? rgb : 0U) | static_cast<std::uint32_t>(read) << 24U | coloured << 28U;
}

// Any content a map can hold: `known` of the voxels, distances near each other or not.
BlockImage random_block(rt::Random& random, double known, bool smooth) {
  BlockImage b;
  int d = static_cast<int>(random.integer(-32767, 32767));
  for (std::size_t i = 0; i < b.words.size(); ++i) {
    d = smooth ? std::clamp(d + static_cast<int>(random.integer(-300, 300)), -32767, 32767)
               : static_cast<int>(random.integer(-32767, 32767));
    if (random.uniform() < known)
      b.words[i] = TsdfMap::make_word(d, static_cast<int>(random.integer(1, kMostRawWeight)));
    if (random.uniform() < 0.5 * known) b.colours[i] = random_colour(random);
  }
  for (std::uint64_t& f : b.free) {
    const double kind = random.uniform();
    f = kind < 0.3 ? 0 : kind < 0.6 ? ~0ULL : random();
  }
  b.labelled = random.uniform() < 0.3;
  for (LabelVoxel& v : b.labels)
    if (b.labelled)
      v = {static_cast<std::uint8_t>(random.integer(0, kMostLabel)),
           static_cast<std::uint8_t>(random.integer(0, kLabelWeightCap))};
  return b;
}

TEST(BlockCodec, RoundTripIsExact) {
  Body bytes;
  BlockImage back;
  std::size_t most = 0, least = bytes.size();
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    rt::Random random(seed);
    const BlockImage b = random_block(random, random.uniform(), seed % 2 == 0);
    const std::size_t n = encode(b, bytes);
    most = std::max(most, n), least = std::min(least, n);
    ASSERT_TRUE(decode_block({bytes.data(), n}, back)) << "seed " << seed;
    ASSERT_EQ(back, b) << "seed " << seed;
  }
  const std::size_t n = encode(BlockImage{}, bytes);
  EXPECT_EQ(n, kLeastBlockBytes);
  ASSERT_TRUE(decode_block({bytes.data(), n}, back));
  EXPECT_EQ(back, BlockImage{});
  std::printf("  random blocks: %zu to %zu bytes\n", least, most);
  EXPECT_LT(most, kMostBlockBytes);
}

TEST(BlockCodec, RefusesWhatAMapCanNotHold) {
  Body bytes;
  BlockImage back;
  const auto decodes = [&](const BlockImage& b) {
    return decode_block({bytes.data(), encode(b, bytes)}, back);
  };
  BlockImage b;
  b.words[77] = TsdfMap::make_word(100, kMostRawWeight);
  EXPECT_TRUE(decodes(b));
  b.words[77] = TsdfMap::make_word(100, kMostRawWeight + 1);
  EXPECT_FALSE(decodes(b));
  b.words[77] = TsdfMap::make_word(-32768, 1000);
  EXPECT_FALSE(decodes(b));
  b = {};
  b.colours[3] = 0x030201U | 15U << 24U | 15U << 28U;
  EXPECT_TRUE(decodes(b));
  b.colours[3] = 5U << 24U;
  EXPECT_TRUE(decodes(b)) << "never coloured";
  b.colours[3] = 0x030201U | 5U << 24U | 6U << 28U;
  EXPECT_FALSE(decodes(b)) << "coloured more often than read";
  b.colours[3] = 0x030201U | 5U << 24U;
  EXPECT_FALSE(decodes(b)) << "a colour that never came";
  b.colours[3] = 0x030201U;
  EXPECT_FALSE(decodes(b)) << "never read";
  b = {};
  b.labelled = true;
  b.labels[0] = {kMostLabel + 1, 1};
  EXPECT_FALSE(decodes(b));
  b.labels[0] = {1, kLabelWeightCap + 1};
  EXPECT_FALSE(decodes(b));
}

TEST(BlockCodec, DamagedBytesAreReadWithinTheirBounds) {
  rt::Random random(5);
  Body bytes;
  BlockImage back;
  int read = 0;
  for (int n = 0; n < 4000; ++n) {
    const std::size_t size = encode(random_block(random, 0.5, true), bytes);
    // A copy of exactly that size: reading beyond it is seen by the sanitizer.
    std::vector<std::uint8_t> damaged(bytes.begin(),
                                      bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const auto flips = random.integer(1, 8);
    for (std::int64_t f = 0; f < flips; ++f)
      damaged[static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(size) - 1))] ^=
          static_cast<std::uint8_t>(1U << (random() & 7U));
    if (n % 3 == 0)
      damaged.resize(
          static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(size) - 1)));
    const bool ok = decode_block(damaged, back);
    read += ok ? 1 : 0;
    if (n % 3 == 0) {
      EXPECT_FALSE(ok) << "cut off";
    }
  }
  std::printf("  %d of 4000 damaged blocks were still blocks\n", read);
}

TEST(ChunkIndex, ComesAndGoesLikeAMap) {
  rt::Startup startup;
  ChunkIndex index(startup.token(), 24);  // 64 slots: probes collide and wrap
  std::map<std::array<int, 3>, std::int32_t> reference;
  rt::Random random(8);
  for (int n = 0; n < 20000; ++n) {
    const std::array<int, 3> at{static_cast<int>(random.integer(-3, 3)),
                                static_cast<int>(random.integer(-70000, -69998)),
                                static_cast<int>(random.integer(0, 4))};
    const auto held = reference.find(at);
    ASSERT_EQ(index.find(at[0], at[1], at[2]),
              held == reference.end() ? ChunkIndex::kNone : held->second);
    if (held != reference.end()) {
      index.erase(at[0], at[1], at[2]);
      reference.erase(held);
    } else if (reference.size() < 24) {
      index.insert(at[0], at[1], at[2], n);
      reference[at] = n;
    }
    index.erase(1000, 0, 0);  // of what is not there: nothing
  }
  for (const auto& [at, value] : reference) EXPECT_EQ(index.find(at[0], at[1], at[2]), value);
}

TEST(FarStore, HoldsRecordsLikeAMapUntilItIsFull) {
  rt::Startup startup;
  FarStore store(startup.token(), 40 * FarStore::kPage, 1000);
  std::map<int, std::vector<std::uint8_t>> reference;
  rt::Random random(4);
  int refused = 0;
  for (int n = 0; n < 5000; ++n) {
    const int at = static_cast<int>(random.integer(0, 30));
    if (reference.count(at) != 0) {
      const std::int32_t record = store.find(at, -at, 7);
      ASSERT_NE(record, FarStore::kNone);
      FarStore::Reader reader(store, record);
      std::vector<std::uint8_t> read(reader.left()), more(1);
      const std::size_t half = read.size() / 2;
      ASSERT_TRUE(reader.read(std::span(read).first(half)));
      ASSERT_TRUE(reader.read(std::span(read).subspan(half)));
      ASSERT_FALSE(reader.read(more));
      ASSERT_EQ(read, reference[at]);
      store.drop(record);
      reference.erase(at);
      continue;
    }
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(random.integer(1, 3000)));
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    bool ok = store.begin();
    for (std::size_t done = 0; ok && done < bytes.size();) {
      const std::size_t part = std::min<std::size_t>(
          bytes.size() - done, static_cast<std::size_t>(random.integer(1, 700)));
      ok = store.append(std::span(bytes).subspan(done, part));
      done += part;
    }
    FarStore::Record about;
    about.x = at, about.y = -at, about.z = 7, about.blocks = 1;
    if (ok) {
      store.commit(about);
      reference[at] = bytes;
    } else {
      ++refused;
    }
    ASSERT_EQ(store.size(), static_cast<int>(reference.size()));
    ASSERT_EQ(store.blocks(), store.size());
    std::size_t pages = 0;
    for (const auto& [key, held] : reference)
      pages += (held.size() + FarStore::kPage - 1) / FarStore::kPage;
    ASSERT_EQ(store.bytes_used(), pages * FarStore::kPage) << "pages leak";
  }
  EXPECT_GT(refused, 50);
}

// ---------------------------------------------------------------- the map

// A passage of 16 m with things in it, and a camera that looks 1.5 m ahead.
Scene passage() {
  Scene s;
  s.planes = {
      {{0, 0, 0}, Vec3::UnitZ()}, {{0, 0.9, 0}, -Vec3::UnitY()}, {{0, -0.9, 0}, Vec3::UnitY()}};
  for (int n = 0; n < 12; ++n) {
    const double x = 0.8 + 1.3 * n, y = n % 2 == 0 ? 0.55 : -0.5;
    if (n % 3 == 0) {
      s.spheres.push_back({{x, y, 0.3}, 0.22});
    } else {
      s.boxes.push_back({{x, y - 0.2, 0}, {x + 0.3, y + 0.2, 0.3 + 0.1 * (n % 4)}});
    }
  }
  return s;
}
// Forth and back.
Pose walk(int n, int frames) {
  const double x = 12.0 * (n < frames / 2 ? n : frames - n) / (frames / 2);
  const double side = 0.25 * std::sin(0.3 * n);
  return look_at({x, side, 0.9}, {x + (n < frames / 2 ? 1.0 : -1.0), 0.5 * side, 0.45});
}
TsdfConfig walk_map(int far_kib) {
  TsdfConfig c = small_map(0.02);
  c.max_depth_m = 1.6;
  c.far_m = 2.6;
  c.far_store_kib = far_kib;
  return c;
}
constexpr int kFrames = 80;
constexpr int kAll = 1 << 20, kNever = -1;

// Everything a map holds, chunk by chunk.
std::vector<std::vector<std::uint8_t>> content(const TsdfMap& map) {
  rt::Startup startup;
  std::vector<std::vector<std::uint8_t>> out;
  map.write_records(startup.token(),
                    [&](std::span<const std::uint8_t> r) { out.emplace_back(r.begin(), r.end()); });
  return out;
}

struct Walked {
  std::int64_t fused = 0, carved = 0;
  int most_blocks = 0, refused = 0, fetched = 0, put_away = 0, brought_back = 0, near_refused = 0;
};

Walked walk_through(TsdfMap& map, int budget, bool labels = true) {
  const Intrinsics k = small_camera();
  static const Scene scene = passage();
  Walked w;
  std::vector<std::uint8_t> image(static_cast<std::size_t>(k.width * k.height));
  for (int n = 0; n < kFrames; ++n) {
    const Pose X = walk(n, kFrames);
    const auto s = map.integrate(render(scene, k, X).view(true), X, 1);
    w.fused += s.voxels_fused, w.carved += s.voxels_carved;
    w.refused += s.blocks_refused + s.chunks_refused;
    w.fetched += s.blocks_fetched;
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u)
        image[static_cast<std::size_t>(v * k.width + u)] =
            u > 40 && u < 80 && v > 50 ? static_cast<std::uint8_t>(1 + n / 10) : std::uint8_t{0};
    if (labels) map.vote_labels({image.data(), k.width, k.height, k.width});
    // kNever: all that the image does not show goes at once, and only integrate() brings it back.
    const Vec3 at = budget == kNever ? Vec3(0, 0, 1000) : X.translation();
    const auto p = map.page({&at, 1}, budget == kNever ? kAll : budget);
    w.put_away += p.put_away, w.brought_back += p.brought_back, w.near_refused += p.refused;
    EXPECT_EQ(p.labels_refused, 0);
    w.most_blocks = std::max(w.most_blocks, map.block_count());
  }
  return w;
}

TEST(FarBlocks, AMapThatPagesIsTheMapThatDoesNot) {
  rt::Startup startup;
  TsdfMap plain(startup.token(), walk_map(0));
  const Walked want = walk_through(plain, kAll);
  EXPECT_EQ(want.refused, 0);
  EXPECT_EQ(plain.far_chunk_count(), 0);
  const auto reference = content(plain);
  for (const int budget : {kNever, 40, kAll}) {
    TsdfConfig config = walk_map(8192);
    TsdfMap map(startup.token(), config);
    const Walked got = walk_through(map, budget);
    std::printf(
        "  budget %d: %d blocks in all, at most %d in the pool; chunks %d away, %d back, %d blocks "
        "by "
        "integrate(); %.0f bytes a block\n",
        budget, plain.block_count(), got.most_blocks, got.put_away, got.brought_back, got.fetched,
        static_cast<double>(map.far_store().bytes_used()) / std::max(1, map.far_block_count()));
    EXPECT_EQ(got.fused, want.fused);
    EXPECT_EQ(got.carved, want.carved);
    EXPECT_EQ(map.block_count() + map.far_block_count(), plain.block_count());
    EXPECT_TRUE(content(map) == reference) << "budget " << budget;
    if (budget == kNever) {
      EXPECT_GT(got.fetched, 1000);
      continue;
    }
    EXPECT_GT(got.put_away, 10);
    EXPECT_LT(got.most_blocks, plain.block_count() / 2);
    // All of it back, then node by node.
    std::vector<Vec3> everywhere;
    for (int x = -4; x <= 18; ++x) everywhere.emplace_back(x, 0, 0.5);
    map.page(everywhere, kAll);
    EXPECT_EQ(map.far_chunk_count(), 0);
    int known = 0;
    for (int i = -100; i < 760; i += budget == kAll ? 1 : 7)
      for (int j = -50; j < 50; ++j)
        for (int h = -4; h < 60; ++h) {
          ASSERT_EQ(map.word_at(i, j, h), plain.word_at(i, j, h)) << i << ' ' << j << ' ' << h;
          ASSERT_EQ(map.free_at(i, j, h), plain.free_at(i, j, h));
          ASSERT_EQ(map.label_at(i, j, h), plain.label_at(i, j, h));
          known += map.word_at(i, j, h) != 0;
        }
    EXPECT_GT(known, 20000);
    EXPECT_TRUE(content(map) == reference);
  }
}

TEST(FarBlocks, APoolOfTheNearSetHoldsTheWholeWay) {
  rt::Startup startup;
  TsdfMap plain(startup.token(), walk_map(0));
  walk_through(plain, kAll);
  TsdfConfig small = walk_map(0);
  small.max_blocks = plain.block_count() / 2;
  TsdfMap refusing(startup.token(), small);
  EXPECT_GT(walk_through(refusing, kAll).refused, 0) << "the pool does not hold it all";
  small.far_store_kib = 8192;
  TsdfMap map(startup.token(), small);
  const Walked got = walk_through(map, 128);
  EXPECT_EQ(got.refused, 0);
  EXPECT_EQ(got.near_refused, 0);
  EXPECT_TRUE(content(map) == content(plain));
}

TEST(FarBlocks, ANearSetThatDoesNotFitIsSaidAndNothingIsLost) {
  rt::Startup startup;
  TsdfMap plain(startup.token(), walk_map(0));
  walk_through(plain, kAll, false);
  TsdfConfig small = walk_map(8192);
  small.max_blocks = plain.block_count() / 2;
  TsdfMap map(startup.token(), small);
  walk_through(map, 128, false);
  const auto before = content(map);
  std::vector<Vec3> everywhere;
  for (int x = -4; x <= 18; ++x) everywhere.emplace_back(x, 0, 0.5);
  const PageStats p = map.page(everywhere, kAll);
  EXPECT_GT(p.refused, 0);
  EXPECT_EQ(map.block_count() + map.far_block_count(), plain.block_count());
  EXPECT_TRUE(content(map) == before);
}

TEST(FarBlocks, AFullStoreLosesNothing) {
  rt::Startup startup;
  TsdfMap plain(startup.token(), walk_map(0));
  walk_through(plain, kAll, false);
  TsdfMap map(startup.token(), walk_map(64));
  int not_stored = 0;
  for (int n = 0; n < kFrames; ++n) {
    const Pose X = walk(n, kFrames);
    map.integrate(render(passage(), small_camera(), X).view(true), X, 1);
    const Vec3 at = X.translation();
    not_stored += map.page({&at, 1}, kAll).not_stored;
  }
  EXPECT_GT(not_stored, 0);
  EXPECT_LE(map.far_store().bytes_used(), std::size_t{64} << 10U);
  EXPECT_TRUE(content(map) == content(plain));
}

// A camera that was carried off looks where everything was put away.
TEST(FarBlocks, AViewIsFetchedInPartsAndMakesRoomForItself) {
  rt::Startup startup;
  TsdfConfig config = walk_map(8192);
  TsdfMap plain(startup.token(), walk_map(0));
  walk_through(plain, kAll, false);
  config.max_blocks = plain.block_count() / 3;
  TsdfMap map(startup.token(), config);
  for (const auto& r : content(plain))  // from the near end on; the rest is put away
    ASSERT_EQ(map.take_record(startup.token(), r), TsdfMap::Taken::kOk);
  const Pose X = look_at({9, 0, 0.9}, {10, 0, 0.45});
  int calls = 0, put_away = 0;
  PageStats p;
  do {
    p = map.fetch_view(small_camera(), X, 200);
    EXPECT_LE(p.blocks_moved, 200 + 2 * TsdfMap::kChunkBlocks);
    EXPECT_EQ(p.refused, 0);
    put_away += p.put_away;
    ++calls;
  } while (p.waiting > 0 && calls < 100);
  EXPECT_GT(calls, 1);
  EXPECT_GT(put_away, 0) << "the pool was full of what is elsewhere";
  EXPECT_LT(calls, 100);
  EXPECT_EQ(map.fetch_view(small_camera(), X, 200).blocks_moved, 0) << "now it is all there";
  int seen = 0;
  for (int i = 450; i < 520; ++i)
    for (int j = -20; j < 20; ++j)
      for (int h = -2; h < 20; ++h) {
        ASSERT_EQ(map.word_at(i, j, h), plain.word_at(i, j, h));
        seen += map.word_at(i, j, h) != 0;
      }
  EXPECT_GT(seen, 5000);
  EXPECT_TRUE(content(map) == content(plain));
}

TEST(FarBlocks, AForgottenLabelStaysForgottenAlthoughItsNumberIsUsedAgain) {
  rt::Startup startup;
  const auto labelled = [](const TsdfMap& map, std::uint8_t label) {
    int n = 0;
    for (int i = -100; i < 760; ++i)
      for (int j = -50; j < 50; ++j)
        for (int h = -4; h < 40; ++h) n += map.label_at(i, j, h).label == label;
    return n;
  };
  TsdfMap plain(startup.token(), walk_map(0)), map(startup.token(), walk_map(8192));
  walk_through(plain, kAll), walk_through(map, kAll);
  ASSERT_GT(labelled(plain, 3), 0);
  ASSERT_EQ(labelled(map, 3), 0) << "is put away";
  ASSERT_GT(map.far_chunk_count(), 0);
  plain.forget_label(3), map.forget_label(3);
  EXPECT_TRUE(content(map) == content(plain));
  std::vector<Vec3> everywhere;
  for (int x = -4; x <= 18; ++x) everywhere.emplace_back(x, 0, 0.5);
  map.page(everywhere, kAll);
  EXPECT_EQ(labelled(map, 3), 0);
  EXPECT_EQ(labelled(map, 2), labelled(plain, 2));
}

TEST(FarBlocks, ARegionIsClearedWhereverItIs) {
  rt::Startup startup;
  TsdfMap plain(startup.token(), walk_map(0)), map(startup.token(), walk_map(8192));
  walk_through(plain, kAll), walk_through(map, kAll);
  const Eigen::AlignedBox3d box(Vec3(4.1, -0.7, -0.1), Vec3(9.3, 0.3, 0.5));
  plain.clear_region(box), map.clear_region(box);
  EXPECT_TRUE(content(map) == content(plain));
  map.clear();
  EXPECT_EQ(map.far_chunk_count(), 0);
  EXPECT_TRUE(content(map).empty());
}

TEST(FarBlocks, RecordsAreTakenBackAndTakenOnce) {
  rt::Startup startup;
  TsdfMap map(startup.token(), walk_map(8192));
  walk_through(map, 128);
  const auto records = content(map);
  // Into a pool that holds all, and into one that needs the far store.
  for (const int blocks : {8192, 300}) {
    TsdfConfig config = walk_map(8192);
    config.max_blocks = blocks;
    TsdfMap back(startup.token(), config);
    for (const auto& r : records)
      ASSERT_EQ(back.take_record(startup.token(), r), TsdfMap::Taken::kOk);
    EXPECT_TRUE(content(back) == records);
    EXPECT_EQ(back.far_chunk_count() > 0, blocks == 300);
    EXPECT_EQ(back.take_record(startup.token(), records[0]), TsdfMap::Taken::kTwice);
    auto bad = records[0];
    bad.push_back(0);
    EXPECT_EQ(back.take_record(startup.token(), bad), TsdfMap::Taken::kMalformed);
    bad.resize(bad.size() - 2);
    EXPECT_EQ(back.take_record(startup.token(), bad), TsdfMap::Taken::kMalformed);
    EXPECT_TRUE(content(back) == records);
  }
  TsdfConfig tiny = walk_map(0);
  tiny.max_blocks = 3;
  TsdfMap none(startup.token(), tiny);
  EXPECT_EQ(none.take_record(startup.token(), records[1]), TsdfMap::Taken::kNoRoom);
  EXPECT_EQ(none.block_count(), 0);
}

TEST(FarBlocks, PagingAndDecayAllocateNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in";
  rt::Startup startup;
  TsdfConfig config = walk_map(8192);
  config.decay_half_life_s = 1;
  TsdfMap map(startup.token(), config);
  walk_through(map, kAll);
  std::vector<Vec3> everywhere;
  for (int x = -4; x <= 18; ++x) everywhere.emplace_back(x, 0, 0.5);
  const Vec3 away(500, 0, 0);
  const Pose X = look_at({9, 0, 0.9}, {10, 0, 0.45});
  rt_guard::reset();
  {
    rt::Section section;
    map.page({&away, 1}, kAll);
    map.fetch_view(small_camera(), X, 100);
    map.page(everywhere, kAll);
    for (int n = 0; n < 40; ++n) map.decay(0.05);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
}  // namespace tests
