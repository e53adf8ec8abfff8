// The file that leads a browser to the page: for this user alone, and gone afterwards. A script
// stands in for the desktop's xdg-open.
#include <gtest/gtest.h>
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
  explicit Desktop(int status = 0) {
    fs::create_directories(folder / "bin");
    const fs::path program = folder / "bin/xdg-open";
    std::ofstream(program) << "#!/bin/sh\nprintf '%s' \"$*\" > " << (folder / "argv").string()
                           << "\ncp \"$1\" " << (folder / "shown").string() << "\nexit " << status
                           << "\n";
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

constexpr const char* kUrl = "http://127.0.0.1:4711/#code=5ec2e7";

TEST(BrowserDoor, LeadsThereForThisUserAloneAndIsRemoved) {
  const Desktop d;
  {
    teletact::BrowserDoor door;
    ASSERT_TRUE(door.open(kUrl));
    struct stat s {};
    ASSERT_EQ(::stat(d.door().c_str(), &s), 0);
    EXPECT_EQ(s.st_mode & 0777U, 0600U);
    EXPECT_NE(d.read("shown").find(kUrl), std::string::npos);
    EXPECT_EQ(d.read("argv"), d.door().string()) << "no address among the arguments";
    door.remove();
    EXPECT_FALSE(fs::exists(d.door()));
    ASSERT_TRUE(door.open(kUrl));
    EXPECT_TRUE(fs::exists(d.door()));
  }
  EXPECT_FALSE(fs::exists(d.door())) << "the run has ended";
}

TEST(BrowserDoor, IsRemovedWhereTheBrowserDoesNotStart) {
  const Desktop d(3);
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
