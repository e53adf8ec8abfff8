#include "tools/files/metrics_json.hpp"

#include <sys/utsname.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tools/files/whole_file.hpp"
#if __has_include("tools/files/build_info.hpp")
#include "tools/files/build_info.hpp"
#else
namespace teletact {
inline constexpr const char* kVersion = "unversioned";
}
#endif

namespace teletact {

namespace {

std::string cpu_model() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    const auto colon = line.find(": ");
    if (colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown CPU";
}

std::string host_text() {
  utsname u{};
  uname(&u);
  return std::string(u.nodename) + ", " + cpu_model() + " x " +
         std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) + ", " + u.sysname + " " + u.release;
}

}  // namespace

void Metrics::add(std::string name, double value, std::string unit) {
  rows_.push_back({std::move(name), "", std::move(unit), value, false});
}

void Metrics::add(std::string name, std::string value, std::string unit) {
  rows_.push_back({std::move(name), std::move(value), std::move(unit), 0, true});
}

std::string Metrics::json() const {
  nlohmann::ordered_json out;
  out["command"] = command_;
  out["version"] = kVersion;
  out["host"] = host_text();
  out["metrics"] = nlohmann::ordered_json::array();
  for (const Row& row : rows_) {
    nlohmann::ordered_json item;
    item["name"] = row.name;
    // What was not measured is null: JSON has no NaN, and 0 would be a lie.
    if (row.is_text) {
      item["value"] = row.text;
    } else if (std::isfinite(row.value)) {
      item["value"] = row.value;
    } else {
      item["value"] = nullptr;
    }
    item["unit"] = row.unit;
    out["metrics"].push_back(std::move(item));
  }
  // Text that is not UTF-8 (a file name, say) must not make a run fail at its end.
  return out.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

void Metrics::write(const std::string& path) const { write_whole_file(path, json()); }

}  // namespace teletact
