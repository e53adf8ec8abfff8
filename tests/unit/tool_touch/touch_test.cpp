// teletact touch on files: the trace it writes, and what it refuses.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>

#include "rt/random.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/csv.hpp"
#include "tools/teletact/npy.hpp"
#include "tools/teletact/view_cast.hpp"

namespace {

namespace fs = std::filesystem;

std::string npy_bytes(const std::vector<float>& v, const std::string& shape,
                      const std::string& descr = "<f4", const std::string& order = "False",
                      int major = 1) {
  std::string header =
      "{'descr': '" + descr + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }";
  while ((header.size() + (major == 1 ? 11U : 13U)) % 64 != 0) header += ' ';
  header += '\n';
  std::string out = "\x93NUMPY";
  out += static_cast<char>(major);
  out += '\0';
  out += static_cast<char>(header.size() & 0xffU);
  out += static_cast<char>(header.size() >> 8U);
  if (major > 1) out += std::string(2, '\0');
  out += header;
  out.append(reinterpret_cast<const char*>(v.data()), v.size() * sizeof(float));
  return out;
}

void write(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}
std::string read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

class Touch : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = fs::path(testing::TempDir()) /
           (std::string("touch_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(dir_);
    fs::create_directories(dir_);
    write(dir_ / "floor.npy", floor(0.0F));
    write(dir_ / "hand.csv", press());
  }
  void TearDown() override { fs::remove_all(dir_); }

  // 24 x 24 x 24 nodes of 10 mm; the floor lies at z = 0.115 + height.
  static std::string floor(float height) {
    std::vector<float> v;
    for (int i = 0; i < 24 * 24; ++i) {
      for (int k = 0; k < 24; ++k) v.push_back(0.01F * static_cast<float>(k) - 0.115F - height);
    }
    return npy_bytes(v, "(24, 24, 24)");
  }
  // Down to 8 mm, 60 mm along x, and up, at 0.1 m/s; field origin (-0.1, 0.2, 0.3).
  static std::string press() {
    std::ostringstream out;
    out << "t_s,x,y,z\n";
    char line[96];
    for (int i = 0; i < 1000; ++i) {
      const double z = i < 180 ? 0.01 - 1e-4 * i : i < 780 ? -0.008 : -0.008 + 1e-4 * (i - 780);
      const double x = i < 180 ? 0 : 1e-4 * std::min(600, i - 180);
      std::snprintf(line, sizeof line, "%.6f,%.9f,%.9f,%.9f\n", 1e-3 * i, -0.01 + x, 0.31,
                    0.415 + z);
      out << line;
    }
    return out.str();
  }
  int run(std::vector<std::string> args) {
    args.insert(args.begin(), "touch");
    std::vector<char*> argv;
    for (auto& a : args) argv.push_back(a.data());
    return teletact::cmd_touch(static_cast<int>(argv.size()), argv.data());
  }
  std::vector<std::string> standard(const std::string& out = "trace.csv") {
    return {"--field",
            (dir_ / "floor.npy").string(),
            "--voxel",
            "0.01",
            "--origin=-0.1,0.2,0.3",
            "--path",
            (dir_ / "hand.csv").string(),
            "--method",
            "constrained",
            "--out",
            (dir_ / out).string()};
  }
  std::string refusal(const std::vector<std::string>& args) {
    try {
      run(args);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  }
  static std::vector<std::vector<double>> rows(const fs::path& path) {
    auto table = teletact::read_csv(path.string());
    if (!table) throw std::runtime_error(table.error());
    auto out = teletact::numeric_rows(table.value(), {"t_s", "hx", "hy", "hz", "px", "py", "pz",
                                                      "fx", "fy", "fz", "contacts", "cpu_ns"});
    if (!out) throw std::runtime_error(out.error());
    return out.value();
  }
  fs::path dir_;
};

TEST_F(Touch, FloorGivesStiffnessTimesDepth) {
  ASSERT_EQ(run(standard()), 0);
  const auto r = rows(dir_ / "trace.csv");
  ASSERT_EQ(r.size(), 1000U);
  int pressed = 0;
  for (const auto& row : r) {
    const double depth = 0.415 - row[3];
    EXPECT_NEAR(row[9], depth > 0 ? 1000 * depth : 0, 0.02) << row[0];
    EXPECT_NEAR(row[7], 0, 0.02);
    EXPECT_NEAR(row[8], 0, 0.02);
    if (depth > 1e-4) {
      ++pressed;
      EXPECT_EQ(row[10], 1);
      EXPECT_NEAR(row[4], row[1], 2e-5);
      EXPECT_NEAR(row[6], 0.415, 1e-5);
    } else if (depth < 0) {
      EXPECT_EQ(row[10], 0);
      EXPECT_NEAR(row[6], row[3], 1e-9);
    }
  }
  EXPECT_GT(pressed, 700);
}

TEST_F(Touch, SameInputSameBytesButForTheCpuColumn) {
  ASSERT_EQ(run(standard("a.csv")), 0);
  ASSERT_EQ(run(standard("b.csv")), 0);
  const auto strip = [](const std::string& text) {
    std::istringstream in(text);
    std::string line, out;
    while (std::getline(in, line)) out += line.substr(0, line.rfind(',')) + "\n";
    return out;
  };
  const std::string a = strip(read(dir_ / "a.csv"));
  EXPECT_EQ(a, strip(read(dir_ / "b.csv")));
  EXPECT_GT(a.size(), 40000U);
}

TEST_F(Touch, OptionsReachTheTask) {
  auto args = standard();
  args.insert(args.end(), {"--stiffness", "500", "--tip-radius", "0.003", "--force-limit", "4",
                           "--debug", (dir_ / "debug.csv").string()});
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  double most = 0;
  for (const auto& row : r) most = std::max(most, row[9]);
  EXPECT_NEAR(most, 4.0, 1e-6);  // 500 x 11 mm = 5.5 N, cut
  EXPECT_NEAR(r[500][6], 0.418, 2e-5);
  EXPECT_NE(read(dir_ / "debug.csv").find("guard_use"), std::string::npos);
}

TEST_F(Touch, RateResamplesTheHand) {
  auto args = standard();
  args.insert(args.end(), {"--rate", "2000"});
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_EQ(r.size(), 1999U);
  EXPECT_NEAR(r[1000][9], 8, 0.01);
}

TEST_F(Touch, ListedFieldsReplaceEachOtherSmoothly) {
  write(dir_ / "high.npy", floor(0.004F));
  write(dir_ / "list.csv", "t_s,file\n0,floor.npy\n0.4,high.npy\n");
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[395][9], 8, 0.02);
  EXPECT_NEAR(r[470][9], 12, 0.02);
  for (std::size_t i = 1; i < r.size(); ++i) EXPECT_LE(std::abs(r[i][9] - r[i - 1][9]), 0.3 + 1e-6);
}

// A field a millisecond: the windows that the task blends stay as they are, and the newest pending one wins.
TEST_F(Touch, FieldsFasterThanTheBlendAreNotWrittenOver) {
  std::string list = "t_s,file\n";
  char line[64];
  for (int i = 0; i < 400; ++i) {
    if (i < 20)
      write(dir_ / ("f" + std::to_string(i) + ".npy"), floor(0.0002F * static_cast<float>(i)));
    // Rises by 0.2 mm a millisecond to 3.8 mm and falls back, again and again.
    const int phase = i % 38;
    std::snprintf(line, sizeof line, "%.3f,f%d.npy\n", 0.3 + 1e-3 * i,
                  phase < 20 ? phase : 38 - phase);
    list += line;
  }
  write(dir_ / "list.csv", "t_s,file\n0,floor.npy\n" + list.substr(list.find('\n') + 1));
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  args.insert(args.end(),
              {"--debug", (dir_ / "debug.csv").string(), "--window", "16", "--guard", "off"});
  ASSERT_EQ(run(args), 0);
  auto table = teletact::read_csv((dir_ / "debug.csv").string());
  ASSERT_TRUE(table) << table.error();
  const auto column = [&](const char* name, std::size_t row) {
    const int at = table.value().column(name);
    EXPECT_GE(at, 0) << name;
    return table.value().number(row, static_cast<std::size_t>(at)).value();
  };
  // Between two fixed windows the force of a resting hand goes linearly with the blend; a window written over in the
  // middle of it bends that.
  int blends = 0, inside = 0;
  for (std::size_t i = 302; i < 700; ++i) {
    const double s0 = column("blend", i - 2), s1 = column("blend", i - 1), s2 = column("blend", i);
    if (s1 < s0) ++blends;
    if (!(s0 < s1 && s1 < s2 && s2 < 1)) continue;
    ++inside;
    const double f0 = column("raw_fz", i - 2), f1 = column("raw_fz", i - 1),
                 f2 = column("raw_fz", i);
    EXPECT_NEAR((f1 - f0) / (s1 - s0), (f2 - f1) / (s2 - s1), 0.05) << i;
  }
  EXPECT_GT(blends, 8);
  EXPECT_GT(inside, 250);
}

// The first contact is with the field that is visible then, not with the first one listed.
TEST_F(Touch, DefaultViewIsOfTheFieldThatIsTouched) {
  write(dir_ / "deep.npy", floor(-0.05F));
  write(dir_ / "list.csv", "t_s,file\n0,deep.npy\n0.4,floor.npy\n");
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  for (auto& a : args) {
    if (a == "constrained") a = "force_shading";
  }
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[390][9], 0, 1e-9);
  // Seen from above: the rows of pixels are 1 m / 365 apart.
  EXPECT_NEAR(r[600][9], 8, 0.05);
}

// Two materials by label: the force is the label's share; and what is wrong with either file.
TEST_F(Touch, LabelsAndPaletteReachTheTask) {
  std::string labels;
  for (int x = 0; x < 24; ++x) labels += std::string(24 * 24, x < 12 ? '\0' : '\x03');
  const auto npy = [](const std::string& bytes, const std::string& shape) {
    return npy_bytes({}, shape, "|u1") + bytes;
  };
  const std::string good = npy(labels, "(24, 24, 24)");
  const std::string palette = "label,stiffness,friction\n0,1,0\n3,0.5,0.3\n";
  write(dir_ / "labels.npy", good);
  write(dir_ / "palette.csv", palette);
  const auto with = [&] {
    auto args = standard();
    args.insert(args.end(), {"--labels", (dir_ / "labels.npy").string(), "--palette",
                             (dir_ / "palette.csv").string()});
    return args;
  };
  ASSERT_EQ(run(with()), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[250][9], 8, 0.02);  // x = -0.003: label 0
  EXPECT_NEAR(r[770][9], 4, 0.02);  // x = 0.049: label 3
  EXPECT_NEAR(r[770][7], -0.24 * 4, 0.05);
  EXPECT_NEAR(r[250][7], 0, 0.02);
  struct Bad {
    std::string labels, palette;
    const char* says;
  };
  for (const Bad& bad : std::initializer_list<Bad>{
           {npy_bytes(std::vector<float>(24 * 24 * 24, 0), "(24, 24, 24)"), palette, "|u1"},
           {npy(labels, "(24, 576)"), palette, "shape"},
           {npy(labels.substr(1), "(24, 24, 24)"), palette, "bytes of data"},
           {good, "label,stiffness\n0,1\n", "label 3 has no row"},
           {good, "label,stiffness\n0,1\n16,1\n", "0 to 15"},
           {good, "label,stiffness\n0,1\n3,2\n", "stiffness 2"},
           {good, "label,stiffness\n0,1\n3,1\n3,1\n", "a row already"},
           {good, "label,colour\n0,1\n", "'colour'"},
           {good, "0,1\n3,1\n", "'label'"},
           {good, "label,friction,friction_dynamic\n0,0,0\n3,0.1,0.2\n", "above friction"},
       }) {
    write(dir_ / "labels.npy", bad.labels);
    write(dir_ / "palette.csv", bad.palette);
    fs::remove(dir_ / "trace.csv");
    const std::string message = refusal(with());
    EXPECT_NE(message.find(bad.says), std::string::npos) << bad.says << ": " << message;
    EXPECT_FALSE(fs::exists(dir_ / "trace.csv"));
  }
  auto alone = standard();
  alone.insert(alone.end(), {"--labels", (dir_ / "labels.npy").string()});
  EXPECT_NE(refusal(alone).find("--labels needs --palette"), std::string::npos);
  auto both = with();
  both.insert(both.end(), {"--friction", "0.3"});
  EXPECT_NE(refusal(both).find("--friction has no meaning"), std::string::npos);
  auto bumps = standard();
  bumps.push_back("--bump-normal");
  EXPECT_NE(refusal(bumps).find("--bump-normal needs"), std::string::npos);
}

TEST_F(Touch, RecordedRunReplaysToTheLastBit) {
  const auto file = [&](const char* name) { return (dir_ / name).string(); };
  auto args = standard();
  args.insert(args.end(), {"--record", file("a.run"), "--friction", "0.3"});
  ASSERT_EQ(run(args), 0);
  ASSERT_EQ(run({"--replay", file("a.run"), "--out", file("again.csv")}), 0);
  const auto first = rows(dir_ / "trace.csv"), again = rows(dir_ / "again.csv");
  ASSERT_EQ(first.size(), again.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    for (std::size_t c = 1; c < 11; ++c) EXPECT_NEAR(first[i][c], again[i][c], 1e-9) << i;
  }
  // The same hand and windows through the memoryless baseline.
  ASSERT_EQ(run({"--replay", file("a.run"), "--method", "nearest10", "--out", file("n.csv")}), 0);
  EXPECT_EQ(rows(dir_ / "n.csv").size(), first.size());
  EXPECT_NE(
      refusal({"--replay", file("hand.csv"), "--out", file("x.csv")}).find("not a haptic run"),
      std::string::npos);
  EXPECT_NE(refusal({"--replay", file("a.run"), "--voxel", "0.01", "--out", file("x.csv")})
                .find("--voxel has no meaning"),
            std::string::npos);
  // Whatever the run was recorded with stays as it was, and is not passed over in silence.
  for (const char* option : {"--stiffness", "--friction", "--debug", "--guard"}) {
    EXPECT_NE(refusal({"--replay", file("a.run"), option, "1", "--out", file("x.csv")})
                  .find(std::string(option) + " has no meaning"),
              std::string::npos);
  }
  EXPECT_FALSE(fs::exists(dir_ / "x.csv"));
}

TEST_F(Touch, UnevenRowsAreRefusedOrInterpolated) {
  std::ostringstream out;
  out << "t_s,x,y,z\n";
  for (int i = 0; i < 300; ++i) {
    const double t = 1e-3 * i + (i % 2 == 1 && i < 299 ? 7e-4 : 0);
    out << t << ",-0.01,0.31," << 0.425 - 0.05 * t << '\n';
  }
  write(dir_ / "hand.csv", out.str());
  EXPECT_NE(refusal(standard()).find("give --rate"), std::string::npos);
  // The rate that the rows have in the mean: still interpolated.
  auto args = standard();
  args.insert(args.end(), {"--rate", "1000"});
  ASSERT_EQ(run(args), 0);
  const auto trace = rows(dir_ / "trace.csv");
  ASSERT_EQ(trace.size(), 300U);
  for (std::size_t i = 0; i < trace.size(); ++i) {
    EXPECT_NEAR(trace[i][0], 1e-3 * static_cast<double>(i), 1e-9);
    EXPECT_NEAR(trace[i][3], 0.425 - 0.05 * trace[i][0], 1e-7) << i;
  }
}

TEST_F(Touch, AViewThatSeesNothingIsSaid) {
  auto args = standard();
  *std::find(args.begin(), args.end(), "constrained") = "force_shading";
  auto away = args;
  away.insert(away.end(), {"--view", "0,0.3,0.8,0,0.3,2"});
  EXPECT_NE(refusal(away).find("no surface is seen"), std::string::npos);
  EXPECT_FALSE(fs::exists(dir_ / "trace.csv"));
  args.insert(args.end(), {"--view", "0,0.3,0.8,0,0.3,0.4"});
  EXPECT_EQ(run(args), 0);
}

// The clutch is held while the device goes back over the floor: the scene's hand waits, and goes on from there.
TEST_F(Touch, ClutchColumnMovesTheWorkspace) {
  std::ostringstream out;
  out << "t_s,x,y,z,clutch\n";
  char line[96];
  for (int i = 0; i < 900; ++i) {
    const double down = 1e-4 * std::min(i, 180);
    const double aside = i < 300 ? 0 : 1e-4 * (std::min(i, 600) - 300);
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.9f,%.9f,%d\n", 1e-3 * i, -0.01 + aside, 0.31,
                  0.425 - down, i >= 300 && i < 600 ? 1 : 0);
    out << line;
  }
  write(dir_ / "hand.csv", out.str());
  ASSERT_EQ(run(standard()), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[290][9], 8, 0.02);
  EXPECT_NEAR(r[550][9], 0, 1e-6) << "forces fade out";
  EXPECT_NEAR(r[550][1], -0.01, 1e-6) << "the scene's hand stands";
  EXPECT_NEAR(r[890][9], 8, 0.02);
  EXPECT_NEAR(r[890][1], -0.01 + 1e-4, 1e-6) << "and goes on from there, by the one step after it";
  write(dir_ / "hand.csv", "t_s,x,y,z,clutch\n0,0,0,0,0\n0.001,0,0,0,2\n");
  EXPECT_NE(refusal(standard()).find("clutch"), std::string::npos);
}

TEST_F(Touch, UnobservedSpaceGivesNoForce) {
  std::vector<float> v(24 * 24 * 24, std::numeric_limits<float>::quiet_NaN());
  write(dir_ / "floor.npy", npy_bytes(v, "(24, 24, 24)"));
  ASSERT_EQ(run(standard()), 0);
  for (const auto& row : rows(dir_ / "trace.csv")) {
    EXPECT_EQ(row[7], 0);
    EXPECT_EQ(row[9], 0);
    EXPECT_EQ(row[10], 0);
  }
}

// The points that force_shading stands on lie on the surface that the field samples, with its normal.
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

TEST_F(Touch, BadInputIsOneMessageAndNoFile) {
  struct Case {
    const char* name;
    std::function<void(std::vector<std::string>&)> spoil;
    const char* says;
  };
  const auto replace = [](std::vector<std::string>& a, const char* key, const std::string& value) {
    for (std::size_t i = 0; i + 1 < a.size(); ++i) {
      if (a[i] == key) a[i + 1] = value;
    }
  };
  const std::vector<Case> cases{
      {"no field", [&](auto& a) { replace(a, "--field", (dir_ / "no.npy").string()); }, "no.npy"},
      {"no path", [&](auto& a) { replace(a, "--path", (dir_ / "no.csv").string()); }, "no.csv"},
      {"method", [&](auto& a) { replace(a, "--method", "magic"); },
       "constrained, nearest, nearest10"},
      {"voxel", [&](auto& a) { replace(a, "--voxel", "-1"); }, "--voxel"},
      {"voxel text", [&](auto& a) { replace(a, "--voxel", "ten"); }, "ten"},
      {"unknown option", [&](auto& a) { a.push_back("--colour"); }, "--colour"},
      {"origin", [&](auto& a) { a[4] = "--origin=1,2"; }, "--origin"},
      {"truncated field", [&](auto&) { write(dir_ / "floor.npy", floor(0).substr(0, 9000)); },
       "bytes of data"},
      {"float64",
       [&](auto&) {
         write(dir_ / "floor.npy", npy_bytes({1, 2}, "(1,)", "<f8"));
       },
       "<f4"},
      {"two dimensions",
       [&](auto&) {
         write(dir_ / "floor.npy", npy_bytes({1, 2, 3, 4}, "(2, 2)"));
       },
       "dimensions"},
      {"infinite",
       [&](auto&) {
         std::vector<float> v(8, 1.0F);
         v[3] = std::numeric_limits<float>::infinity();
         write(dir_ / "floor.npy", npy_bytes(v, "(2, 2, 2)"));
       },
       "infinite"},
      {"hand word",
       [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0,0,0,0\n0.001,0,zero,0\n"); }, "zero"},
      {"hand nan", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0,0,0,0\n0.001,0,nan,0\n"); },
       "finite"},
      {"hand time", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0.1,0,0,0\n0.1,0,0,0\n"); },
       "rise"},
      {"hand column", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y\n0,0,0\n"); }, "'z'"},
      {"hand empty", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n"); }, "no data"},
      {"out folder", [&](auto& a) { replace(a, "--out", (dir_ / "no" / "trace.csv").string()); },
       "written"},
  };
  for (const Case& c : cases) {
    SetUp();
    auto args = standard();
    c.spoil(args);
    const std::string message = refusal(args);
    EXPECT_NE(message.find(c.says), std::string::npos) << c.name << ": " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << c.name << ": " << message;
    EXPECT_FALSE(fs::exists(dir_ / "trace.csv")) << c.name;
    for (const auto& e : fs::directory_iterator(dir_))
      EXPECT_EQ(e.path().filename().string().find("trace.csv"), std::string::npos) << c.name;
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
