// The product's own program beside the bench: `teletact demo` with a page, and the scripts of the
// page's tests in a browser. Each writes into a file; what still runs ends with the object.
#pragma once

#include <sys/types.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/host/run_results.hpp"

namespace teletact {

// A folder for temporary files, removed with the object.
class BenchFolder {
 public:
  BenchFolder();
  ~BenchFolder();
  BenchFolder(const BenchFolder&) = delete;
  BenchFolder& operator=(const BenchFolder&) = delete;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

class ChildProgram {
 public:
  // What it says goes to the file `output`. `feed`: a pipe stands at its stdin until end_input().
  ChildProgram(const std::vector<std::string>& words, std::string output, bool feed = false);
  ~ChildProgram();
  ChildProgram(const ChildProgram&) = delete;
  ChildProgram& operator=(const ChildProgram&) = delete;

  void end_input();
  void ask_to_end() const;
  // Its exit code; -1: it runs on.
  [[nodiscard]] int wait_for(double seconds);
  [[nodiscard]] bool runs() { return wait_for(0) < 0; }
  [[nodiscard]] std::string said() const;
  [[nodiscard]] std::string last_line() const;

 private:
  std::string output_;
  pid_t pid_ = -1;
  int input_ = -1, code_ = -1;
};

// Both boxes on this machine's real clock with a page that this process or a browser opens.
class PagedDemo {
 public:
  // `words`: of `teletact demo`, beside those for the page and the clock. Throws std::runtime_error
  // with one line where it does not come up.
  PagedDemo(const std::string& folder, std::vector<std::string> words);
  [[nodiscard]] const std::string& url() const noexcept { return url_; }
  // Ends it and reads what it has left.
  void end();

  // After end(). Why its times count for nothing; empty: they count.
  std::string problem;
  OperatorHalf op;
  RobotHalf robot;
  nlohmann::json figures;  // console.* of raw/console.json; null: none

 private:
  std::string folder_, url_;
  ChildProgram child_;
};

// The built script of the page's tests; empty where it was not built.
[[nodiscard]] std::string page_script();
// Runs it to its end; throws std::runtime_error with its last line. The JSON of the last line it
// said.
[[nodiscard]] nlohmann::json run_page_script(const std::vector<std::string>& words,
                                             const std::string& folder, double most_s);
// Why there is no browser to measure with; empty: there is.
[[nodiscard]] std::string no_browser();

}  // namespace teletact
