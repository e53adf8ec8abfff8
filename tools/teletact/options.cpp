#include "tools/teletact/options.hpp"

#include <unistd.h>

#include <filesystem>
#include <stdexcept>

namespace teletact {

namespace fs = std::filesystem;

namespace {

// The same file has one such name, whether it is there or not.
std::string name_of(const std::string& path) {
  std::error_code ignored;
  const fs::path name = fs::weakly_canonical(fs::absolute(path), ignored);
  return name.empty() ? path : name.string();
}

}  // namespace

void check_outputs(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const auto& [option, path] = outputs[i];
    if (path.empty()) continue;
    const std::string head = option + " " + path + ": ";
    fs::path folder = fs::path(path).parent_path();
    if (folder.empty()) folder = ".";
    if (fs::is_directory(path) || access(folder.c_str(), W_OK) != 0)
      throw std::runtime_error(head + "can not be written");
    for (std::size_t j = 0; j < i; ++j) {
      if (!outputs[j].path.empty() && name_of(outputs[j].path) == name_of(path))
        throw std::runtime_error(head + "is also the file of " + outputs[j].option);
    }
    for (const auto& input : inputs) {
      if (!input.empty() && name_of(input) == name_of(path))
        throw std::runtime_error(head + "is also read");
    }
  }
}

}  // namespace teletact
