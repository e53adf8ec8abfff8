#include "tools/measure/bench/callgrind.hpp"

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

namespace {

// Every sum that callgrind wrote, in the order of its dumps.
std::vector<double> sums_of(const std::string& program, const std::vector<std::string>& arguments,
                            const std::string& options, const std::string& scratch) {
  const std::string out = scratch + "/callgrind.out", text = scratch + "/callgrind.txt";
  std::filesystem::remove(out);
  std::string command =
      "LD_BIND_NOW=1 valgrind --tool=callgrind --callgrind-out-file=" + shell_quoted(out) +
      options + " " + shell_quoted(program);
  for (const auto& a : arguments) command += " " + shell_quoted(a);
  command += " >" + shell_quoted(text) + " 2>&1";
  if (std::system(command.c_str()) != 0) {
    std::ifstream in(text);
    std::string line, last;
    while (std::getline(in, line)) last = line;
    throw std::runtime_error("callgrind of " + program + ": " + last);
  }
  std::vector<double> sums;
  std::ifstream in(out);
  for (std::string line; std::getline(in, line);) {
    const std::string head = "totals: ";
    if (line.rfind(head, 0) == 0) sums.push_back(std::strtod(line.c_str() + head.size(), nullptr));
  }
  if (sums.empty()) throw std::runtime_error("callgrind of " + program + " gave no count");
  return sums;
}

}  // namespace

double callgrind_count(const std::string& program, const std::vector<std::string>& arguments,
                       const std::string& pattern, const std::string& scratch) {
  return sums_of(program, arguments, " --toggle-collect=" + shell_quoted(pattern), scratch).front();
}

std::vector<double> callgrind_rounds(const std::string& program,
                                     const std::vector<std::string>& arguments,
                                     const std::string& pattern, const std::string& round,
                                     const std::string& scratch) {
  auto sums = sums_of(program, arguments,
                      " --combine-dumps=yes --dump-before=" + shell_quoted(round) +
                          " --toggle-collect=" + shell_quoted(pattern),
                      scratch);
  sums.erase(sums.begin());
  return sums;
}

std::vector<double> callgrind_dumps(const std::string& program,
                                    const std::vector<std::string>& arguments,
                                    const std::string& pattern, const std::string& scratch) {
  auto sums = sums_of(
      program, arguments,
      " --instr-atstart=no --combine-dumps=yes --toggle-collect=" + shell_quoted(pattern), scratch);
  sums.pop_back();  // of the program's end
  return sums;
}

}  // namespace teletact
