// The file that leads a browser to the page: for this user alone, and gone afterwards. A script
// stands in for the desktop's xdg-open.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tools/desk/browser_door.hpp"

namespace {

namespace fs = std::filesystem;

struct Desktop {
  fs::path folder = fs::temp_directory_path() / ("teletact_door_" + std::to_string(::getpid()));
  explicit Desktop(int status = 0, const std::string& before = "") {
    fs::create_directories(folder / "bin");
    const fs::path program = folder / "bin/xdg-open";
    std::ofstream(program) << "#!/bin/sh\nprintf '%s' \"$*\" > " << (folder / "argv").string()
                           << "\ncp \"$1\" " << (folder / "shown").string() << "\n"
                           << before << "exit " << status << "\n";
    fs::permissions(program, fs::perms::owner_all);
    ::setenv("PATH", ((folder / "bin").string() + ":/usr/bin:/bin").c_str(), 1);
    ::setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
    ::setenv("DISPLAY", ":99", 1);
  }
  ~Desktop() { fs::remove_all(folder); }
  [[nodiscard]] fs::path door() const { return folder / "teletact-console.html"; }
  [[nodiscard]] std::string read(const char* name) const {
    std::ifstream in(folder / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }
};

using Asked = teletact::BrowserDoor::Asked;

// How the program that was asked has ended.
Asked end_of(teletact::BrowserDoor& door) {
  Asked asked = Asked::kRuns;
  for (int i = 0; i < 8000 && asked == Asked::kRuns; ++i) {
    ::usleep(5000);
    asked = door.look();
  }
  return asked;
}

constexpr const char* kUrl = "http://127.0.0.1:4711/#code=5ec2e7";

TEST(BrowserDoor, LeadsThereForThisUserAloneAndIsRemoved) {
  const Desktop d;
  {
    teletact::BrowserDoor door;
    EXPECT_EQ(door.look(), Asked::kNobody);
    ASSERT_TRUE(door.open(kUrl));
    EXPECT_EQ(end_of(door), Asked::kShown);
    struct stat s {};
    ASSERT_EQ(::stat(d.door().c_str(), &s), 0);
    EXPECT_EQ(s.st_mode & 0777U, 0600U);
    EXPECT_NE(d.read("shown").find(kUrl), std::string::npos);
    EXPECT_EQ(d.read("argv"), d.door().string()) << "no address among the arguments";
    door.remove();
    EXPECT_FALSE(fs::exists(d.door()));
    ASSERT_TRUE(door.open(kUrl));
    EXPECT_EQ(end_of(door), Asked::kShown);
    EXPECT_TRUE(fs::exists(d.door()));
  }
  EXPECT_FALSE(fs::exists(d.door())) << "the run has ended";
}

TEST(BrowserDoor, IsRemovedWhereTheBrowserDoesNotStart) {
  const Desktop d(3);
  teletact::BrowserDoor door;
  ASSERT_TRUE(door.open(kUrl));
  EXPECT_EQ(end_of(door), Asked::kFailed);
  EXPECT_EQ(door.look(), Asked::kNobody);
  EXPECT_FALSE(fs::exists(d.door()));
}

// On Debian without a desktop the program is the browser itself: the run goes on meanwhile.
TEST(BrowserDoor, DoesNotWaitForABrowserThatGoesOn) {
  const Desktop d(
      0, "while [ -e \"$1\" ] && [ ! -e \"$XDG_RUNTIME_DIR/closed\" ]; do sleep 0.02; done\n");
  teletact::BrowserDoor door;
  ASSERT_TRUE(door.open(kUrl)) << "and comes back, or this test ends by its time";
  for (int i = 0; i < 8000 && !fs::exists(d.folder / "shown"); ++i) ::usleep(5000);
  EXPECT_EQ(door.look(), Asked::kRuns);
  std::ofstream(d.folder / "closed") << "x";
  EXPECT_EQ(end_of(door), Asked::kShown);
}

// A browser that outlives a killed box would else keep the port of its page, and its files.
TEST(BrowserDoor, TheBrowserHoldsNoDescriptorOfThisProgram) {
  const Desktop d(0, "ls -l /proc/self/fd > \"$XDG_RUNTIME_DIR/held\"\n");
  const std::string path = (d.folder / "a file of the box").string();
  // Without O_CLOEXEC: libraries open theirs so too.
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT, 0600);
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_GT(file, 2);
  ASSERT_GT(socket, 2);
  const std::string named = fs::read_symlink("/proc/self/fd/" + std::to_string(socket));
  ASSERT_EQ(named.rfind("socket:[", 0), 0U) << named;
  teletact::BrowserDoor door;
  ASSERT_TRUE(door.open(kUrl));
  EXPECT_EQ(end_of(door), Asked::kShown);
  ::close(file);
  ::close(socket);
  const std::string held = d.read("held");
  EXPECT_NE(held.find("1 -> "), std::string::npos) << "the list is one\n" << held;
  EXPECT_EQ(held.find("a file of the box"), std::string::npos) << held;
  EXPECT_EQ(held.find(named), std::string::npos) << held;
}

TEST(BrowserDoor, WithNothingToAskThereIsNone) {
  const Desktop d;
  fs::remove(d.folder / "bin/xdg-open");
  ::setenv("PATH", (d.folder / "bin").c_str(), 1);
  teletact::BrowserDoor door;
  EXPECT_FALSE(door.open(kUrl));
  EXPECT_FALSE(fs::exists(d.door()));
}

TEST(BrowserDoor, WithoutADesktopThereIsNone) {
  const Desktop d;
  ::unsetenv("DISPLAY");
  ::unsetenv("WAYLAND_DISPLAY");
  teletact::BrowserDoor door;
  EXPECT_FALSE(door.open(kUrl));
  EXPECT_FALSE(fs::exists(d.door()));
}

}  // namespace
