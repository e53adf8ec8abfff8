// The vector versions of the watch's hot loops against plain ones: bit for bit where the order of
// sums is the same, and within what the digits allow where the reference sums in fp64.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <iostream>

#include "perception/icp/cell_sums.hpp"
#include "perception/icp/kernels.hpp"
#include "perception/icp/rows_job.hpp"
#include "perception/motion/agree_kernel.hpp"
#include "perception/motion/cell_loops.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "tests/support/analytic_scene.hpp"

namespace perception {
namespace {

constexpr std::uint64_t kSeed = 71;
const Pose kEye = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, -0.05, 0.3));

struct Rig {
  rt::Startup startup;
  Intrinsics k;
  TrackingPyramid pyramid;
  std::vector<float> records;
  std::vector<std::uint16_t> mm;
  ModelView model;

  Rig(int width, int height, rt::Random& random)
      : k{182.5, 182.5, width / 2.0, height / 2.0, width, height},
        pyramid(startup.token(), {}, width, height) {
    const tests::AnalyticScene room = tests::test_room();
    records = tests::cast_model(room, k, kEye);
    model = {records.data(), k, kEye};
    const Pose X_WC = kEye * tests::random_motion(random, 0.02, 0.01);
    mm = tests::to_mm(tests::cast_depth(room, k, X_WC), 0.004, random);
    for (std::uint16_t& z : mm)
      if (random.uniform() < 0.02) z = 0;
    pyramid.build({mm.data(), width, height, width}, k, 1);
  }
};

bool same(const CellSums& a, const CellSums& b) {
  return a.columns == b.columns && a.rows == b.rows && a.H == b.H && a.g == b.g && a.r2 == b.r2 &&
         a.pairs == b.pairs && a.live == b.live && a.depth_m == b.depth_m;
}

TEST(CellSums, EveryInstructionSetGivesTheSameBytes) {
  rt::Random random(kSeed);
  std::cout << "seed " << kSeed << "\n";
  for (const auto& [width, height] : {std::pair{256, 212}, {204, 150}, {246, 130}}) {
    Rig rig(width, height, random);
    for (const float per_m2 : {0.0F, 0.004F}) {
      for (const int rows : {8, 4, 3}) {
        Gates gates;
        gates.distance_m = 0.1F;
        gates.noise = {0.0015F, per_m2, 0.8F};
        CellSums first;
        for (const simd::Isa isa : simd::available()) {
          ASSERT_TRUE(simd::choose(isa));
          CellSums sums;
          accumulate_cells(rig.pyramid.level(1), rig.model, Pose::Identity(), Vec3(0, 0, 1.5),
                           gates, sums, rows);
          if (isa == simd::Isa::kScalar) first = sums;
          EXPECT_TRUE(same(sums, first)) << simd::name_of(isa) << " " << width << " rows " << rows;
        }
        float pairs = 0;
        for (const float p : first.pairs) pairs += p;
        EXPECT_GT(pairs, 100);  // their weights
      }
    }
  }
  ASSERT_TRUE(simd::choose("auto"));
}

// fp32 over 8 x 8 pixels: 14 roundings of at most 2^-24 of what is added up.
TEST(CellSums, AreWithinTheirDigitsOfSumsInDouble) {
  rt::Random random(kSeed, 2);
  Rig rig(256, 212, random);
  const DepthLevel& live = rig.pyramid.level(1);
  Gates gates;
  gates.distance_m = 0.1F;
  gates.noise = {0.0015F, 0.0F, 0.8F};
  CellSums sums;
  accumulate_cells(live, rig.model, Pose::Identity(), Vec3(0, 0, 1.5), gates, sums);
  const icp::RowsJob whole =
      make_rows_job(live, rig.model, Pose::Identity(), Vec3(0, 0, 1.5), gates);
  double worst = 0;
  for (int c = 0; c < sums.size(); ++c) {
    const int u = c % sums.columns * 8, v = c / sums.columns * 8;
    icp::RowsJob job = whole;
    const std::ptrdiff_t at = v * job.stride + u;
    job.z += at, job.nx += at, job.ny += at, job.nz += at, job.x_factor += u, job.y_factor += v;
    job.width = std::min(8, live.depth.width() - u);
    job.rows = std::min(8, live.depth.height() - v);
    icp::LaneSums lanes;
    icp::kScalarKernels.accumulate(job, false, lanes);
    double want[icp::kSums] = {};
    for (int i = 0; i < icp::kSums; ++i)
      for (const double lane : lanes.sums[i]) want[i] += lane;
    const auto cell = static_cast<std::size_t>(c);
    EXPECT_EQ(static_cast<double>(sums.pairs[cell]), want[28]);
    if (want[28] == 0) continue;
    // What is added up, at most: by Cauchy and Schwarz.
    const int diagonal[6] = {0, 6, 11, 15, 18, 20};
    std::size_t n = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      for (std::size_t j = i; j < 6; ++j, ++n) {
        const double most = std::sqrt(want[diagonal[i]] * want[diagonal[j]]);
        worst = std::max(worst, std::abs(static_cast<double>(sums.H[n][cell]) - want[n]) / most);
      }
      const double most = std::sqrt(want[diagonal[i]] * want[27]);
      worst = std::max(worst, std::abs(static_cast<double>(sums.g[i][cell]) - want[21 + i]) / most);
    }
    worst = std::max(worst, std::abs(static_cast<double>(sums.r2[cell]) - want[27]) / want[27]);
  }
  std::cout << "seed " << kSeed << ": worst " << worst << " of what is added up\n";
  EXPECT_LT(worst, 14 * 0x1.0p-24);
  EXPECT_GT(worst, 0);
}

TEST(Agreeing, EveryInstructionSetGivesTheSameBitsAsThePlainLoop) {
  rt::Random random(kSeed, 3);
  std::cout << "seed " << kSeed << "\n";
  for (const double voxel_m : {0.02, 0.007}) {
    Rig rig(256, 212, random);
    TsdfConfig config;
    config.voxel_size_m = voxel_m;
    TsdfMap map(rig.startup.token(), config);
    FrameView frame;
    frame.depth_mm = {rig.mm.data(), rig.k.width, rig.k.height, rig.k.width};
    frame.intrinsics = rig.k;
    for (int n = 0; n < 3; ++n) map.integrate(frame, kEye, 1);
    const DepthLevel& live = rig.pyramid.level(1);
    std::vector<std::uint32_t> places(motion::kPlaceSlots / 32);
    for (auto& p : places) p = static_cast<std::uint32_t>(random() & random());
    int agree = 0, others = 0, held_back = 0;
    for (int trial = 0; trial < 4; ++trial) {
      const Pose X_WC = kEye * tests::random_motion(random, 0.03, 0.01);
      motion::AgreeJob job{};
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) job.R_W[3 * i + j] = static_cast<float>(X_WC.linear()(i, j));
        job.t_W[i] = static_cast<float>(X_WC.translation()(i));
      }
      job.stride = live.depth.stride();
      job.inv_voxel = static_cast<float>(1 / voxel_m);
      job.metres_per_unit = map.metres_per_unit();
      job.base_m = 0.012F, job.per_m2 = 0.002F, job.from_m = 0.8F;
      job.inv_place = 40;
      for (int v = 0; v < live.depth.height(); v += 8) {
        for (int u = 0; u < live.depth.width(); u += 8) {
          job.z = live.depth.row(v) + u;
          job.x_factor = live.x_factor.data() + u + PaddedImage::kMargin;
          job.y_factor = live.y_factor.data() + v + PaddedImage::kMargin;
          job.rows = static_cast<unsigned>(random() & 0xffU) &
                     ((1U << static_cast<unsigned>(std::min(8, live.depth.height() - v))) - 1);
          int without = 0, with = 0;
          for (const bool remembered : {false, true}) {
            job.places = remembered ? places.data() : nullptr;
            motion::RowBits want[8] = {};
            MapReader plain(map, 1.0);
            motion::find_agreeing_plain(job, plain, want);
            for (const auto& w : want) {
              EXPECT_EQ(w.agrees & w.others, 0);
              agree += std::popcount(w.agrees), others += std::popcount(w.others);
              (remembered ? with : without) += std::popcount(w.agrees);
            }
            for (const simd::Isa isa : simd::available()) {
              ASSERT_TRUE(simd::choose(isa));
              motion::RowBits got[8] = {};
              MapReader reader(map, 1.0);
              motion::find_agreeing(job, reader, got);
              for (int r = 0; r < 8; ++r) {
                ASSERT_EQ(got[r].agrees, want[r].agrees)
                    << simd::name_of(isa) << " " << u << " " << v;
                ASSERT_EQ(got[r].others, want[r].others)
                    << simd::name_of(isa) << " " << u << " " << v;
              }
            }
          }
          held_back += without - with;
        }
      }
    }
    std::cout << 1e3 * voxel_m << " mm: " << agree << " agree, " << others << " others, "
              << held_back << " for their places\n";
    EXPECT_GT(agree, 5000);
    EXPECT_GT(others, 500);
    EXPECT_GT(held_back, 500);
  }
  ASSERT_TRUE(simd::choose("auto"));
}

TEST(CellLoops, EqualPlainLoops) {
  rt::Random random(kSeed, 4);
  std::cout << "seed " << kSeed << "\n";
  for (const auto& [columns, rows] : {std::pair{16, 14}, {20, 16}, {5, 3}, {1, 1}}) {
    CellSums sums;
    sums.columns = columns, sums.rows = rows;
    motion::PerCell limit2, weight, got;
    const auto fill = [&](auto& table) {
      for (float& x : table) x = static_cast<float>(random.uniform(-1, 1));
    };
    for (auto& row : sums.H) fill(row);
    for (auto& row : sums.g) fill(row);
    for (std::size_t c = 0; c < sums.r2.size();
         ++c) {  // beyond the last cell too: nothing may count there
      sums.r2[c] = static_cast<float>(random.uniform(0, 2));
      sums.pairs[c] = static_cast<float>(static_cast<int>(random.uniform(0, 64)));
      limit2[c] = static_cast<float>(random.uniform(0.1, 1));
      weight[c] = random.uniform() < 0.3 ? 0.0F : static_cast<float>(random.uniform());
    }
    float linear[6], square[21];
    for (float& x : linear) x = static_cast<float>(random.uniform(-1, 1));
    for (float& x : square) x = static_cast<float>(random.uniform(-1, 1));
    motion::misfit_of(sums, linear, square, limit2, got);
    motion::WeightedSums weighted;
    motion::weigh(sums, weight, 12, weighted);
    const double support = motion::supported(sums, got, weight, 0.3F, 12);
    double H[21] = {}, g[6] = {}, pairs = 0, want_support = 0;
    for (std::size_t c = 0; c < static_cast<std::size_t>(sums.size()); ++c) {
      float want = sums.r2[c];
      for (std::size_t i = 0; i < 6; ++i) want += linear[i] * sums.g[i][c];
      for (std::size_t i = 0; i < 21; ++i) want += square[i] * sums.H[i][c];
      want = std::max(want, 0.0F) / (std::max(sums.pairs[c], 1.0F) * limit2[c]);
      EXPECT_EQ(got[c], want) << c;
      if (sums.pairs[c] < 12) continue;
      want_support += static_cast<double>(weight[c] * sums.pairs[c] / (1 + want / 0.3F));
      const auto w = static_cast<double>(weight[c]);
      for (std::size_t i = 0; i < 21; ++i) H[i] += w * static_cast<double>(sums.H[i][c]);
      for (std::size_t i = 0; i < 6; ++i) g[i] += w * static_cast<double>(sums.g[i][c]);
      pairs += w * static_cast<double>(sums.pairs[c]);
    }
    for (int i = 0; i < 21; ++i) EXPECT_NEAR(weighted.H[i], H[i], 1e-12 * columns * rows);
    for (int i = 0; i < 6; ++i) EXPECT_NEAR(weighted.g[i], g[i], 1e-12 * columns * rows);
    EXPECT_NEAR(weighted.pairs, pairs, 1e-12 * pairs);
    EXPECT_NEAR(support, want_support, 1e-12 * want_support);
  }
}

}  // namespace
}  // namespace perception
