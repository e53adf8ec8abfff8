#include "tools/host/run_folder.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "rt/audit/black_box.hpp"
#include "rt/store/store_files.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/host/run_options.hpp"

namespace teletact {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view kMarkText =
    "Files of a run of teletact demo. The next run with this --report replaces them.\n"
    "It refuses to when anything else is in this folder.\n";

// Behind "operator" or "robot".
constexpr std::array<std::string_view, 10> kOfABox{".log",      ".1.log",    ".2.log",   ".run",
                                                   ".view",     ".view.tmp", ".effects", ".inputs",
                                                   ".blackbox", ".stop"};
// Names that others could choose as well.
constexpr std::array<std::string_view, 11> kOfARun{
    "scene.toml", "faults.toml",  "scene.ply", "console.log", "console.json",  "link.cut",
    "notes",      "not_realtime", "pids",      "robot.port",  "robot.port.tmp"};

constexpr std::string_view kBefore = "before-";

bool cut_head(std::string_view& text, std::string_view head) {
  if (text.substr(0, head.size()) != head) return false;
  text.remove_prefix(head.size());
  return true;
}

bool all_digits(std::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789") == std::string_view::npos;
}

template <class Names>
bool one_of(const Names& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

bool of_a_box(std::string_view name) {
  if (!cut_head(name, "operator") && !cut_head(name, "robot")) return false;
  if (one_of(kOfABox, name)) return true;
  if (!cut_head(name, ".stop")) return false;  // the copy of a stop: .stop<n>.blackbox
  const auto dot = name.find('.');
  return dot != std::string_view::npos && all_digits(name.substr(0, dot)) &&
         name.substr(dot) == ".blackbox";
}

bool is_black_box_name(std::string_view name) {
  return of_a_box(name) && name.ends_with(".blackbox");
}

// Number of before-<n>; 0: it is none.
std::uint64_t number_of(std::string_view name) {
  if (!cut_head(name, kBefore) || !all_digits(name) || name.size() > 18) return 0;
  return std::stoull(std::string(name));
}

// What an earlier run's stops left: black boxes and the logs beside them, nothing else.
bool is_kept_folder(const fs::directory_entry& entry) {
  if (number_of(entry.path().filename().string()) == 0 || !fs::is_directory(entry.symlink_status()))
    return false;
  return std::all_of(
      fs::directory_iterator(entry.path()), fs::directory_iterator(),
      [](const fs::directory_entry& e) {
        const std::string name = e.path().filename();
        return fs::is_regular_file(e.symlink_status()) &&
               (is_black_box_name(name) || (of_a_box(name) && name.ends_with(".log")));
      });
}

bool of_a_run(std::string_view name) {
  // What a run that was killed while it wrote its mesh left beside it.
  return one_of(kOfARun, name) || (cut_head(name, "scene.ply.tmp") && all_digits(name));
}

// The job records of a box: a folder, with a store's files alone.
bool is_run_store(const fs::directory_entry& entry) {
  if (entry.path().extension() != ".run" || !fs::is_directory(entry.symlink_status())) return false;
  return std::all_of(fs::directory_iterator(entry.path()), fs::directory_iterator(),
                     [](const fs::directory_entry& e) {
                       return fs::is_regular_file(e.symlink_status()) &&
                              rt::is_store_file(e.path().filename().string());
                     });
}

// Names of all that is in the folder but for what is kept of earlier runs. Throws unless all of it
// is a run's.
std::vector<std::string> files_of_a_run(const std::string& folder) {
  std::vector<std::string> names;
  std::string foreign;
  bool is_runs = false;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    if (is_kept_folder(entry)) continue;
    const bool known = name == kRunFolderMark || of_a_box(name) || of_a_run(name);
    // Another folder or a link under a known name is nothing that a run makes.
    if (!known || !(fs::is_regular_file(entry.symlink_status()) || is_run_store(entry)))
      foreign = foreign.empty() ? name : std::min(foreign, name);
    is_runs = is_runs || name == kRunFolderMark || of_a_box(name);
    names.push_back(name);
  }
  if (foreign.empty() && !is_runs && !names.empty())
    foreign = *std::min_element(names.begin(), names.end());
  if (!foreign.empty())
    throw std::runtime_error("--report: " + folder + " holds " + foreign +
                             ", which no run wrote: take it away, or choose another folder");
  return names;
}

// Not of an end that was asked for, with no stop but its own ramp down.
bool is_evidence(const std::string& path) {
  const auto box = rt::read_black_box(path);
  return !box || !box.value().stop.starts_with(kAskedToEnd) ||
         box.value().stop.find("safe stop") != std::string::npos;
}

// The black boxes of the last run's stops, and its logs, go to before-<n>, the newest with the
// highest number.
void keep_black_boxes(const std::string& folder, const std::vector<std::string>& names) {
  if (std::none_of(names.begin(), names.end(), [&](const std::string& name) {
        return is_black_box_name(name) && is_evidence(folder + "/" + name);
      }))
    return;
  std::vector<std::uint64_t> kept;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (const auto n = number_of(entry.path().filename().string()); n > 0) kept.push_back(n);
  }
  std::sort(kept.begin(), kept.end());
  const auto place = [&](std::uint64_t n) {
    return folder + "/" + std::string(kBefore) + std::to_string(n);
  };
  const std::string into = place(kept.empty() ? 1 : kept.back() + 1);
  fs::create_directory(into);
  for (const auto& name : names) {
    if (is_black_box_name(name) || name == "operator.log" || name == "robot.log")
      fs::rename(folder + "/" + name, into + "/" + name);
  }
  // In a crash loop the first one tells the cause: it stays beside the newest.
  for (std::size_t i = 1; i + kKeptRuns <= kept.size() + 1; ++i) fs::remove_all(place(kept[i]));
}

}  // namespace

void make_run_folder(const std::string& report) {
  const std::string folder = report + "/raw";
  make_output_folder("--report", folder);
  (void)files_of_a_run(folder);
  // One that is there stays: a full disk would refuse it, before the last run's files make room.
  const std::string mark = folder + "/" + kRunFolderMark;
  if (!fs::exists(mark)) write_whole_file(mark, std::string(kMarkText));
}

void clear_run_folder(const std::string& folder) {
  const std::vector<std::string> names = files_of_a_run(folder);
  keep_black_boxes(folder, names);
  for (const auto& name : names) {
    if (name != kRunFolderMark) fs::remove_all(folder + "/" + name);
  }
}

}  // namespace teletact
