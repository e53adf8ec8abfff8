#include "tools/doctor/doctor_tree.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace teletact {

namespace doctor {

namespace fs = std::filesystem;

std::optional<std::string> Tree::text(const std::string& path) const {
  struct stat info {};
  if (stat(at(path).c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return std::nullopt;
  std::ifstream in(at(path), std::ios::binary);
  if (!in) return std::nullopt;
  std::string out(1U << 16U, '\0');
  in.read(out.data(), static_cast<std::streamsize>(out.size()));
  out.resize(static_cast<std::size_t>(in.gcount()));
  if (in.bad() || (out.empty() && !in.eof())) return std::nullopt;
  while (!out.empty() && std::isspace(static_cast<unsigned char>(out.back())) != 0) out.pop_back();
  return out;
}

std::optional<long long> Tree::number(const std::string& path) const {
  const auto t = text(path);
  if (!t) return std::nullopt;
  long long v = 0;
  const auto r = std::from_chars(t->data(), t->data() + t->size(), v);
  if (r.ec != std::errc{}) return std::nullopt;
  return v;
}

std::vector<std::string> Tree::numbered(const std::string& folder,
                                        const std::string& prefix) const {
  std::vector<std::pair<long, std::string>> found;
  std::error_code error;
  for (fs::directory_iterator it(at(folder), error), end; !error && it != end;
       it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (name.size() <= prefix.size() || name.compare(0, prefix.size(), prefix) != 0) continue;
    const std::string digits = name.substr(prefix.size());
    if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos) continue;
    found.emplace_back(std::strtol(digits.c_str(), nullptr, 10), name);
  }
  std::sort(found.begin(), found.end());
  std::vector<std::string> out;
  for (auto& f : found) out.push_back(std::move(f.second));
  return out;
}

std::vector<std::string> Tree::names(const std::string& folder) const {
  constexpr std::size_t kMost = 4096;
  std::vector<std::string> out;
  std::error_code error;
  for (fs::directory_iterator it(at(folder), error), end; !error && it != end && out.size() < kMost;
       it.increment(error))
    out.push_back(it->path().filename().string());
  std::sort(out.begin(), out.end());
  return out;
}

bool Tree::is_there(const std::string& path) const { return access(at(path).c_str(), F_OK) == 0; }

bool Tree::writable(const std::string& path) const { return access(at(path).c_str(), W_OK) == 0; }

std::string list_text(const std::vector<int>& cpus) {
  std::string out;
  for (std::size_t i = 0; i < cpus.size(); ++i) {
    std::size_t j = i;
    while (j + 1 < cpus.size() && cpus[j + 1] == cpus[j] + 1) ++j;
    if (!out.empty()) out += ',';
    out += std::to_string(cpus[i]);
    if (j > i) out.append("-").append(std::to_string(cpus[j]));
    i = j;
  }
  return out.empty() ? "none" : out;
}

std::string one_line(std::string text, std::size_t limit) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  if (text.size() > limit) text = text.substr(0, limit) + "...";
  return text;
}

std::string boot_value(const Tree& tree, const std::string& key) {
  std::istringstream words(tree.text("/proc/cmdline").value_or(""));
  std::string out;
  for (std::string w; words >> w;) {
    if (w.compare(0, key.size() + 1, key + "=") == 0) out = w.substr(key.size() + 1);
  }
  return out;
}

std::vector<int> isolated_cpus(const Tree& tree) {
  return parse_cpu_list(tree.text("/sys/devices/system/cpu/isolated").value_or(""));
}

}  // namespace doctor

std::vector<int> parse_cpu_list(const std::string& text) {
  constexpr int kMost = 4096;
  std::set<int> out;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    int lo = 0, hi = 0;
    const char *p = part.data(), *end = part.data() + part.size();
    while (p < end && std::isspace(static_cast<unsigned char>(*p)) != 0) ++p;
    auto r = std::from_chars(p, end, lo);
    if (r.ec != std::errc{} || lo < 0 || lo >= kMost) continue;
    hi = lo;
    if (r.ptr < end && *r.ptr == '-') {
      r = std::from_chars(r.ptr + 1, end, hi);
      if (r.ec != std::errc{}) continue;
    }
    for (int i = lo; i <= std::min(hi, kMost - 1); ++i) out.insert(i);
  }
  return {out.begin(), out.end()};
}

}  // namespace teletact
