// What of touch and its device the program does not pretend to have: one line, exit code 2, no
// file.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>

#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;

// Exit code, and what it said on stderr.
std::pair<int, std::string> errors_of(const std::string& words) {
  const std::string command =
      "timeout 60 " + tests::in_build("teletact") + " " + words + " 2>&1 >/dev/null";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

struct Folder {
  fs::path path = fs::temp_directory_path() / ("teletact_refusals_" + std::to_string(::getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  [[nodiscard]] std::string file(const char* name) const { return (path / name).string(); }
};

TEST(TouchRefusals, AMethodThatThereIsNot) {
  const Folder in;
  const auto [code, text] = errors_of("demo --clock virtual --bodies stub --seconds 1 --report " +
                                      in.file("r") + " --set 'haptic.method=\"paper\"'");
  EXPECT_EQ(code, 2);
  EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
  EXPECT_NE(text.find("haptic.method"), std::string::npos) << text;
  EXPECT_NE(text.find("\"constrained\", \"nearest\", \"nearest10\", \"force_shading\""),
            std::string::npos)
      << text;
  EXPECT_TRUE(fs::is_empty(in.path));
}

// A host that has no room for the ray cast is told what it costs.
TEST(TouchRefusals, AMethodThatTheHostHasNoRoomFor) {
  const Folder in;
  const auto [code, text] =
      errors_of("demo --clock virtual --bodies stub --seconds 1 --cores 1 --report " +
                in.file("r") + " --set 'haptic.method=\"force_shading\"'");
  EXPECT_EQ(code, 2);
  EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
  EXPECT_NE(text.find("haptic.method = \"force_shading\" adds "), std::string::npos) << text;
}

// What does not fit the model is told of after its table, and not handed on as measured.
TEST(TouchRefusals, IdentifyWhereTheModelDoesNotHold) {
  const Folder in;
  const std::string out = " --out " + in.file("d.toml") + " --json " + in.file("d.json");
  const std::string poor = "identify --set device.mass_kg=0.1 --set device.damping_N_s_per_m=0.3";
  const auto [code, text] = errors_of(poor + out);
  EXPECT_EQ(code, 2);
  EXPECT_EQ(text.find("teletact identify: residual "), 0U) << text;
  EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
  EXPECT_NE(text.find(" um along x, allowed up to 20: "), std::string::npos) << text;
  EXPECT_TRUE(fs::is_empty(in.path));
  EXPECT_EQ(errors_of("identify" + out).first, 0);
  EXPECT_TRUE(fs::exists(in.file("d.toml")) && fs::exists(in.file("d.json")));
  EXPECT_EQ(errors_of(poor + " --residual 100" + out).first, 0);
}

}  // namespace
