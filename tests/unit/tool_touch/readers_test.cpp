// What teletact touch reads and casts: arrays, tables, the view of a field.
#include <gtest/gtest.h>

#include "rt/random.hpp"
#include "tests/unit/tool_touch/touch_files.hpp"
#include "tools/files/csv.hpp"
#include "tools/files/npy.hpp"
#include "tools/touch/view_cast.hpp"

namespace {

using touch_files::npy_bytes;

// The points that force_shading stands on lie on the surface that the field samples, with its
// normal.
TEST(ViewCast, PointsLieOnAPlaneHoweverItIsSeen) {
  using teletact::cast_view;
  const perception::Vec3 n = perception::Vec3(0.3, -0.2, 0.93).normalized(), c(0.12, 0.12, 0.12);
  teletact::DenseField field;
  field.size = {25, 25, 25};
  for (int x = 0; x < 25; ++x) {
    for (int y = 0; y < 25; ++y) {
      for (int z = 0; z < 25; ++z) {
        field.distance.push_back(static_cast<float>(n.dot(0.01 * perception::Vec3(x, y, z) - c)));
      }
    }
  }
  for (const perception::Vec3& eye :
       {perception::Vec3(c + n), perception::Vec3(c + 0.5 * n + perception::Vec3(0.6, 0.1, 0)),
        perception::Vec3(c + 0.7 * n - perception::Vec3(0.2, 0.9, 0))}) {
    teletact::View view{.eye = eye, .look = c, .width = 64, .height = 53, .f = 45};
    tasks::SurfacePoints s;
    const std::size_t met = cast_view(field, 0.01, view, s);
    ASSERT_GT(met, 50U);
    std::size_t seen = 0;
    for (std::size_t i = 0; i < s.count; ++i) {
      if (s.nx[i] == 0 && s.ny[i] == 0 && s.nz[i] == 0) continue;
      ++seen;
      const perception::Vec3f p(s.x[i], s.y[i], s.z[i]), m(s.nx[i], s.ny[i], s.nz[i]);
      EXPECT_NEAR(n.dot(p.cast<double>() - c), 0, 2e-6);
      EXPECT_NEAR(m.cast<double>().dot(n), 1, 1e-5);
    }
    EXPECT_EQ(seen, met);
  }
}

TEST(Npy, ReadsFormats) {
  for (const int major : {1, 2, 3}) {
    auto a =
        teletact::parse_npy(npy_bytes({1, 2, 3, 4, 5, 6}, "(1, 2, 3)", "<f4", "False", major), "x");
    ASSERT_TRUE(a) << a.error();
    EXPECT_EQ(a.value().shape, (std::vector<std::size_t>{1, 2, 3}));
    EXPECT_EQ(a.value().values[5], 6.0F);
  }
  // float64, NumPy's default: the bytes of two doubles, and of one that float32 can not hold.
  const auto of_doubles = [](const std::vector<double>& v) {
    std::vector<float> halves(2 * v.size());
    std::memcpy(halves.data(), v.data(), 8 * v.size());
    return npy_bytes(halves, "(" + std::to_string(v.size()) + ",)", "<f8");
  };
  const auto doubles = teletact::parse_npy(of_doubles({0.1, -2.5}), "x");
  ASSERT_TRUE(doubles) << doubles.error();
  EXPECT_EQ(doubles.value().values, (std::vector<float>{0.1F, -2.5F}));
  const auto hole = teletact::parse_npy(of_doubles({std::nan("")}), "x");
  ASSERT_TRUE(hole) << hole.error();
  EXPECT_TRUE(std::isnan(hole.value().values[0])) << "of a field: unobserved";
  EXPECT_FALSE(teletact::parse_npy(of_doubles({1e300}), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2, 3}, "(2,)", "<f8"), "x")) << "12 bytes of 16";
  const auto labels = teletact::parse_npy_labels(npy_bytes({}, "(2, 1)", "|u1") + "\x05\x0f", "x");
  ASSERT_TRUE(labels) << labels.error();
  EXPECT_EQ(labels.value().values, (std::vector<std::uint8_t>{5, 15}));
  EXPECT_FALSE(teletact::parse_npy_labels(npy_bytes({1}, "(4,)"), "x"));
  EXPECT_TRUE(teletact::parse_npy(npy_bytes({1}, "()"), "x"));
  EXPECT_TRUE(teletact::parse_npy(npy_bytes({}, "(0, 7)"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(2,)", "<f4", "True"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(2,)", ">f4"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(3,)"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(999999999999, 999999999999)"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(-2,)"), "x"));
  EXPECT_FALSE(teletact::parse_npy(npy_bytes({1, 2}, "(2,)", "<f4", "False", 4), "x"));
  EXPECT_FALSE(teletact::parse_npy("", "x"));
}

// Any damage is refused or gives an array that fits the bytes; nothing crashes.
TEST(Npy, SurvivesDamage) {
  constexpr std::uint64_t kSeed = 20240611;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  const std::string good = npy_bytes(std::vector<float>(24, 0.5F), "(2, 3, 4)");
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string bytes = good;
    const auto edits = random.integer(1, 4);
    for (int e = 0; e < edits; ++e) {
      switch (random.integer(0, 3)) {
        case 0:
          bytes[static_cast<std::size_t>(random.integer(0, 127))] =
              static_cast<char>(random.integer(0, 255));
          break;
        case 1:
          bytes.resize(static_cast<std::size_t>(random.integer(128, 224)));
          break;
        case 2:
          bytes.insert(static_cast<std::size_t>(random.integer(0, 127)), 1,
                       static_cast<char>(random.integer(32, 126)));
          break;
        default:
          bytes.erase(static_cast<std::size_t>(random.integer(0, 127)), 1);
          bytes.resize(std::max<std::size_t>(bytes.size(), 128));
          break;
      }
    }
    (void)teletact::parse_npy_labels(bytes, "x");
    const auto a = teletact::parse_npy(bytes, "x");
    if (a) {
      ++accepted;
      std::size_t n = 1;
      for (const auto d : a.value().shape) n *= d;
      EXPECT_EQ(n, a.value().values.size());
      EXPECT_LE(4 * n, bytes.size());
    }
  }
  EXPECT_LT(accepted, 10000);
}

TEST(Csv, HeaderCommentsAndWidth) {
  auto t = teletact::parse_csv("# made by hand\nb,a\n\n1, 2\n+3,4e1\n", "x");
  ASSERT_TRUE(t) << t.error();
  const auto r = teletact::numeric_rows(t.value(), {"a", "b"});
  ASSERT_TRUE(r) << r.error();
  EXPECT_EQ(r.value()[1], (std::vector<double>{40, 3}));
  EXPECT_FALSE(teletact::parse_csv("1,2\n3\n", "x"));
  EXPECT_FALSE(teletact::numeric_rows(t.value(), {"c"}));
  EXPECT_FALSE(teletact::parse_csv("", "x"));
  auto marked = teletact::parse_csv("\xEF\xBB\xBFt_s,x\n0,5\n", "x");
  ASSERT_TRUE(marked);
  EXPECT_EQ(marked.value().column("t_s"), 0);
  auto bare = teletact::parse_csv("0,5\r\n1,6\r\n", "x");
  ASSERT_TRUE(bare);
  EXPECT_TRUE(bare.value().header.empty());
  EXPECT_EQ(teletact::numeric_rows(bare.value(), {"t_s", "x"}).value()[1][1], 6);
}

}  // namespace
