// Checks of a command line, before anything is done.
#pragma once

#include <CLI/CLI.hpp>
#include <cmath>
#include <functional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace teletact {

// Numbers from lo to hi; what is not finite is in no range (CLI::Range lets NaN pass).
inline CLI::Validator in_range(double lo, double hi) {
  std::ostringstream range;
  range << "FLOAT in [" << lo << " - " << hi << "]";
  const std::string allowed = range.str();
  return CLI::Validator(
      [lo, hi, allowed](std::string& text) {
        double v = 0;
        if (CLI::detail::lexical_cast(text, v) && v >= lo && v <= hi) return std::string();
        return "Value " + text + " not in " + allowed;
      },
      allowed);
}

// False: help was asked for and printed. Throws std::runtime_error with one line that says what is
// wrong.
[[nodiscard]] bool parse_options(CLI::App& app, int argc, char** argv);

struct OutputFile {
  std::string option, path;  // an empty path: not asked for
};

// Throws std::runtime_error naming the option and the file if one can not be written (tried beside
// its place; nothing is left there), is also another output, or is one of the files that are read.
void check_outputs(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs);

// Makes the folder and tries to write in it. Throws std::runtime_error naming the option and the
// folder.
void make_output_folder(const std::string& option, const std::string& folder);

struct Output {
  std::string path;  // an empty path: not asked for
  std::function<void(const std::string& path)> write;
};
// In this order; if one can not be written, those before it are removed again.
void write_outputs(const std::vector<Output>& outputs);

}  // namespace teletact
