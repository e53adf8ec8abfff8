#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/random.hpp"
#include "tests/support/paths.hpp"
#include "tools/files/csv.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;

struct Folder {
  fs::path path = fs::temp_directory_path() / ("teletact_predict_" + std::to_string(::getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path / name).string(); }
};

void write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}
std::string read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

int run(std::vector<std::string> args) {
  args.insert(args.begin(), "predict");
  std::vector<char*> argv;
  for (std::string& a : args) argv.push_back(a.data());
  argv.push_back(nullptr);
  return teletact::cmd_predict(static_cast<int>(args.size()), argv.data());
}

using Rows = std::vector<std::vector<double>>;
Rows rows_of(const std::string& path, const std::vector<std::string>& columns) {
  auto table = teletact::read_csv(path);
  EXPECT_TRUE(table.has_value()) << (table ? "" : table.error());
  auto rows = teletact::numeric_rows(table.value(), columns);
  EXPECT_TRUE(rows.has_value()) << (rows ? "" : rows.error());
  return rows.value();
}

// A robot that speeds up, turns and slows down, 20 Hz; a row for each line.
std::vector<std::string> wavy_log(bool commands) {
  std::vector<std::string> lines;
  double x = 0, y = 0, yaw = 0, v = 0, w = 0;
  const double dt = 0.05;
  for (int i = 0; i < 400; ++i) {
    const double cv = (i / 60) % 2 == 0 ? 0.5 : 0.1, cw = (i / 45) % 2 == 0 ? 0.4 : -0.4;
    char line[300];
    std::snprintf(line, sizeof line, "%.2f,%.6f,%.6f,%.6f,%.6f,0,%.6f", i * dt, x, y,
                  std::remainder(yaw, 2 * M_PI), v, w);
    std::string text = line;
    if (commands) {
      std::snprintf(line, sizeof line, ",%.3f,0,%.3f", cv, cw);
      text += line;
    }
    lines.push_back(text);
    const int n = 50;  // first-order response, 0.25 s, integrated finely
    for (int k = 0; k < n; ++k) {
      v += (cv - v) / 0.25 * dt / n;
      w += (cw - w) / 0.25 * dt / n;
      yaw += w * dt / n;
      x += v * std::cos(yaw) * dt / n;
      y += v * std::sin(yaw) * dt / n;
    }
  }
  return lines;
}
const char* const kHeader = "t_s,x_m,y_m,yaw_rad,vx,vy,wz\n";
const char* const kHeaderCmd = "t_s,x_m,y_m,yaw_rad,vx,vy,wz,cmd_vx,cmd_vy,cmd_wz\n";

std::string joined(const std::string& header, const std::vector<std::string>& lines,
                   std::size_t count) {
  std::string text = header;
  for (std::size_t i = 0; i < count && i < lines.size(); ++i) text += lines[i] + "\n";
  return text;
}

double rms_position(const Rows& log, const Rows& predicted) {
  std::map<double, const std::vector<double>*> truth;
  for (const auto& r : log) truth[r[0]] = &r;
  double sum = 0;
  for (const auto& p : predicted) {
    const auto& t = *truth.at(p[0]);
    sum += (p[1] - t[1]) * (p[1] - t[1]) + (p[2] - t[2]) * (p[2] - t[2]);
  }
  return std::sqrt(sum / static_cast<double>(predicted.size()));
}

const std::vector<std::string> kPose{"t_s", "x_m", "y_m", "yaw_rad"};

TEST(CmdPredict, EachRowWithDataOldEnoughAndSameBytes) {
  Folder f;
  write(f.file("log.csv"), joined(kHeader, wavy_log(false), 400));
  for (const char* method : {"none", "hold", "lsq"}) {
    ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", "0.5", "--method", method, "--out",
                   f.file("a.csv")}),
              0);
    ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", "0.5", "--method", method, "--out",
                   f.file("b.csv")}),
              0);
    EXPECT_EQ(read(f.file("a.csv")), read(f.file("b.csv")));
    const Rows out = rows_of(f.file("a.csv"), kPose);
    EXPECT_EQ(out.size(), 390U);
    EXPECT_EQ(out.front()[0], 0.5);
    EXPECT_EQ(out.back()[0], 19.95);
  }
}

// Whatever happens after t - delay, the row of t stays the same: later rows are replaced by
// garbage.
TEST(CmdPredict, IsCausal) {
  Folder f;
  const std::uint64_t seed = 71;
  rt::Random random(seed);
  const double delay = 0.3;
  for (const bool commands : {false, true}) {
    const auto lines = wavy_log(commands);
    const std::string header = commands ? kHeaderCmd : kHeader;
    write(f.file("log.csv"), joined(header, lines, lines.size()));
    ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", std::to_string(delay), "--out",
                   f.file("a.csv")}),
              0);
    const Rows all = rows_of(f.file("a.csv"), kPose);
    const Rows log = rows_of(f.file("log.csv"), kPose);
    for (int n = 0; n < 12; ++n) {
      const auto cut = static_cast<std::size_t>(random.integer(10, 390));
      const double t = log[cut][0];
      std::string text = header;
      for (std::size_t i = 0; i < lines.size(); ++i) {
        if (log[i][0] <= t - delay + 1e-6) {
          text += lines[i] + "\n";
          continue;
        }
        // Keeps time and what may be known (commands up to t), nothing else.
        text += lines[i].substr(0, lines[i].find(','));
        for (int k = 0; k < 6; ++k) text.append(",").append(std::to_string(random.uniform(-9, 9)));
        if (commands) {
          std::string cmd = lines[i];
          for (int k = 0; k < 7; ++k) cmd = cmd.substr(cmd.find(',') + 1);
          text.append(",").append(log[i][0] <= t ? cmd.c_str() : "7,7,7");
        }
        text += "\n";
      }
      write(f.file("cut.csv"), text);
      ASSERT_EQ(run({"--log", f.file("cut.csv"), "--delay", std::to_string(delay), "--out",
                     f.file("b.csv")}),
                0);
      bool seen = false;
      const Rows after = rows_of(f.file("b.csv"), kPose);
      for (std::size_t i = 0; i < after.size(); ++i) {
        if (after[i][0] != t) continue;
        seen = true;
        EXPECT_EQ(after[i], all[i]) << "seed " << seed << " t " << t;
      }
      EXPECT_TRUE(seen);
    }
  }
}

TEST(CmdPredict, KnownCommandsHelp) {
  Folder f;
  write(f.file("plain.csv"), joined(kHeader, wavy_log(false), 400));
  write(f.file("cmd.csv"), joined(kHeaderCmd, wavy_log(true), 400));
  const Rows log = rows_of(f.file("plain.csv"), kPose);
  std::map<std::string, double> rms;
  for (const char* name : {"plain", "cmd"}) {
    ASSERT_EQ(run({"--log", f.file(std::string(name) + ".csv"), "--delay", "0.5", "--out",
                   f.file("p.csv")}),
              0);
    rms[name] = rms_position(log, rows_of(f.file("p.csv"), kPose));
  }
  std::printf("0.5 s: lsq %.1f mm, with commands %.1f mm\n", 1e3 * rms["plain"], 1e3 * rms["cmd"]);
  EXPECT_LT(rms["cmd"], 0.35 * rms["plain"]);
}

TEST(CmdPredict, HeaderOrderCrlfCommentsAndDelayZero) {
  Folder f;
  write(f.file("log.csv"),
        "# a comment\r\nyaw_rad,t_s,y_m,x_m,wz,vy,vx\r\n\r\n3.0,0.10,2,1,0,0,0.5\r\n"
        "3.0,0.20,2,1.05,0,0,0.5\r\n");
  ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", "0", "--method", "hold", "--out",
                 f.file("p.csv")}),
            0);
  EXPECT_EQ(read(f.file("p.csv")),
            "t_s,x_m,y_m,yaw_rad\n0.10,1.000000,2.000000,3.000000\n"
            "0.20,1.050000,2.000000,3.000000\n");
}

void expect_refused(const Folder& f, const std::vector<std::string>& args,
                    const std::string& part) {
  fs::remove(f.file("p.csv"));
  try {
    (void)run(args);
    ADD_FAILURE() << "accepted; wanted: " << part;
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find(part), std::string::npos) << e.what();
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << e.what();
  }
  EXPECT_FALSE(fs::exists(f.file("p.csv")));
}

TEST(CmdPredict, BadInputIsOneMessageAndNoFile) {
  Folder f;
  const std::string log = f.file("log.csv"), out = f.file("p.csv");
  const auto refuse = [&](const std::string& text, const std::string& part) {
    write(log, text);
    expect_refused(f, {"--log", log, "--delay", "0.1", "--out", out}, part);
  };
  const std::string h = kHeader;
  refuse(h + "0,0,0,0,0,0,0\n0.2,0,zero,0,0,0,0\n", ":3: 'zero'");
  refuse(h + "0,0,0,0,0,0,0\n0.2,0,nan,0,0,0,0\n", "nan");
  refuse(h + "0,0,0,0,0,0,0\n0.2,0,0,0,0,0\n", ":3:");
  refuse(h + "0.2,0,0,0,0,0,0\n0.1,0,0,0,0,0,0\n", "must rise");
  refuse(h, "no data rows");
  refuse("", "no data rows");
  refuse("t_s,x_m,y_m,vx,vy,wz\n0,0,0,0,0,0\n", "'yaw_rad' is missing");
  refuse("t_s,x_m,y_m,yaw_rad,vx,vy,wz,colour\n0,0,0,0,0,0,0,0\n", "unknown column 'colour'");
  refuse("t_s,x_m,y_m,yaw_rad,vx,vy,wz,cmd_vx\n0,0,0,0,0,0,0,0\n", "come together");
  refuse("0,0,0,0,0,0,0,0\n", "7 or 10");
  refuse(h + "0,0,0,0,0,0,0\n", "no row has data");
  write(log, joined(kHeader, wavy_log(false), 100));
  expect_refused(f, {"--log", f.file("none.csv"), "--delay", "0.1", "--out", out}, "none.csv");
  expect_refused(f, {"--log", log, "--delay", "-1", "--out", out}, "[0 - 10]");
  expect_refused(f, {"--log", log, "--delay", "nan", "--out", out}, "[0 - 10]");
  expect_refused(f, {"--log", log, "--delay", "soon", "--out", out}, "--delay");
  expect_refused(f, {"--log", log, "--delay", "0.1", "--method", "magic", "--out", out}, "magic");
  expect_refused(f, {"--log", log, "--delay", "0.1"}, "--out");
  expect_refused(f, {"--log", log, "--delay", "0.1", "--out", f.file("no/such/p.csv")}, "p.csv");
}

// Stamps are decimal: of rows 0.1 s apart the one that is a delay of 0.1 s older counts, whatever
// rounding makes of the difference. `none` then says the row before, for every row.
TEST(CmdPredict, ARowExactlyTheDelayOldCounts) {
  Folder f;
  std::string text = kHeader;
  constexpr int kRows = 3000;
  for (int i = 0; i < kRows; ++i) {
    char line[80];
    std::snprintf(line, sizeof line, "%.1f,%.3f,0,0,0,0,0\n", 0.1 * i, 0.001 * i);
    text += line;
  }
  write(f.file("log.csv"), text);
  for (const int steps : {1, 2, 3, 7}) {
    ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", std::to_string(0.1 * steps), "--method",
                   "none", "--out", f.file("p.csv")}),
              0);
    const Rows out = rows_of(f.file("p.csv"), kPose);
    ASSERT_EQ(out.size(), static_cast<std::size_t>(kRows - steps));
    for (std::size_t i = 0; i < out.size(); ++i)
      ASSERT_NEAR(out[i][1], 0.001 * static_cast<double>(i), 1e-9) << "row " << i;
  }
}

// Bad rows are left out: the rest is predicted as if they were not there, and they are counted and
// named.
TEST(CmdPredict, BadRowsAreRefusedByNameAndTheRestIsPredicted) {
  Folder f;
  const auto lines = wavy_log(false);
  write(f.file("good.csv"), joined(kHeader, lines, lines.size()));
  std::string text = kHeader;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    text += lines[i] + "\n";
    if (i == 100) text += "5.02,nan,0,0,0,0,0\n";   // line 103
    if (i == 200) text += lines[i] + "\n";          // 204: repeated
    if (i == 300) text += "1.00,0,0,0,9,9,9\n";     // 305: back in time
    if (i == 350) text += "17.52,0,0,0,inf,0,0\n";  // 356
  }
  write(f.file("bad.csv"), text);
  for (const char* method : {"none", "hold", "paper", "kalman", "own"}) {
    for (const char* name : {"good", "bad"}) {
      testing::internal::CaptureStderr();
      ASSERT_EQ(
          run({"--log", f.file(std::string(name) + ".csv"), "--delay", "0.2", "--method", method,
               "--out", f.file(std::string(name) + "_p.csv"), "--json", f.file("m.json")}),
          0);
      const std::string said = testing::internal::GetCapturedStderr();
      const std::string figures = read(f.file("m.json"));
      if (std::string(name) == "good") {
        EXPECT_EQ(said, "");
        continue;
      }
      EXPECT_NE(said.find("4 of 404 rows refused: line 103: not finite"), std::string::npos)
          << said;
      EXPECT_NE(said.find("line 204: t_s repeated"), std::string::npos) << said;
      EXPECT_NE(said.find("line 305: t_s goes back"), std::string::npos) << said;
      EXPECT_NE(said.find("line 356: not finite"), std::string::npos) << said;
      EXPECT_NE(figures.find("predict.refused"), std::string::npos);
    }
    EXPECT_EQ(read(f.file("good_p.csv")), read(f.file("bad_p.csv"))) << method;
  }
}

// A clock that jumps ahead for one row costs that row, and not those behind it.
TEST(CmdPredict, ARowAheadOfTheRestIsRefusedAlone) {
  Folder f;
  const auto lines = wavy_log(false);
  write(f.file("good.csv"), joined(kHeader, lines, lines.size()));
  for (const char* stamp : {"7.00", "900.5", "1e9", "1e300"}) {
    std::string text = kHeader;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      if (i == 0 || i == 101) text += std::string(stamp) + ",0,0,0,9,9,9\n";  // lines 2 and 104
      text += lines[i] + "\n";
    }
    write(f.file("bad.csv"), text);
    for (const char* name : {"good", "bad"}) {
      testing::internal::CaptureStderr();
      ASSERT_EQ(run({"--log", f.file(std::string(name) + ".csv"), "--delay", "0.2", "--out",
                     f.file(std::string(name) + "_p.csv")}),
                0);
      const std::string said = testing::internal::GetCapturedStderr();
      if (std::string(name) == "good") continue;
      EXPECT_NE(said.find("2 of 402 rows refused: line 2: "), std::string::npos) << said;
      EXPECT_NE(said.find("; line 104: "), std::string::npos) << said;
    }
    EXPECT_EQ(read(f.file("good_p.csv")), read(f.file("bad_p.csv"))) << stamp;
  }
}

// A first row of before the clock was set, or of a place that is none, is refused alone.
TEST(CmdPredict, AFirstRowFarFromTheRestIsRefusedAlone) {
  Folder f;
  auto lines = wavy_log(false);
  const auto good = joined(kHeader, lines, lines.size());
  write(f.file("good.csv"), good);
  for (const char* first : {"-2000000,0,0,0,0,0,0", "-1,2000000,0,0,0,0,0", "-1,0,-5e7,0,0,0,0"}) {
    write(f.file("bad.csv"), kHeader + std::string(first) + good.substr(good.find('\n')));
    for (const char* name : {"good", "bad"}) {
      testing::internal::CaptureStderr();
      ASSERT_EQ(run({"--log", f.file(std::string(name) + ".csv"), "--delay", "0.2", "--out",
                     f.file(std::string(name) + "_p.csv")}),
                0);
      const std::string said = testing::internal::GetCapturedStderr();
      const bool named =
          said.find("1 of 401 rows refused: line 2: more than 1e6") != std::string::npos;
      EXPECT_EQ(named, std::string(name) == "bad") << said;
    }
    EXPECT_EQ(read(f.file("good_p.csv")), read(f.file("bad_p.csv"))) << first;
  }
}

// Unix stamps and the metres of a map grid: the same poses, that far away.
TEST(CmdPredict, WhereALogBeginsChangesNothing) {
  Folder f;
  const auto lines = wavy_log(true);
  constexpr double kFar_s = 1764000000, kFarX_m = 465000, kFarY_m = 5249000;
  std::string near = kHeaderCmd, far = kHeaderCmd;
  for (const std::string& line : lines) {
    double t = 0, x = 0, y = 0;
    int rest = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%n", &t, &x, &y, &rest), 3);
    char begin[120];
    std::snprintf(begin, sizeof begin, "%.6f,%.6f,%.6f,", kFar_s + t, kFarX_m + x, kFarY_m + y);
    near += line + "\n";
    far += begin + line.substr(static_cast<std::size_t>(rest)) + "\n";
  }
  write(f.file("near.csv"), near);
  write(f.file("far.csv"), far);
  for (const char* method : {"none", "hold", "paper", "kalman", "singer", "own"}) {
    for (const char* name : {"near", "far"})
      ASSERT_EQ(run({"--log", f.file(std::string(name) + ".csv"), "--delay", "0.2", "--method",
                     method, "--out", f.file(std::string(name) + "_p.csv")}),
                0);
    const Rows a = rows_of(f.file("near_p.csv"), kPose), b = rows_of(f.file("far_p.csv"), kPose);
    ASSERT_EQ(a.size(), b.size()) << method;
    ASSERT_GT(a.size(), 300u);
    // A stamp of today is a double to a quarter of a microsecond: a command that acts from a
    // sample's own instant may count a step of its integral earlier. The published model can
    // diverge.
    const double near_m = std::string(method) == "paper" ? 1e-3 : 1e-4;
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_NEAR(b[i][0] - kFar_s, a[i][0], 1e-6);
      ASSERT_NEAR(b[i][1] - kFarX_m, a[i][1], near_m) << method << " row " << i;
      ASSERT_NEAR(b[i][2] - kFarY_m, a[i][2], near_m) << method << " row " << i;
    }
  }
}

// With a hand-back no step between rows is larger than the motion and what fades of the difference.
TEST(CmdPredict, HandBackSmoothsTheSteps) {
  Folder f;
  write(f.file("log.csv"), joined(kHeader, wavy_log(false), 400));
  std::map<std::string, double> step;
  for (const char* s : {"0", "0.15"}) {
    ASSERT_EQ(run({"--log", f.file("log.csv"), "--delay", "0.5", "--hand-back", s, "--out",
                   f.file("p.csv")}),
              0);
    const Rows out = rows_of(f.file("p.csv"), kPose);
    for (std::size_t i = 2; i < out.size(); ++i) {
      // What is not steady motion: the second difference.
      step[s] = std::max(step[s], std::abs(out[i][1] - 2 * out[i - 1][1] + out[i - 2][1]));
    }
  }
  std::printf("largest second difference of x: %.2f mm, handed back %.2f mm\n", 1e3 * step["0"],
              1e3 * step["0.15"]);
  EXPECT_LT(step["0.15"], 0.7 * step["0"]);
  expect_refused(
      f,
      {"--log", f.file("log.csv"), "--delay", "0.1", "--hand-back", "-1", "--out", f.file("p.csv")},
      "[0 - 10]");
}

// Real logs: position error by method; prediction must beat standing still by far, and learning
// must not lose against holding the velocity.
TEST(CmdPredict, RealLogs) {
  const fs::path data = tests::in_tree("../shared/data/odometry");
  if (!fs::exists(data)) GTEST_SKIP() << "no recorded odometry at " << data;
  Folder f;
  for (const char* name : {"tuc_lecture_hall", "trolley_mocap_mid", "mrclam6_robot3"}) {
    const std::string log = (data / (std::string(name) + ".csv")).string();
    ASSERT_TRUE(fs::exists(log));
    const Rows truth = rows_of(log, kPose);
    for (const char* delay : {"0.2", "0.5"}) {
      std::map<std::string, double> rms;
      for (const char* method : {"none", "hold", "lsq"}) {
        ASSERT_EQ(
            run({"--log", log, "--delay", delay, "--method", method, "--out", f.file("p.csv")}), 0);
        rms[method] = rms_position(truth, rows_of(f.file("p.csv"), kPose));
      }
      std::printf("%-18s delay %s s: RMS none %.2f mm, hold %.2f mm, lsq %.2f mm\n", name, delay,
                  1e3 * rms["none"], 1e3 * rms["hold"], 1e3 * rms["lsq"]);
      EXPECT_LE(rms["lsq"], 0.3 * rms["none"]);
      EXPECT_LE(rms["lsq"], 1.05 * rms["hold"]);
    }
  }
}

}  // namespace
