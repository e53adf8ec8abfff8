#include "tools/teletact/measure.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace teletact {

int start_measure(int argc, char** argv) {
  constexpr const char* kName = "teletact-measure";
  std::error_code failed;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", failed).parent_path();
  const auto beside = own / kName,
             installed = (own / "../libexec/teletact").lexically_normal() / kName;
  std::vector<char*> words{const_cast<char*>(kName)};
  words.insert(words.end(), argv, argv + argc);
  words.push_back(nullptr);
  for (const auto& path : {beside, installed}) {
    if (access(path.c_str(), F_OK) != 0) continue;
    execv(path.c_str(), words.data());
    throw std::runtime_error(path.string() + " can not be started: " + std::strerror(errno));
  }
  throw std::runtime_error(std::string(kName) + " is neither at " + beside.string() + " nor at " +
                           installed.string() + ": it is built beside the tests (tools/test) and " +
                           "by `tools/run --build-only`");
}

}  // namespace teletact
