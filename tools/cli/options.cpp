#include "tools/cli/options.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
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

// Why no file can be made under this name; empty: it can.
std::string refusal(const std::string& path) {
  const std::string probe = path + ".probe" + std::to_string(::getpid());
  const int fd = ::open(probe.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd < 0) return std::strerror(errno);
  ::close(fd);
  ::unlink(probe.c_str());
  return {};
}

}  // namespace

bool parse_options(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() != 0) throw std::runtime_error(e.what());
    app.exit(e);
    return false;
  }
  return true;
}

void check_outputs(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const auto& [option, path] = outputs[i];
    if (path.empty()) continue;
    const std::string head = option + " " + path + ": ";
    std::error_code ignored;
    if (const auto there = fs::status(path, ignored); fs::exists(there)) {
      if (!fs::is_regular_file(there))
        throw std::runtime_error(head + "can not be written: it is not a regular file");
    }
    if (const std::string why = refusal(path); !why.empty())
      throw std::runtime_error(head + "can not be written: " + why);
    for (std::size_t j = 0; j < i; ++j) {
      if (!outputs[j].path.empty() && name_of(outputs[j].path) == name_of(path))
        throw std::runtime_error(head + "is also the file of " + outputs[j].option);
    }
    for (const auto& input : inputs) {
      if (!input.empty() && name_of(input) == name_of(path))
        throw std::runtime_error(head + "is also read by this command: choose another file");
    }
  }
}

void make_output_folder(const std::string& option, const std::string& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  std::string why = error.message();
  if (!error) {
    why = fs::is_directory(folder, error) ? refusal(folder + "/file") : std::strerror(ENOTDIR);
    if (why.empty()) return;
  }
  throw std::runtime_error(option + " " + folder + ": can not be written: " + why);
}

void write_outputs(const std::vector<Output>& outputs) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i].path.empty()) continue;
    try {
      outputs[i].write(outputs[i].path);
    } catch (...) {
      std::error_code ignored;
      for (std::size_t j = 0; j < i; ++j) {
        if (!outputs[j].path.empty()) fs::remove(outputs[j].path, ignored);
      }
      throw;
    }
  }
}

}  // namespace teletact
