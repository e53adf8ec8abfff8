#include "drivers/camera/sequence_layout.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "drivers/camera/recording/tum_files.hpp"

namespace drivers {
namespace {

// Stamp at the place of the line, above the one before.
rt::Result<double> rising_stamp(const std::string& list, int n, const std::string& name,
                                const std::string& token, const double* before) {
  auto t = parse_number(list, n, name, token);
  if (!t) return t;
  if (std::abs(t.value()) > 4e9) {
    return file_error(list, n, name + " " + token + " is outside -4e9 ... 4e9 s");
  }
  if (before != nullptr && t.value() <= *before) {
    return file_error(list, n,
                      name + " " + token + " does not rise above " + std::to_string(*before));
  }
  return t;
}

rt::Result<SequenceLayout> read_associations(const std::string& folder, bool with_colour) {
  SequenceLayout out;
  const std::string list = folder + "/associations.txt";
  const auto ok = for_each_line(list, [&](int n, const Tokens& t) -> rt::Result<bool> {
    if (t.size() != 4) {
      return file_error(list, n,
                        "wanted 't_colour colour_file t_depth depth_file', found " +
                            std::to_string(t.size()) + " words");
    }
    const auto colour_s = parse_number(list, n, "colour stamp", t[0]);
    if (!colour_s) return rt::Error{colour_s.error()};
    const auto depth_s = rising_stamp(list, n, "depth stamp", t[2],
                                      out.images.empty() ? nullptr : &out.images.back().depth_s);
    if (!depth_s) return rt::Error{depth_s.error()};
    RecordedImage e{depth_s.value(), t[2], folder + "/" + t[3], folder + "/" + t[1]};
    for (const std::string& file : {e.depth_file, with_colour ? e.colour_file : e.depth_file}) {
      if (!regular_file(file)) return file_error(list, n, "no such file: '" + file + "'");
    }
    out.images.push_back(std::move(e));
    return true;
  });
  if (!ok) return rt::Error{ok.error()};
  if (out.images.empty()) return file_error(list, 0, "lists no frame");
  return out;
}

struct Listed {
  double t_s = 0;
  std::string stamp, file;
};

rt::Result<std::vector<Listed>> read_list(const std::string& folder, const std::string& name) {
  std::vector<Listed> out;
  const std::string list = folder + "/" + name;
  const auto ok = for_each_line(list, [&](int n, const Tokens& t) -> rt::Result<bool> {
    if (t.size() != 2) {
      return file_error(list, n, "wanted 't file', found " + std::to_string(t.size()) + " words");
    }
    const auto t_s = rising_stamp(list, n, "stamp", t[0], out.empty() ? nullptr : &out.back().t_s);
    if (!t_s) return rt::Error{t_s.error()};
    const std::string file = folder + "/" + t[1];
    if (!regular_file(file)) return file_error(list, n, "no such file: '" + file + "'");
    out.push_back({t_s.value(), t[0], file});
    return true;
  });
  if (!ok) return rt::Error{ok.error()};
  if (out.empty()) return file_error(list, 0, "lists no image");
  return out;
}

rt::Result<SequenceLayout> pair_lists(const std::string& folder, bool with_colour) {
  SequenceLayout out;
  out.kind = SequenceLayout::Kind::kLists;
  auto depth = read_list(folder, "depth.txt");
  if (!depth) return rt::Error{depth.error()};
  rt::Result<std::vector<Listed>> colour = std::vector<Listed>{};
  if (with_colour) colour = read_list(folder, "rgb.txt");
  if (!colour) return rt::Error{colour.error()};
  std::size_t c = 0;  // the nearest one: both lists rise
  const auto& colours = colour.value();
  for (const Listed& d : depth.value()) {
    const auto off = [&](std::size_t i) { return std::abs(colours[i].t_s - d.t_s); };
    while (c + 1 < colours.size() && off(c + 1) <= off(c)) ++c;
    // Stamps have microseconds: what is written 20 ms apart counts.
    if (with_colour && off(c) > kPairGap_s + 1e-6) {
      ++out.left_out;
      continue;
    }
    out.images.push_back({d.t_s, d.stamp, d.file, with_colour ? colours[c].file : std::string()});
  }
  if (out.images.empty()) {
    return file_error(folder + "/rgb.txt", 0, "has no image within 20 ms of one of depth.txt");
  }
  return out;
}

rt::Result<SequenceLayout> number_frames(const std::string& folder, std::vector<int> numbers,
                                         bool with_colour) {
  SequenceLayout out;
  out.kind = SequenceLayout::Kind::kSevenScenes;
  std::sort(numbers.begin(), numbers.end());
  for (const int n : numbers) {
    char head[32], stamp[32];
    std::snprintf(head, sizeof head, "/frame-%06d", n);
    const double t_s = n / kSevenScenesRate_hz;
    std::snprintf(stamp, sizeof stamp, "%.6f", t_s);
    RecordedImage e{t_s, stamp, folder + head + ".depth.png", folder + head + ".color.png"};
    for (const std::string& file : {e.depth_file, with_colour ? e.colour_file : e.depth_file}) {
      if (!regular_file(file)) return file_error(file, 0, "is not there, or not a file");
    }
    out.images.push_back(std::move(e));
  }
  return out;
}

}  // namespace

bool regular_file(const std::string& path) {
  struct stat s {};
  return ::stat(path.c_str(), &s) == 0 && S_ISREG(s.st_mode);
}

std::optional<int> seven_scenes_number(const std::string& file_name, const std::string& suffix) {
  constexpr std::size_t kHead = 6, kDigits = 6;
  if (file_name.size() != kHead + kDigits + suffix.size() || file_name.rfind("frame-", 0) != 0 ||
      file_name.compare(kHead + kDigits, std::string::npos, suffix) != 0)
    return std::nullopt;
  int n = 0;
  for (std::size_t i = kHead; i < kHead + kDigits; ++i) {
    if (file_name[i] < '0' || file_name[i] > '9') return std::nullopt;
    n = 10 * n + (file_name[i] - '0');
  }
  return n;
}

rt::Result<SequenceLayout> find_images(const std::string& folder, bool with_colour) {
  if (regular_file(folder + "/associations.txt")) return read_associations(folder, with_colour);
  if (regular_file(folder + "/depth.txt")) return pair_lists(folder, with_colour);
  std::vector<int> numbers;
  std::error_code ec;
  for (auto it = std::filesystem::directory_iterator(folder, ec);
       !ec && it != std::filesystem::directory_iterator(); it.increment(ec)) {
    if (const auto n = seven_scenes_number(it->path().filename().string(), ".depth.png"))
      numbers.push_back(*n);
  }
  if (!numbers.empty()) return number_frames(folder, std::move(numbers), with_colour);
  return file_error(folder, 0,
                    "holds neither associations.txt, nor depth.txt (TUM RGB-D), nor "
                    "frame-000000.depth.png and the like (7-Scenes)");
}

}  // namespace drivers
