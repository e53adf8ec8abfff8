#include "tools/teletact/measure.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace teletact {

namespace {

constexpr const char* kName = "teletact-measure";

// In a build folder, which tools/run leaves without the measuring programs. What the build prints
// goes to stderr: stdout is for figures.
void build_in(const std::string& folder) {
  std::fprintf(stderr,
               "%s is not built yet; this takes some minutes, once: cmake --build %s --target "
               "teletact_measure_program\n",
               kName, folder.c_str());
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(2, 1);
    ::execlp("cmake", "cmake", "--build", folder.c_str(), "--target", "teletact_measure_program",
             static_cast<char*>(nullptr));
    ::_exit(127);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child || !WIFEXITED(status) ||
      WEXITSTATUS(status) != 0)
    throw std::runtime_error(std::string(kName) + " could not be built in " + folder +
                             ": the lines above say why");
}

}  // namespace

int start_measure(int argc, char** argv) {
  std::error_code failed;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", failed).parent_path();
  const auto beside = own / kName,
             installed = (own / "../libexec/teletact").lexically_normal() / kName;
  std::vector<char*> words{const_cast<char*>(kName)};
  words.insert(words.end(), argv, argv + argc);
  words.push_back(nullptr);
  if (access(beside.c_str(), F_OK) != 0 && access((own / "CMakeCache.txt").c_str(), F_OK) == 0)
    build_in(own.string());
  for (const auto& path : {beside, installed}) {
    if (access(path.c_str(), F_OK) != 0) continue;
    execv(path.c_str(), words.data());
    throw std::runtime_error(path.string() + " can not be started: " + std::strerror(errno));
  }
  throw std::runtime_error(std::string(kName) + " is neither at " + beside.string() + " nor at " +
                           installed.string() +
                           ": the component `program` of the build installs it");
}

}  // namespace teletact
