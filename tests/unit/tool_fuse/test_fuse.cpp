// teletact fuse on a rendered sequence written as files: poses, claims, determinism, bad input.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "tests/support/analytic_scene.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
using perception::Pose;
using perception::Vec3;

std::string slurp(const fs::path& p) {
  std::ifstream in(p, std::ios::binary);
  std::stringstream s;
  s << in.rdbuf();
  return s.str();
}

class Fuse : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() /
            ("teletact_fuse_" + std::to_string(getpid()) + "_" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(root_ / "seq" / "depth");
    fs::create_directories(root_ / "seq" / "rgb");
  }
  void TearDown() override { fs::remove_all(root_); }

  void write_sequence(const tests::AnalyticScene& scene, const std::vector<Pose>& poses) {
    const auto k = tests::small_camera();
    rt::Random random(77);
    std::ofstream list(root_ / "seq" / "associations.txt");
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const auto mm = tests::to_mm(tests::cast_depth(scene, k, poses[i]), 0.001, random);
      cv::Mat depth(k.height, k.width, CV_16UC1),
          colour(k.height, k.width, CV_8UC3, {90, 120, 200});
      std::copy(mm.begin(), mm.end(), depth.ptr<std::uint16_t>());
      char stamp[32];
      std::snprintf(stamp, sizeof stamp, "%.6f", static_cast<double>(i) / 30);
      const std::string d = std::string("depth/") + stamp + ".png",
                        c = std::string("rgb/") + stamp + ".png";
      cv::imwrite((root_ / "seq" / d).string(), depth);
      cv::imwrite((root_ / "seq" / c).string(), colour);
      list << stamp << ' ' << c << ' ' << stamp << ' ' << d << '\n';
    }
    std::ofstream(root_ / "seq" / "intrinsics.txt")
        << k.fx << ' ' << k.fy << ' ' << k.cx << ' ' << k.cy << ' ' << k.width << ' ' << k.height
        << " 1000\n";
  }
  void write_odometry(const std::vector<Pose>& poses) {
    std::ofstream out(root_ / "odometry.txt");
    out.precision(9);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Eigen::Quaterniond q(poses[i].linear());
      const Vec3 t = poses[i].translation();
      char stamp[32];
      std::snprintf(stamp, sizeof stamp, "%.6f", static_cast<double>(i) / 30);
      out << stamp << ' ' << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.x() << ' ' << q.y()
          << ' ' << q.z() << ' ' << q.w() << '\n';
    }
  }
  int fuse(std::vector<std::string> extra, const std::string& name = "out") {
    std::vector<std::string> args{"fuse", "--rgbd", (root_ / "seq").string(), "--poses",
                                  (root_ / (name + ".txt")).string()};
    if (mesh_wanted_) args.insert(args.end(), {"--ply", (root_ / (name + ".ply")).string()});
    if (extra.empty() || extra[0] != "--voxel") args.insert(args.end(), {"--voxel", "0.02"});
    args.insert(args.end(), extra.begin(), extra.end());
    std::vector<char*> argv;
    for (auto& a : args) argv.push_back(a.data());
    return teletact::cmd_fuse(static_cast<int>(argv.size()), argv.data());
  }
  struct Line {
    double t;
    Pose X;
  };
  [[nodiscard]] std::vector<Line> claims(const std::string& name = "out") const {
    std::istringstream in(slurp(root_ / (name + ".txt")));
    std::vector<Line> lines;
    for (std::string text; std::getline(in, text);) {
      if (text.empty() || text[0] == '#') continue;
      std::istringstream s(text);
      double t, x, y, z, qx, qy, qz, qw;
      s >> t >> x >> y >> z >> qx >> qy >> qz >> qw;
      Pose X = Pose::Identity();
      X.linear() = Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix();
      X.translation() = Vec3(x, y, z);
      lines.push_back({t, X});
    }
    return lines;
  }
  fs::path root_;
  bool mesh_wanted_ = true;
};

std::vector<Pose> drive(int n) {
  std::vector<Pose> poses;
  for (int i = 0; i < n; ++i) {
    poses.push_back(
        tests::look_at(Vec3(-0.2 + 0.008 * i, 0.1 - 0.004 * i, 0.9), Vec3(1.8, -0.05, 0.3)));
  }
  return poses;
}

TEST_F(Fuse, PosesFollowTheTruthAndRunsAreEqual) {
  const auto truth = drive(15);
  write_sequence(tests::test_room(), truth);
  ASSERT_EQ(fuse({"--json", (root_ / "m.json").string()}), 0);
  const auto lines = claims();
  ASSERT_EQ(lines.size(), truth.size());
  double worst = 0;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    EXPECT_NEAR(lines[i].t, static_cast<double>(i) / 30, 1e-6);
    const Pose expected = truth[0].inverse() * truth[i];
    worst = std::max(worst, (lines[i].X.translation() - expected.translation()).norm());
  }
  std::cout << "worst translation error " << worst * 1000 << " mm over "
            << 1000 * (truth.back().translation() - truth[0].translation()).norm() << " mm\n";
  EXPECT_LT(worst, 0.005);
  EXPECT_NE(slurp(root_ / "m.json").find("fusion.frames_tracked"), std::string::npos);
  EXPECT_EQ(slurp(root_ / "out.ply").rfind("ply\n", 0), 0U);
  ASSERT_EQ(fuse({}, "again"), 0);
  EXPECT_EQ(slurp(root_ / "out.txt"), slurp(root_ / "again.txt"));
  EXPECT_EQ(slurp(root_ / "out.ply"), slurp(root_ / "again.ply"));
  mesh_wanted_ = false;
  ASSERT_EQ(fuse({}, "alone"), 0);
  EXPECT_EQ(slurp(root_ / "out.txt"), slurp(root_ / "alone.txt"));
  EXPECT_FALSE(fs::exists(root_ / "alone.ply"));
}

TEST_F(Fuse, FlatWallIsClaimedOnlyWithOdometry) {
  tests::AnalyticScene wall;
  wall.planes = {{Vec3(1.2, 0, 0), -Vec3::UnitX()}};
  std::vector<Pose> truth;
  for (int i = 0; i < 10; ++i)
    truth.push_back(tests::look_at(Vec3(0, 0.005 * i, 0.5), Vec3(1.2, 0.005 * i, 0.5)));
  write_sequence(wall, truth);
  ASSERT_EQ(fuse({}, "alone"), 1) << "nothing is claimed but the origin";
  EXPECT_EQ(claims("alone").size(), 1U) << "only the first frame, which defines the world";
  EXPECT_NE(slurp(root_ / "alone.txt").find("# degenerate "), std::string::npos);
  write_odometry(truth);
  ASSERT_EQ(fuse({"--odometry", (root_ / "odometry.txt").string()}, "with"), 0);
  const auto lines = claims("with");
  ASSERT_EQ(lines.size(), truth.size());
  const Pose expected = truth[0].inverse() * truth.back();
  EXPECT_LT((lines.back().X.translation() - expected.translation()).norm(), 0.002);
}

TEST_F(Fuse, KnobsComeFromFileThenSetThenOptions) {
  write_sequence(tests::test_room(), drive(4));
  std::ofstream(root_ / "k.toml") << "[fusion.tsdf]\nmax_depth_m = 2.0\nvoxel_size_m = 0.08\n";
  // Within 2 m there is too little to claim a frame by: that ends with 1, its mesh is written.
  const auto vertices = [&](const std::vector<std::string>& extra, int code = 0) {
    EXPECT_EQ(fuse(extra), code);
    const std::string ply = slurp(root_ / "out.ply");
    return std::stoi(ply.substr(ply.find("element vertex ") + 15));
  };
  const std::string file = (root_ / "k.toml").string();
  const int all = vertices({}), near = vertices({"--config", file}, 1);
  EXPECT_LT(near, all / 2) << "nothing beyond 2 m; the voxel that has an option stays";
  EXPECT_EQ(vertices({"--config", file, "--set", "fusion.tsdf.max_depth_m=5.0"}), all);
  EXPECT_EQ(vertices({"--set", "fusion.tsdf.max_depth_m=5.0", "--max-depth", "2"}, 1), near);
  EXPECT_LT(vertices({"--mesh-weight", "4"}), all) << "seen in four frames or more";
}

// A camera that reads 2 % too much: without the table the same poses come out larger, with it they
// are right.
TEST_F(Fuse, DepthBiasIsTakenOut) {
  const auto truth = drive(8);
  write_sequence(tests::test_room(), truth);
  ASSERT_EQ(fuse({}, "right"), 0);
  for (const auto& entry : fs::directory_iterator(root_ / "seq" / "depth")) {
    cv::Mat depth = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
    for (int i = 0; i < static_cast<int>(depth.total()); ++i) {
      auto& mm = depth.ptr<std::uint16_t>()[i];
      mm = static_cast<std::uint16_t>(std::lround(1.02 * mm));
    }
    cv::imwrite(entry.path().string(), depth);
  }
  std::ofstream(root_ / "bias.toml") << "[[camera.bias]]\nat_mm = 102\nbias_mm = "
                                        "2\n[[camera.bias]]\nat_mm = 10200\nbias_mm = 200\n";
  const std::string file = (root_ / "bias.toml").string();
  const auto way = [&](const std::string& name) {
    const auto lines = claims(name);
    EXPECT_EQ(lines.size(), truth.size());
    return lines.back().X.translation().norm();
  };
  const double right = way("right");
  ASSERT_EQ(fuse({}, "biased"), 0);
  EXPECT_GT(way("biased"), 1.01 * right);
  ASSERT_EQ(fuse({"--bias", file}, "corrected"), 0);
  EXPECT_NEAR(way("corrected"), right, 0.004 * right);
  ASSERT_EQ(fuse({"--config", file}, "configured"), 0);
  EXPECT_EQ(slurp(root_ / "configured.txt"), slurp(root_ / "corrected.txt"));
  EXPECT_EQ(slurp(root_ / "configured.ply"), slurp(root_ / "corrected.ply"));
}

// The same images as associations.txt, as two lists and as 7-Scenes has them.
TEST_F(Fuse, LayoutsAsDownloadedGiveTheSamePoses) {
  const auto truth = drive(6);
  write_sequence(tests::test_room(), truth);
  ASSERT_EQ(fuse({}, "paired"), 0);
  const auto k = tests::small_camera();
  std::ostringstream pinhole;
  pinhole << k.fx << ',' << k.fy << ',' << k.cx << ',' << k.cy << ",1000";
  const std::vector<std::string> option{"--intrinsics", pinhole.str()};
  const fs::path seq = root_ / "seq";
  std::ofstream depth_list(seq / "depth.txt"), rgb_list(seq / "rgb.txt");
  for (std::size_t i = 0; i < truth.size(); ++i) {
    char stamp[32];
    std::snprintf(stamp, sizeof stamp, "%.6f", static_cast<double>(i) / 30);
    depth_list << stamp << " depth/" << stamp << ".png\n";
    rgb_list << static_cast<double>(i) / 30 + 0.004 << " rgb/" << stamp << ".png\n";
  }
  depth_list.close(), rgb_list.close();
  fs::remove(seq / "associations.txt");
  fs::remove(seq / "intrinsics.txt");
  ASSERT_EQ(fuse(option, "lists"), 0);
  EXPECT_EQ(slurp(root_ / "lists.txt"), slurp(root_ / "paired.txt"));
  EXPECT_EQ(slurp(root_ / "lists.ply"), slurp(root_ / "paired.ply"));
  for (std::size_t i = 0; i < truth.size(); ++i) {
    char stamp[32], frame[32];
    std::snprintf(stamp, sizeof stamp, "%.6f.png", static_cast<double>(i) / 30);
    std::snprintf(frame, sizeof frame, "frame-%06zu", i);
    fs::rename(seq / "depth" / stamp, seq / (std::string(frame) + ".depth.png"));
    fs::rename(seq / "rgb" / stamp, seq / (std::string(frame) + ".color.png"));
  }
  fs::remove(seq / "depth.txt");
  ASSERT_EQ(fuse(option, "scenes"), 0);
  const auto scenes = claims("scenes"), paired = claims("paired");
  ASSERT_EQ(scenes.size(), paired.size());
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    // Stamps are i / 30 here and six decimals of it there, which the motion prior sees.
    EXPECT_NEAR(scenes[i].t, paired[i].t, 1e-6);
    EXPECT_LT((scenes[i].X.translation() - paired[i].X.translation()).norm(), 1e-5) << i;
  }
}

TEST_F(Fuse, AStoredMapIsBegunWithAndTheCameraFoundInIt) {
  const auto truth = drive(24);
  write_sequence(tests::test_room(), truth);
  ASSERT_EQ(fuse({"--save-map", (root_ / "room.map").string()}), 0);
  ASSERT_EQ(fuse({"--save-map", (root_ / "again.map").string()}, "again"), 0);
  EXPECT_EQ(slurp(root_ / "room.map"), slurp(root_ / "again.map"));
  ASSERT_EQ(fuse({"--map", (root_ / "room.map").string()}, "back"), 0);
  const auto lines = claims("back");
  ASSERT_GE(lines.size(), truth.size() - 15) << "found within 15 frames";
  for (const Line& line : lines) {
    const auto i = static_cast<std::size_t>(std::lround(30 * line.t));
    const Pose expected =
        truth[0].inverse() * truth[i];  // world: the first camera of the first run
    EXPECT_LT((line.X.translation() - expected.translation()).norm(), 0.01) << "frame " << i;
  }
  EXPECT_NE(slurp(root_ / "back.txt").find("world = that of the map"), std::string::npos);
  // Bad maps: one line, and nothing is written.
  const auto refuses = [&](const std::string& word) {
    try {
      fuse({"--map", (root_ / "room.map").string(), "--save-map", (root_ / "bad.map").string()},
           "bad");
      ADD_FAILURE() << "accepted; expected " << word;
    } catch (const std::exception& e) {
      EXPECT_NE(std::string(e.what()).find("room.map"), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
    }
    for (const char* name : {"bad.txt", "bad.ply", "bad.map"})
      EXPECT_FALSE(fs::exists(root_ / name)) << name;
  };
  fs::resize_file(root_ / "room.map", fs::file_size(root_ / "room.map") - 10);
  refuses("announced");
  std::ofstream(root_ / "room.map") << "not a map";
  refuses("shorter");
  fs::remove(root_ / "room.map");
  refuses("opened");
}

// Images without a reading: nothing to be tracked, and no mesh that would look like a result.
TEST_F(Fuse, NoFrameTrackedIsSaidAndNothingWritten) {
  write_sequence(tests::test_room(), drive(3));
  for (const auto& entry : fs::directory_iterator(root_ / "seq" / "depth")) {
    const cv::Mat depth = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
    cv::imwrite(entry.path().string(), cv::Mat(depth.size(), CV_16UC1, cv::Scalar(0)));
  }
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(fuse({}), 1);
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("none of its 3 frames was tracked"), std::string::npos) << said;
  EXPECT_FALSE(fs::exists(root_ / "out.txt"));
  EXPECT_FALSE(fs::exists(root_ / "out.ply"));
}

// A first frame that is the map's origin and nothing that is found in it: no result either.
TEST_F(Fuse, NothingClaimedAfterTheFirstFrameIsSaid) {
  write_sequence(tests::test_room(), drive(4));
  std::vector<fs::path> images;
  for (const auto& entry : fs::directory_iterator(root_ / "seq" / "depth"))
    images.push_back(entry.path());
  std::sort(images.begin(), images.end());
  for (std::size_t i = 1; i < images.size(); ++i) {
    const cv::Mat depth = cv::imread(images[i].string(), cv::IMREAD_UNCHANGED);
    cv::imwrite(images[i].string(), cv::Mat(depth.size(), CV_16UC1, cv::Scalar(0)));
  }
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(fuse({}), 1);
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("of 4 frames none after the first was claimed"), std::string::npos) << said;
}

TEST_F(Fuse, BadInputLeavesNoOutputAndNamesTheCause) {
  write_sequence(tests::test_room(), drive(3));
  const auto refuses = [&](const std::vector<std::string>& extra, const std::string& word) {
    try {
      fuse(extra, "bad");
      ADD_FAILURE() << "accepted; expected a message with " << word;
    } catch (const std::exception& e) {
      EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
    }
    EXPECT_FALSE(fs::exists(root_ / "bad.txt"));
    EXPECT_FALSE(fs::exists(root_ / "bad.ply"));
  };
  refuses({"--voxel", "0.5"}, "[0.004 - 0.1]");
  refuses({"--voxel", "0"}, "[0.004 - 0.1]");
  refuses({"--iterations-fine", "0", "--iterations-middle", "0", "--iterations-coarse", "0"},
          "at least one");
  refuses({"--unknown"}, "--unknown");
  refuses({"--max-weight", "1"}, "--max-weight");
  refuses({"--max-weight", "1"}, "2..255");
  refuses({"--pixel-step", "3"}, "1, 2 or 4");
  refuses({"--mesh-weight", "nan"}, "--mesh-weight");
  refuses({"--set", "fusion.tsdf.truncation=1"}, "nearest known key");
  refuses({"--config", (root_ / "none.toml").string()}, "none.toml");
  refuses({"--odometry", (root_ / "none.txt").string()}, "none.txt");
  std::ofstream(root_ / "bad_odometry.txt") << "0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n";
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()}, "rise");
  std::ofstream(root_ / "bad_odometry.txt") << "0 0 0 0 0 0 0 2\n";
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()}, "quaternion");
  std::ofstream(root_ / "bad_odometry.txt") << "0 0 0 0 0 0 1\n";
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()}, "8");
  std::ofstream(root_ / "bad_odometry.txt") << "0 0 0 0 0 0 0 1\n0.1 0 1e300 0 0 0 0 1\n";
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()}, "bad_odometry.txt:2: ");
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()}, "1e6 m");
  std::ofstream(root_ / "bad_odometry.txt") << "50 0 0 0 0 0 0 1\n50.1 0 0 0 0 0 0 1\n";
  refuses({"--odometry", (root_ / "bad_odometry.txt").string()},
          "bad_odometry.txt: its stamps, 50.000000 to 50.100000 s, meet no frame");
  refuses({"--intrinsics", "500,500,320,240"}, "intrinsics.txt: is there");
  refuses({"--intrinsics", "500,500,320"}, "4 to 5 numbers");
  refuses({"--intrinsics", "0,500,320,240"}, "fx and fy must be");
  refuses({"--bias", (root_ / "none.toml").string()}, "none.toml");
  std::ofstream(root_ / "bias.toml")
      << "[[camera.bias]]\nat_mm = 500\n[[camera.bias]]\nat_mm = 400\n";
  refuses({"--bias", (root_ / "bias.toml").string()}, "camera.bias[1].at_mm");
  std::ofstream(root_ / "bias.toml") << "# nothing\n";
  refuses({"--bias", (root_ / "bias.toml").string()}, "has no [[camera.bias]]");
  fs::resize_file(root_ / "seq" / "depth" / "0.033333.png", 100);
  refuses({}, "0.033333.png");
  fs::remove(root_ / "seq" / "intrinsics.txt");
  refuses({}, "intrinsics.txt");
  for (const auto& entry : fs::directory_iterator(root_)) {
    EXPECT_EQ(entry.path().string().find("bad.ply"), std::string::npos) << entry.path();
  }
}

}  // namespace
