// The disk of both boxes fills up while they drive, and their files may not grow any more: nothing
// of it reaches a task. Both stay engaged, each says once which file was refused, and ends in an
// orderly way with an exit code that says so.
#include <sys/mount.h>
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "tests/fault/two_boxes/boxes.hpp"
#include "tools/box/box_main.hpp"
#include "tools/host/run_folder.hpp"

namespace {

using namespace two_boxes;

constexpr double kGoesOn_s = 4;

// A file system in memory of its own; needs root.
class SmallDisk {
 public:
  explicit SmallDisk(std::string path) : path_(std::move(path)) {
    fs::create_directories(path_);
    if (::mount("tmpfs", path_.c_str(), "tmpfs", 0, "size=256m") == 0) return;
    refusal_ = std::strerror(errno);
  }
  ~SmallDisk() {
    if (refusal_.empty()) ::umount2(path_.c_str(), MNT_DETACH);
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  void fill() const {
    std::ofstream out(path_ / "filler", std::ios::binary);
    const std::string part(std::size_t{1} << 20U, 'x');
    while (out.write(part.data(), static_cast<std::streamsize>(part.size())).flush()) {
    }
    std::ofstream rest(path_ / "rest", std::ios::binary);
    while (rest.write(part.data(), 4096).flush()) {
    }
  }
  [[nodiscard]] const fs::path& path() const noexcept { return path_; }
  [[nodiscard]] const std::string& refusal() const noexcept { return refusal_; }

 private:
  fs::path path_;
  std::string refusal_;
};

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (auto at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

std::string refused(const fs::path& report, const std::string& box, const char* kind) {
  return "the disk refuses " + (report / "raw" / (box + kind)).string();
}

struct Told {
  bool lost = false;  // the engagement, once the disk refuses
};

// Both drive on from now on, until both have told and kGoesOn_s have passed.
bool drive_on(Boxes& b, const fs::path& robot_report, const fs::path& op_report, Told& told) {
  double since = -1;
  return b.until([&](const Json& r, const Json& o) {
    if (!r.is_object() || !o.is_object()) return false;
    told.lost = told.lost || !engaged(r) || !engaged(o);
    if (told.lost) return true;
    const std::string robot = b.robot.output(), op = b.op.output();
    for (const char* kind : {".run", ".view"}) {
      if (count(robot, refused(robot_report, "robot", kind)) == 0) return false;
      if (count(op, refused(op_report, "operator", kind)) == 0) return false;
    }
    if (since < 0) since = r["up_s"];
    return static_cast<double>(r["up_s"]) > since + kGoesOn_s;
  });
}

void end_orderly(BoxProgram& box, const std::string& name, const fs::path& report) {
  EXPECT_EQ(box.stop(), teletact::kFileRefused) << box.output();
  const std::string said = box.output();
  for (const char* kind : {".run", ".view"})
    EXPECT_EQ(count(said, refused(report, name, kind)), 1U) << said;
  EXPECT_LE(count(said, refused(report, name, ".log")), 1U) << "few lines: it may have had room";
  EXPECT_EQ(count(said, "LOG ERROR"), 0U) << "the library's own words\n" << said;
  EXPECT_EQ(count(said, "terminate called"), 0U) << said;
}

// `refuse`: from then on the disk takes nothing more of what grows.
Ending story(Boxes& b, const fs::path& reports, const std::function<void()>& refuse) {
  const fs::path robot = reports / "robot", op = reports / "operator";
  b.robot.report_to(robot);
  b.op.report_to(op);
  b.robot.start();
  b.op.start();
  if (!b.until([](const Json& r, const Json& o) { return engaged(r) && engaged(o); }))
    return b.ending;
  refuse();
  Told told;
  if (!drive_on(b, robot, op, told)) return b.ending;
  if (told.lost) return Ending::kDisturbed;
  end_orderly(b.op, "operator", op);
  if (!b.until([](const Json& r, const Json&) { return waits(r); })) return b.ending;
  end_orderly(b.robot, "robot", robot);
  return Ending::kGood;
}

void tell(const std::function<Ending(int n)>& one) {
  for (int n = 1; n <= kTries; ++n) {
    const Ending ending = one(n);
    if (testing::Test::HasFailure()) return;
    if (ending == Ending::kNoRoom) GTEST_SKIP() << "the cores are taken";
    if (ending == Ending::kGood) return;
    std::printf("try %d: the engagement was lost or the tasks were disturbed\n", n);
  }
  GTEST_SKIP() << "not judged: disturbed in each of " << kTries << " tries";
}

TEST(FullDisk, AFullDiskOfEitherBoxIsToldAndNothingElse) {
  const std::string place =
      (fs::temp_directory_path() / ("teletact-disk-" + std::to_string(::getpid()))).string();
  if (const SmallDisk probe(place); !probe.refusal().empty())
    GTEST_SKIP() << "no small disk can be mounted here: " << probe.refusal();
  tell([&](int n) {
    const SmallDisk disk(place);
    Boxes b("full" + std::to_string(n), false);
    return story(b, disk.path(), [&] { disk.fill(); });
  });
}

// Killed, the disk full, started again, as a service does it: with what the last run left to make
// room, and without.
TEST(FullDisk, ABoxStartsAgainOnAFullDisk) {
  const std::string place =
      (fs::temp_directory_path() / ("teletact-disk-" + std::to_string(::getpid()))).string();
  if (const SmallDisk probe(place); !probe.refusal().empty())
    GTEST_SKIP() << "no small disk can be mounted here: " << probe.refusal();
  for (const bool leaves : {true, false}) {
    SCOPED_TRACE(leaves ? "with the last run's files" : "with its mark alone");
    tell([&](int n) {
      const SmallDisk disk(place);
      Boxes b("again" + std::to_string(n), false);
      const fs::path raw = disk.path() / "robot" / "raw";
      const auto up = [](const Json& r, const Json&) { return waits(r); };
      b.robot.report_to(disk.path() / "robot");
      b.robot.start();
      if (!b.until(up)) return b.ending;
      b.robot.kill_it();
      if (!leaves) {
        for (const auto& file : fs::directory_iterator(raw)) {
          if (file.path().filename() != teletact::kRunFolderMark) fs::remove_all(file.path());
        }
      }
      disk.fill();
      b.robot.start();
      if (!b.until([&](const Json& r, const Json& o) { return up(r, o) || b.robot.ended(); }))
        return b.ending;
      EXPECT_FALSE(b.robot.ended()) << b.robot.output();
      if (testing::Test::HasFailure()) return Ending::kGood;
      const int code = b.robot.stop();
      if (leaves) return Ending::kGood;
      EXPECT_EQ(code, teletact::kFileRefused) << b.robot.output();
      EXPECT_EQ(count(b.robot.output(), refused(disk.path() / "robot", "robot", ".blackbox")), 1U)
          << b.robot.output();
      return Ending::kGood;
    });
  }
}

TEST(FullDisk, AFileThatMayNotGrowIsToldAndNothingElse) {
  tell([](int n) {
    Boxes b("limit" + std::to_string(n), false);
    return story(b, b.folder, [&] {
      // More than the boxes say; less than ten seconds of records and samples.
      const rlimit limit{60000, RLIM_INFINITY};
      for (const pid_t pid : {b.robot.pid(), b.op.pid()})
        EXPECT_EQ(::prlimit(pid, RLIMIT_FSIZE, &limit, nullptr), 0) << std::strerror(errno);
    });
  });
}

}  // namespace
