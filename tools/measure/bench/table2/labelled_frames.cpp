#include "tools/measure/bench/table2/labelled_frames.hpp"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <optional>
#include <set>
#include <stdexcept>

#include "drivers/camera/recording/intrinsics_file.hpp"
#include "drivers/camera/sequence_layout.hpp"
#include "perception/geometry/no_colour.hpp"
#include "tools/files/image_files.hpp"
#include "tools/files/take.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;

// What a folder's name says of it.
std::optional<FrameKind> known_kind(const std::string& folder) {
  if (folder.rfind("mosd", 0) == 0) return FrameKind{{525, 525, 319.5, 239.5, 640, 480}, 1, true};
  if (folder == "tabletop")
    return FrameKind{{612.937, 613.173, 322.549, 248.158, 640, 480}, 1, false};
  if (folder == "ycb_video")
    return FrameKind{{1066.778, 1067.487, 312.9869, 241.3109, 640, 480}, 0.1F, false};
  return std::nullopt;
}

// Its intrinsics.txt goes before what its name says.
std::optional<FrameKind> kind_of(const fs::path& folder, const std::string& name) {
  auto kind = known_kind(name);
  const std::string file = (folder / "intrinsics.txt").string();
  if (!drivers::regular_file(file)) return kind;
  const auto read = take(drivers::read_intrinsics(file));
  if (!kind) kind.emplace();
  kind->k = read.k;
  kind->mm_per_unit = static_cast<float>(1000 / read.units_per_metre);
  return kind;
}

// The last word of the path, whether it ends in a slash or is ".".
std::string last_word(const fs::path& folder) {
  fs::path whole = fs::absolute(folder).lexically_normal();
  if (!whole.has_filename()) whole = whole.parent_path();
  return whole.filename().string();
}

}  // namespace

std::vector<LabelledFolder> labelled_folders(std::ostream& progress, const std::string& folder) {
  std::error_code ec;
  std::vector<fs::path> paths;
  const bool one = fs::is_directory(fs::path(folder) / "rgb");
  if (one) paths.emplace_back(folder);
  for (auto it = fs::directory_iterator(folder, ec); !one && !ec && it != fs::directory_iterator();
       it.increment(ec))
    if (it->is_directory(ec)) paths.push_back(it->path());
  std::sort(paths.begin(), paths.end());
  std::vector<LabelledFolder> all;
  for (const fs::path& f : paths) {
    const std::string name = last_word(f);
    if (!fs::is_directory(f / "rgb")) {
      progress << "left out: " << f.string() << ": holds no folder rgb\n";
      continue;
    }
    const auto kind = kind_of(f, name);
    if (!kind) {
      progress << "left out: " << f.string()
               << ": no intrinsics.txt (fx fy cx cy width height depth_units_per_metre)\n";
      continue;
    }
    LabelledFolder found{f.string(), name, *kind, {}};
    for (const auto& e : fs::directory_iterator(f / "rgb"))
      found.frames.push_back(e.path().filename());
    std::sort(found.frames.begin(), found.frames.end());
    if (found.frames.empty()) throw std::runtime_error((f / "rgb").string() + ": holds no image");
    all.push_back(std::move(found));
  }
  if (all.empty()) {
    throw std::runtime_error(folder +
                             ": neither has rgb, depth, label and intrinsics.txt nor holds folders "
                             "that have, or are named mosd..., tabletop or ycb_video");
  }
  return all;
}

LabelledFrame load_frame(const LabelledFolder& of, const std::string& name) {
  const fs::path folder = of.path;
  const FrameKind& kind = of.kind;
  LabelledFrame f;
  f.rgb = take(read_colour((folder / "rgb" / name).string()));
  perception::lift_black(f.rgb.view());                           // an image file's black is black
  const fs::path png = fs::path(name).replace_extension(".png");  // colour may be JPEG
  f.depth = take(read_grey((folder / "depth" / png).string()));
  f.label = take(read_grey((folder / "label" / png).string()));
  const int w = f.rgb.width(), h = f.rgb.height();
  if (f.depth.width() != w || f.depth.height() != h || f.label.width() != w ||
      f.label.height() != h) {
    throw std::runtime_error((folder / "rgb" / name).string() +
                             ": depth or label is of another size");
  }
  if (w != kind.k.width || h != kind.k.height) {
    throw std::runtime_error((folder / "rgb" / name).string() + ": must be " +
                             std::to_string(kind.k.width) + " x " + std::to_string(kind.k.height) +
                             ", as the folder's intrinsics");
  }
  for (int i = 0; kind.parts && i < w * h; ++i) {
    std::uint16_t& l = f.label.data()[i];
    l = l == 0 ? kUnlabelled : l < 20 ? std::uint16_t{0} : static_cast<std::uint16_t>(l / 10);
  }
  return f;
}

std::vector<std::uint16_t> objects_of(const LabelledFrame& frame) {
  std::set<std::uint16_t> all;
  for (int i = 0; i < frame.label.width() * frame.label.height(); ++i)
    all.insert(frame.label.data()[i]);
  all.erase(0);
  all.erase(kUnlabelled);
  return {all.begin(), all.end()};
}

std::string metric_name(const std::string& folder) {
  if (folder == "mosd_learn") return "mosd";
  std::string name = folder;
  for (char& c : name) {
    const auto byte = static_cast<unsigned char>(c);
    c = std::isalnum(byte) != 0 ? static_cast<char>(std::tolower(byte)) : '_';
  }
  return name;
}

}  // namespace teletact
