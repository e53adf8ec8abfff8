// --json FILE of every command: its shape, and that docs/metrics.md has every name and its unit.
// The list of commands is the program's own, so one without --json, or without a case here, fails.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "rt/audit/run_file.hpp"
#include "tests/support/paths.hpp"
#include "tests/unit/drivers_camera/tum_folder.hpp"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

const std::string kProgram = tests::in_build("teletact");

std::string read(const fs::path& path) {
  std::ostringstream out;
  out << std::ifstream(path).rdbuf();
  return out.str();
}

// Exit code, and what it printed.
std::pair<int, std::string> run(const std::string& words) {
  std::FILE* pipe = ::popen((kProgram + " " + words + " 2>&1").c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

// ---- docs/metrics.md
// -----------------------------------------------------------------------------

struct Documented {
  std::regex name;
  std::set<std::string> units;
};

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  int depth = 0;
  for (const char c : text) {
    depth += c == '{' ? 1 : c == '}' ? -1 : 0;
    if (c == at && depth == 0)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  for (auto& p : parts) {
    p.erase(0, p.find_first_not_of(" `"));
    p.erase(p.find_last_not_of(" `") + 1);
  }
  return parts;
}

// "haptic.miss_{own, late}" names two, "<task>.jobs" one for each task, Q a queue, S a size.
std::regex pattern(const std::string& name) {
  std::string out;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = name[i];
    if (c == '`') continue;
    if (c == '{') {
      const std::size_t end = name.find('}', i);
      std::string choice = name.substr(i + 1, end - i - 1);
      choice = std::regex_replace(choice, std::regex(", *"), "|");
      out += "(" + choice + ")";
      i = end;
    } else if (c == '<') {
      out += "[a-z_0-9]+";
      i = name.find('>', i);
    } else if (c == 'Q' && i > 0 && name[i - 1] == '.') {
      out += "(own|boost|moodycamel)";
    } else if (c == 'S' && i > 0 && name[i - 1] == '.') {
      out += "(8B|256B)";
    } else {
      out += c == '.' ? "\\." : std::string(1, c);
    }
  }
  return std::regex(out);
}

std::vector<Documented> documented() {
  std::vector<Documented> all;
  std::istringstream page(read(tests::in_tree("docs/metrics.md")));
  for (std::string line; std::getline(page, line);) {
    if (line.rfind("| ", 0) != 0 || line.find('.') == std::string::npos) continue;
    const auto cells = split(line, '|');
    if (cells.size() < 4) continue;
    std::string prefix;
    for (const auto& part : split(cells[1], ',')) {
      std::string name = part;
      if (name.rfind('.', 0) == 0) name = prefix + name;
      std::string stem = name.substr(0, name.rfind('.'));
      prefix = stem;
      if (name.find('.') == std::string::npos) continue;
      Documented d{pattern(name), {}};
      for (const auto& unit : split(cells[2], ',')) d.units.insert(unit);
      all.push_back(std::move(d));
    }
  }
  return all;
}

// ---- inputs
// --------------------------------------------------------------------------------------

class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("teletact_json_" + std::to_string(::getpid()))) {
    fs::remove_all(path_);
    fs::create_directories(path_);
    floor();
    std::ofstream hand(path_ / "hand.csv");
    hand << "t_s,x,y,z\n";
    for (int i = 0; i < 300; ++i)
      hand << 1e-3 * i << ",0.11,0.11," << (i < 180 ? 0.125 - 1e-4 * i : 0.107) << '\n';
    std::ofstream odometry(path_ / "odo.csv");
    odometry << "t_s,x_m,y_m,yaw_rad,vx,vy,wz\n";
    for (int i = 0; i < 100; ++i) odometry << 0.01 * i << ',' << 0.001 * i << ",0,0,0.1,0,0\n";
    rt::RunLog log;
    rt::TaskLog task;
    task.spec.name = "haptic";
    task.spec.rate = {1000, 1};
    task.spec.budget = rt::Nanos{100000};
    log.tasks = {task};
    rt::RunFileWriter writer((path_ / "a.run").string(), log);
    for (std::uint64_t k = 0; k < 50; ++k) {
      rt::JobRecord r;
      r.k = k;
      r.release_ns = static_cast<std::int64_t>(k) * 1000000;
      r.start_ns = r.release_ns + 4000;
      r.end_ns = r.start_ns + 9000;
      r.deadline_ns = r.release_ns + 1000000;
      r.cpu_ns = 8000;
      writer.add(r);
    }
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const {
    return (path_ / name).string();
  }

 private:
  void floor() {
    std::string head = "{'descr': '<f4', 'fortran_order': False, 'shape': (24, 24, 24), }";
    while ((head.size() + 11) % 64 != 0) head += ' ';
    head += '\n';
    std::ofstream out(path_ / "floor.npy", std::ios::binary);
    out << std::string("\x93NUMPY\x01\x00", 8) << static_cast<char>(head.size())
        << static_cast<char>(head.size() >> 8U) << head;
    for (int i = 0; i < 24 * 24 * 24; ++i) {
      const float d = 0.01F * static_cast<float>(i % 24) - 0.115F;
      out.write(reinterpret_cast<const char*>(&d), sizeof d);
    }
  }
  fs::path path_;
};

struct Case {
  std::string words;            // without --json
  std::string command;          // as the file must name it
  std::set<std::string> needs;  // metrics that must be there
  std::set<int> codes{0};
};

std::vector<Case> cases(const Folder& f, const camera_test::TumFolder& images) {
  const std::string run = "--clock virtual --quiet ";
  return {
      {"demo " + run + "--seconds 5 --bodies stub --report " + (f / "stub"),
       "demo",
       {"run.sched_hash", "haptic.releases", "run.measured"}},
      {"demo " + run + "--seconds 1 --record --report " + (f / "rec"),
       "demo",
       {"run.log_hash", "fusion.frames_overwritten", "robot.path_m", "link.round_trip_ms"}},
      {"replay " + (f / "rec/raw"),
       "replay",
       {"replay.operator.jobs", "replay.operator.equal", "replay.robot.equal"}},
      {"fuse --rgbd " + images.path() + " --poses " + (f / "p.txt") + " --ply " + (f / "m.ply"),
       "fuse",
       {"fusion.frames", "fusion.cpu_p50_ms", "fusion.vertices"}},
      {"codec --mode quiet --rgbd " + images.path() + " --out " + (f / "coded"),
       "codec",
       {"codec.frames", "codec.mbit_s", "codec.fps_in_rate"}},
      {"explain empty_room", "explain", {"explain.asked", "explain.not_asked"}},
      {"film --frames 2 --out " + (f / "film"), "film", {"film.frames", "film.readings_share"}},
      {"touch --field " + (f / "floor.npy") + " --voxel 0.01 --path " + (f / "hand.csv") +
           " --out " + (f / "t.csv"),
       "touch",
       {"touch.ticks", "touch.force_max_N", "touch.contact_share", "touch.cpu_p99_us"}},
      {"predict --log " + (f / "odo.csv") + " --delay 0.1 --out " + (f / "o.csv"),
       "predict",
       {"predict.rows", "predict.predicted"}},
      {"calibrate --seconds 2 --quiet --out " + (f / "c.toml"),
       "calibrate",
       {"calibrate.haptic.0.p99_us", "calibrate.fusion.20mm.1.budget_us"}},
      {"audit " + (f / "a.run"), "audit", {"haptic.jobs", "haptic.miss_own"}},
      {"bench rings --rounds 1", "bench rings", {"ring.line_ns", "ring.measured"}},
      {"bench wakeup --rounds 1 --slice 0.2", "bench wakeup", {"wakeup.p50_plain_us"}, {0, 1}},
      {"bench drift --frames 20 --voxel 0.04 --half-size", "bench drift", {"drift.last_mm"}},
      {"accuracy fusion --frames 5 --voxels 40 --scenes room",
       "accuracy fusion",
       {"accuracy.fusion.room.voxel_40mm.ate_mm"}},
      {"accuracy weighting --frames 5 --voxels 40 --scenes room --samples 0",
       "accuracy weighting",
       {"accuracy.weighting.chosen_room_40mm.default_watch.ate_mm"}},
      {"accuracy moving --only 1 --voxels 40 --levels 2 --no-odometry",
       "accuracy moving",
       {"moving.claimed_share", "moving.failing.ghost_cm3"},
       {0, 1}},
      {"accuracy prediction --trace-seconds 10",
       "accuracy prediction",
       {"accuracy.prediction.paths_100ms.own.mean_cm",
        "accuracy.prediction.paths_400ms.ridge_m1.cpu_us"}},
      {"bench audit", "bench audit", {"audit.job_ns", "log.record_ns"}, {0, 1}},
      {"device --kind twin --seconds 0.2", "device", {"device.new", "device.missing"}},
      {"identify --kind twin --seconds 1.5", "identify", {"identify.x.mass_kg"}},
      {"stability --cases 1 --angles 17 --speeds 200 --no-optimum --beside --layer both",
       "stability",
       {"stability.case1.pass", "stability.case1.j_raw_N", "stability.case1.nearest10.j_N",
        "stability.case1.force_shading.layer_off.margin"},
       {0, 1}},
      {"segment --color " + images.path() + "/rgb/0.png --touch 3,3 --out " + (f / "mask.png"),
       "segment",
       {"segment.cpu_ms"}},
      {"doctor", "doctor", {"doctor.verdict", "doctor.clock"}, {0, 1, 2}},
  };
}

// The first words of the program's usage.
std::set<std::string> commands() {
  std::set<std::string> out;
  std::istringstream usage(run("--help").second);
  bool listed = false;
  for (std::string line; std::getline(usage, line);) {
    if (line.rfind("usage:", 0) == 0) listed = true;
    if (listed && line.rfind("  ", 0) == 0) {
      std::istringstream words(line);
      std::string name;
      words >> name;
      out.insert(name);
    }
  }
  return out;
}

void check(const std::string& file, const Case& c, const std::vector<Documented>& names) {
  json j;
  ASSERT_NO_THROW(j = json::parse(read(file)));
  EXPECT_EQ(j.value("command", ""), c.command);
  EXPECT_FALSE(j.value("version", "").empty());
  EXPECT_FALSE(j.value("host", "").empty());
  ASSERT_TRUE(j.contains("metrics") && j["metrics"].is_array());
  EXPECT_FALSE(j["metrics"].empty());
  std::set<std::string> seen;
  for (const auto& m : j["metrics"]) {
    ASSERT_EQ(m.size(), 3U) << m.dump();
    ASSERT_TRUE(m.contains("value")) << m.dump();
    EXPECT_TRUE(m["value"].is_number() || m["value"].is_string() || m["value"].is_null());
    const auto name = m.at("name").get<std::string>(), unit = m.at("unit").get<std::string>();
    EXPECT_TRUE(seen.insert(name).second) << name << " twice";
    bool known = false, right = false;
    for (const auto& d : names) {
      if (!std::regex_match(name, d.name)) continue;
      known = true;
      right = right || d.units.count(unit) > 0;
    }
    EXPECT_TRUE(known) << name << " is not in docs/metrics.md";
    if (!known) continue;
    EXPECT_TRUE(right) << name << ": unit " << unit << " is not the documented one";
  }
  for (const auto& need : c.needs) EXPECT_TRUE(seen.count(need) > 0) << need;
}

// A still view of a ridge in place of its images: something that fuse can track.
void show_a_ridge(const camera_test::TumFolder& images, int frames) {
  constexpr int kWidth = 160, kHeight = 120;
  images.write("intrinsics.txt", "140 140 79.5 59.5 160 120 1000\n");
  cv::Mat depth(kHeight, kWidth, CV_16UC1);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      depth.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>(1000 + 4 * std::abs(u - 80) + 3 * std::abs(v - 50));
    }
  }
  for (int i = 0; i < frames; ++i) {
    const std::string name = std::to_string(i) + ".png";
    cv::imwrite(images.file("depth/" + name), depth);
    cv::imwrite(images.file("rgb/" + name),
                cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar(10, 20, 30)));
  }
}

TEST(Json, EveryCommandWritesIt) {
  const Folder folder;
  const camera_test::TumFolder images(4);
  show_a_ridge(images, 4);
  const auto names = documented();
  ASSERT_GT(names.size(), 80U);
  std::set<std::string> covered;
  for (const Case& c : cases(folder, images)) {
    SCOPED_TRACE(c.words);
    covered.insert(c.words.substr(0, c.words.find(' ')));
    const std::string file = folder / "out.json";
    fs::remove(file);
    const auto [code, text] = run(c.words + " --json " + file);
    EXPECT_TRUE(c.codes.count(code) > 0) << "exit code " << code << ": " << text;
    check(file, c, names);
  }
  // Boxes run until they are stopped, and these answer in forms of their own:
  // tests/fault/two_boxes, tests/unit/{tool_keys,tool_audit,tool_run}, the tests of `teletact
  // ethercat` and, for `can`, tests/unit/tool_can.
  for (const char* other :
       {"can", "ethercat", "keys", "operator", "report", "robot", "status", "twin", "youbot"})
    EXPECT_TRUE(covered.insert(other).second) << other;
  EXPECT_EQ(covered, commands()) << "each command has a case here";
}

// A file that can not be written is an error, and the run says so.
TEST(Json, AFileThatCanNotBeWrittenIsAnError) {
  const Folder folder;
  for (const std::string& words :
       {"predict --log " + (folder / "odo.csv") + " --delay 0.1 --out " + (folder / "o.csv"),
        "touch --field " + (folder / "floor.npy") + " --voxel 0.01 --path " +
            (folder / "hand.csv") + " --out " + (folder / "t.csv"),
        "audit " + (folder / "a.run"), std::string("doctor")}) {
    const auto [code, text] = run(words + " --json /nonexistent/x.json");
    EXPECT_EQ(code, 2) << text;
    EXPECT_NE(text.find("/nonexistent/x.json"), std::string::npos) << text;
  }
  EXPECT_FALSE(fs::exists(folder / "o.csv"));
  EXPECT_FALSE(fs::exists(folder / "t.csv"));
}

// The judge of names can fail.
TEST(Json, NamesAreJudged) {
  const auto names = documented();
  const auto known = [&](const std::string& name) {
    for (const auto& d : names) {
      if (std::regex_match(name, d.name)) return true;
    }
    return false;
  };
  EXPECT_TRUE(known("haptic.skipped")) << ".skipped after haptic.completed";
  EXPECT_TRUE(known("haptic.miss_charged")) << "in braces";
  EXPECT_TRUE(known("ring.moodycamel.256B.rtt_ns"));
  EXPECT_TRUE(known("planning.cpu_p99_us")) << "<task>";
  EXPECT_FALSE(known("haptic.miss_weather"));
  EXPECT_FALSE(known("ring.other.8B.Mops"));
  EXPECT_FALSE(known("nothing.at_all"));
}

}  // namespace
