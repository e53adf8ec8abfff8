#include "tools/bench/callgrind.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace teletact {

std::string own_folder() {
  std::error_code ec;
  return std::filesystem::read_symlink("/proc/self/exe", ec).parent_path().string();
}

bool have_valgrind() { return std::system("valgrind --version >/dev/null 2>&1") == 0; }

std::string shell_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

double callgrind_count(const std::string& program, const std::vector<std::string>& arguments,
                       const std::string& pattern, const std::string& scratch) {
  const std::string out = scratch + "/callgrind.out", text = scratch + "/callgrind.txt";
  std::string command =
      "LD_BIND_NOW=1 valgrind --tool=callgrind --callgrind-out-file=" + shell_quoted(out) +
      " --toggle-collect=" + shell_quoted(pattern) + " " + shell_quoted(program);
  for (const auto& a : arguments) command += " " + shell_quoted(a);
  command += " >" + shell_quoted(text) + " 2>&1";
  if (std::system(command.c_str()) != 0) {
    std::ifstream in(text);
    std::string line, last;
    while (std::getline(in, line)) last = line;
    throw std::runtime_error("callgrind of " + program + ": " + last);
  }
  std::ifstream in(out);
  for (std::string line; std::getline(in, line);) {
    for (const std::string head : {"totals: ", "summary: "}) {
      if (line.rfind(head, 0) == 0) return std::strtod(line.c_str() + head.size(), nullptr);
    }
  }
  throw std::runtime_error("callgrind of " + program + " gave no count");
}

}  // namespace teletact
