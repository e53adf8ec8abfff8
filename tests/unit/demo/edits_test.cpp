// What the operator asks of the scene while the stack runs, on the virtual clock: through the
// console's script, the edge to fusion, map and cost map to the path.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "perception/map_file/map_file.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"

namespace {

namespace fs = std::filesystem;
using perception::Vec3;
using teletact::DemoOptions;
using teletact::EditConfig;
using teletact::Scene;
using teletact::VirtualRun;

rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

// Gone when the program ends.
const fs::path& folder() {
  static const struct Folder {
    fs::path path = fs::temp_directory_path() / ("teletact_edits_" + std::to_string(::getpid()));
    Folder() { fs::create_directories(path); }
    ~Folder() { fs::remove_all(path); }
  } f;
  return f.path;
}

std::unique_ptr<Scene> scene(const std::vector<std::string>& overrides = {}) {
  return teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
}

VirtualRun run(Scene& s, double seconds, DemoOptions options = {}) {
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  return teletact::run_virtual(startup().token(), s, options, teletact::reference_calibration());
}

std::string text_of(const fs::path& file) {
  std::stringstream s;
  s << std::ifstream(file).rdbuf();
  return s.str();
}

EditConfig edit(const std::string& kind, double at_s, const std::array<double, 3>& centre) {
  EditConfig e;
  e.kind = kind;
  e.at_s = at_s;
  e.position_m = centre;
  return e;
}

// Nearest that a path's points, and the straight lines between them, come to a place.
double nearest(const tasks::Path& path, double x, double y) {
  double least = 1e9;
  for (int i = 0; i + 1 < path.size; ++i) {
    const auto& a = path.points[static_cast<std::size_t>(i)];
    const auto& b = path.points[static_cast<std::size_t>(i) + 1];
    const double dx = b[0] - a[0], dy = b[1] - a[1], d2 = dx * dx + dy * dy;
    const double t = d2 > 0 ? std::clamp(((x - a[0]) * dx + (y - a[1]) * dy) / d2, 0.0, 1.0) : 0.0;
    least = std::min(least, std::hypot(a[0] + t * dx - x, a[1] + t * dy - y));
  }
  return least;
}

// The default room without its hurdle: free floor between the robot and the mark.
std::unique_ptr<Scene> without_hurdle(const std::vector<std::string>& overrides = {}) {
  auto s = scene(overrides);
  EXPECT_EQ(s->world.boxes.front().name, "hurdle");
  s->world.boxes.pop_front();
  return s;
}

// The robot is on its way when the operator draws a disc onto its path: it goes round.
TEST(SceneEdits, AnObstacleDrawnOnTheWayIsGoneRound) {
  constexpr double kSeconds = 12, kDrawn_s = 5.2, kRadius_m = 0.08;
  auto plain = without_hurdle();
  const VirtualRun before = run(*plain, kSeconds);
  ASSERT_FALSE(before.op.view.paths.empty());
  // On the way, ahead of the robot: where the path passes a metre from the start.
  const auto& first = before.op.view.paths.front();
  ASSERT_GT(first.size, 4);
  double x = 0, y = 0;
  for (int i = 0; i < first.size; ++i) {
    const auto& p = first.points[static_cast<std::size_t>(i)];
    if (std::hypot(p[0], p[1]) > 1.0) {
      x = p[0], y = p[1];
      break;
    }
  }
  ASSERT_GT(std::hypot(x, y), 0.9);
  auto drawn = without_hurdle();
  EditConfig disc = edit("disc", kDrawn_s, {x, y, 0});
  disc.radius_m = kRadius_m;
  drawn->operator_script.edits.push_back(disc);
  DemoOptions options;
  options.log_folder = (folder() / "drawn").string();
  const VirtualRun after = run(*drawn, kSeconds, options);
  EXPECT_EQ(after.op.view.edits, 1U);
  EXPECT_NE(text_of(folder() / "drawn/operator.log").find("fusion: edit 1: kind 1"),
            std::string::npos);
  ASSERT_GE(after.op.view.paths.size(), 2U) << "the old path no longer holds";
  const double radius = drawn->graph.fusion.ground.robot_radius_m;
  const double was = nearest(first, x, y), is = nearest(after.op.view.paths.back(), x, y);
  // And where the robot really went.
  double way = 1e9;
  for (const auto& s : after.robot.view.truth)
    way = std::min(way, std::hypot(s.x_m - x, s.y_m - y));
  std::printf("  disc at (%.2f, %.2f): path %.3f m from it, then %.3f; robot %.3f m\n", x, y, was,
              is, way);
  EXPECT_LT(was, 0.05);
  EXPECT_GT(is, radius + kRadius_m);
  EXPECT_GT(way, radius + kRadius_m - 0.05);
  EXPECT_GE(after.op.view.arrivals, 1U);
  EXPECT_EQ(after.robot.view.truth.back().collisions, 0U);
}

// The hurdle of the default room.
const Vec3 kHurdle(1.00, 0.05, 0.075), kHurdleSize(0.24, 0.40, 0.15);

std::size_t vertices_of_the_hurdle(const std::string& map_file) {
  // Above the floor's own surface.
  const Eigen::AlignedBox3d box(Vec3(kHurdle - kHurdleSize / 2 - Vec3(0.03, 0.03, -0.06)),
                                Vec3(kHurdle + kHurdleSize / 2 + Vec3::Constant(0.03)));
  auto& nrt = startup().token();
  auto read = perception::read_map_file(nrt, map_file);
  EXPECT_TRUE(read) << read.error();
  perception::TsdfConfig config;
  config.voxel_size_m = read.value().info.voxel_size_m;
  perception::TsdfMap map(nrt, config);
  perception::Keyframes keyframes(nrt, {});
  EXPECT_TRUE(perception::restore_map(nrt, read.value(), map, keyframes));
  std::size_t n = 0;
  for (const auto& v : perception::extract_mesh(nrt, map).vertices_W)
    n += box.contains(v.cast<double>()) ? 1 : 0;
  return n;
}

// Images consumed until the first claim; -1: none.
int found_at(const VirtualRun& r) {
  int consumed = 0;
  for (const auto& f : r.op.view.fusion) {
    consumed += f.consumed ? 1 : 0;
    if (f.claimed) return consumed;
  }
  return -1;
}

// A map of an earlier run, loaded by the scene's key: the camera is found in it, where the run
// begins elsewhere and looks elsewhere. Then the hurdle of that run is gone: what is seen
// contradicts the map, and the ghost stays; the operator clears it, and the camera is found.
TEST(SceneEdits, AStoredMapIsFoundByKeyAndAGhostInItIsCleared) {
  const std::string map_file = (folder() / "room.map").string();
  {
    auto s = scene();
    DemoOptions options;
    options.save_map = map_file;
    (void)run(*s, 2.5, options);
  }
  ASSERT_TRUE(fs::exists(map_file));
  ASSERT_GT(vertices_of_the_hurdle(map_file), 20U);
  enum Case { kThere, kGone, kCleared };
  for (const Case c : {kThere, kGone, kCleared}) {
    auto s = scene({"fusion.map=\"" + map_file + "\"", "robot_io.start_x_m=0.15",
                    "robot_io.start_y_m=0.1", "robot_io.start_yaw_rad=0.12"});
    ASSERT_EQ(s->world.boxes.front().name, "hurdle");
    if (c != kThere) s->world.boxes.pop_front();
    EditConfig clear = edit("clear", 0.1, {kHurdle.x(), kHurdle.y(), 0.16});
    clear.size_m = {0.5, 0.7, 0.28};
    if (c == kCleared) s->operator_script.edits.push_back(clear);
    DemoOptions options;
    options.save_map = (folder() / "after.map").string();
    const VirtualRun r = run(*s, 1.2, options);
    EXPECT_EQ(r.op.view.edits, c == kCleared ? 1U : 0U);
    const int found = found_at(r);
    const std::size_t left = vertices_of_the_hurdle(options.save_map);
    std::printf("  case %d: found at image %d; %zu vertices of the hurdle\n", static_cast<int>(c),
                found, left);
    if (c == kGone) {
      EXPECT_GT(left, 20U) << "else there would be nothing to clear";
      continue;
    }
    EXPECT_GT(found, 1) << "a stored map is not believed at the first image";
    EXPECT_LE(found, 15);
    // Where the camera stands, by the twin: the robot has not moved.
    const Vec3 truth = (s->start_X_WB() * s->camera.X_BC()).translation();
    const auto& p = r.op.view.fusion.back().p_WC;
    const Vec3 is(static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2]));
    EXPECT_LT((is - truth).norm(), 0.03);
    if (c == kThere) {
      EXPECT_GT(left, 20U);
    } else {
      EXPECT_EQ(left, 0U);
    }
  }
}

TEST(SceneEdits, AMapThatCanNotBeLoadedIsOneLine) {
  const auto refused = [](const std::string& map, const std::vector<std::string>& more = {}) {
    std::vector<std::string> overrides{"fusion.map=\"" + map + "\""};
    overrides.insert(overrides.end(), more.begin(), more.end());
    try {
      (void)scene(overrides);
    } catch (const std::exception& e) {
      const std::string what = e.what();
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
      EXPECT_NE(what.find("fusion.map"), std::string::npos) << what;
      return what;
    }
    ADD_FAILURE() << map << " was taken";
    return std::string();
  };
  EXPECT_NE(refused("/nowhere/at.all").find("/nowhere/at.all"), std::string::npos);
  const std::string none = (folder() / "none.map").string();
  std::ofstream(none) << "not a map";
  EXPECT_NE(refused(none).find(none), std::string::npos);
  perception::TsdfConfig config;
  config.voxel_size_m = 0.02;
  config.max_blocks = 64;
  config.max_chunks = 8;
  perception::TsdfMap map(startup().token(), config);
  perception::Keyframes keyframes(startup().token(), {});
  const std::string empty = (folder() / "empty.map").string();
  std::ofstream(empty, std::ios::binary)
      << perception::encode_map(startup().token(), map, keyframes);
  refused(empty, {"fusion.tsdf.voxel_size_m=0.01"});
  EXPECT_EQ(scene({"fusion.map=\"" + empty + "\""})->graph.fusion.tsdf.voxel_size_m, 0.02)
      << "a scene that names no voxel takes the map's";
}

TEST(SceneEdits, TheConsoleComposesTheMesh) {
  auto s = scene({"fusion.mesh_blocks=200"});
  DemoOptions options;
  options.log_folder = (folder() / "mesh").string();
  options.save_map = (folder() / "mesh.map").string();
  const VirtualRun r = run(*s, 3, options);
  EXPECT_TRUE(std::any_of(r.effects.begin(), r.effects.end(),
                          [](const auto& e) { return e.second == "fusion.mesh_blocks"; }));
  const std::string ply = text_of(folder() / "mesh/scene.ply");
  const auto at = ply.find("element face ");
  ASSERT_NE(at, std::string::npos);
  const int faces = std::atoi(ply.c_str() + at + 13);
  std::printf("  %d triangles at the console\n", faces);
  EXPECT_GT(faces, 10000);
}

TEST(SceneEdits, KeysAreChecked) {
  const auto refused = [](const std::string& text) {
    const fs::path file = folder() / "scene.toml";
    std::ofstream(file) << text;
    EXPECT_THROW((void)teletact::load_scene(file, {}), std::runtime_error) << text;
  };
  refused("[[operator.edit]]\nkind = \"paint\"\n");
  refused("[[operator.edit]]\nkind = \"disc\"\nid = 0\n");
  refused("[[operator.edit]]\nkind = \"clear\"\nsize_m = [1, 1, 11]\n");
  refused("[[operator.edit]]\nat = 3\n");
}

}  // namespace
