#include "drivers/camera/tum_reader.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "drivers/camera/tum_files.hpp"

namespace drivers {

using perception::Intrinsics;
using perception::Rgb;
using perception::RgbdFrame;
using perception::Vec3;

namespace {

using Tokens = std::vector<std::string>;

constexpr int kKinectWidth = 512, kKinectHeight = 424;
constexpr int kSourceWidth = 640, kSourceHeight = 480;
constexpr double kScale = static_cast<double>(kKinectHeight) / kSourceHeight;
constexpr int kCropLeft = 26;  // (640 kScale - 512) / 2, whole pixels

rt::Result<bool> read_intrinsics(const std::string& path, Intrinsics& k, double& units) {
  bool seen = false;
  auto ok = for_each_line(path, [&](int n, const Tokens& t) -> rt::Result<bool> {
    if (seen) return file_error(path, n, "a second line of numbers");
    if (t.size() != 7) {
      return file_error(path, n,
                        "wanted 7 numbers (fx fy cx cy width height units_per_metre), found " +
                            std::to_string(t.size()));
    }
    const char* names[7] = {"fx", "fy", "cx", "cy", "width", "height", "units_per_metre"};
    double v[7];
    for (std::size_t i = 0; i < 7; ++i) {
      auto number = parse_number(path, n, names[i], t[i]);
      if (!number) return rt::Error{number.error()};
      v[i] = number.value();
    }
    const auto range = [&](std::size_t i, double lo, double hi) {
      return v[i] >= lo && v[i] <= hi ? std::string()
                                      : std::string(names[i]) + " = " + t[i] + " is outside " +
                                            std::to_string(lo) + " ... " + std::to_string(hi);
    };
    for (const std::string& bad : {range(0, 1, 1e5), range(1, 1, 1e5), range(2, -1e5, 1e5),
                                   range(3, -1e5, 1e5), range(4, 1, RgbdFrame::kMaxWidth),
                                   range(5, 1, RgbdFrame::kMaxHeight), range(6, 1, 1e6)}) {
      if (!bad.empty()) return file_error(path, n, bad);
    }
    for (const std::size_t i : {std::size_t{4}, std::size_t{5}}) {
      if (v[i] != std::floor(v[i])) {
        return file_error(path, n, std::string(names[i]) + " = " + t[i] + " is not whole");
      }
    }
    k = {v[0], v[1], v[2], v[3], static_cast<int>(v[4]), static_cast<int>(v[5])};
    units = v[6];
    seen = true;
    return true;
  });
  if (ok && !seen) return file_error(path, 0, "has no line of numbers");
  return ok;
}

bool regular_file(const std::string& path) {
  struct stat s {};
  return ::stat(path.c_str(), &s) == 0 && S_ISREG(s.st_mode);
}

// Pixel of the 640 x 480 source that pixel (u, v) of the 512 x 424 image shows.
int source_u(int u) { return static_cast<int>(std::floor((u + kCropLeft + 0.5) / kScale)); }
int source_v(int v) { return static_cast<int>(std::floor((v + 0.5) / kScale)); }

std::uint16_t to_mm(std::uint16_t raw, double units_per_metre) {
  if (raw == 0 || raw == 65535) return 0;
  const double mm = raw * 1000.0 / units_per_metre + 0.5;
  return mm < 65535.0 ? static_cast<std::uint16_t>(mm) : std::uint16_t{0};
}

Rgb to_rgb(const cv::Vec3b& bgr) { return {bgr[2], bgr[1], bgr[0]}; }

}  // namespace

rt::Result<TumSequence> TumSequence::open(const std::string& folder, const TumOptions& options) {
  opencv_threads_off();
  TumSequence s;
  s.folder_ = folder;
  s.options_ = options;
  auto ok = read_intrinsics(folder + "/intrinsics.txt", s.source_, s.units_per_metre_);
  if (!ok) return rt::Error{ok.error()};
  s.intrinsics_ = s.source_;
  if (options.to_512x424) {
    if (s.source_.width != kSourceWidth || s.source_.height != kSourceHeight) {
      return file_error(folder + "/intrinsics.txt", 0,
                        "images are " + std::to_string(s.source_.width) + " x " +
                            std::to_string(s.source_.height) +
                            "; only 640 x 480 can be resampled to 512 x 424");
    }
    // Pixel centres are whole numbers, so the scale acts about (-0.5, -0.5).
    s.intrinsics_ = {s.source_.fx * kScale,
                     s.source_.fy * kScale,
                     (s.source_.cx + 0.5) * kScale - 0.5 - kCropLeft,
                     (s.source_.cy + 0.5) * kScale - 0.5,
                     kKinectWidth,
                     kKinectHeight};
  }

  const std::string list = folder + "/associations.txt";
  ok = for_each_line(list, [&](int n, const Tokens& t) -> rt::Result<bool> {
    if (t.size() != 4) {
      return file_error(list, n,
                        "wanted 't_colour colour_file t_depth depth_file', found " +
                            std::to_string(t.size()) + " words");
    }
    auto colour_s = parse_number(list, n, "colour stamp", t[0]);
    if (!colour_s) return rt::Error{colour_s.error()};
    auto depth_s = parse_number(list, n, "depth stamp", t[2]);
    if (!depth_s) return rt::Error{depth_s.error()};
    if (std::abs(depth_s.value()) > 4e9) {
      return file_error(list, n, "depth stamp " + t[2] + " is outside -4e9 ... 4e9 s");
    }
    if (!s.entries_.empty() && depth_s.value() <= s.entries_.back().depth_s) {
      return file_error(
          list, n, "depth stamp " + t[2] + " does not rise above " + s.entries_.back().depth_stamp);
    }
    Entry e{depth_s.value(), t[2], folder + "/" + t[3], folder + "/" + t[1], n};
    if (!regular_file(e.depth_file)) {
      return file_error(list, n, "no such file: '" + e.depth_file + "'");
    }
    if (!options.skip_colour && !regular_file(e.colour_file)) {
      return file_error(list, n, "no such file: '" + e.colour_file + "'");
    }
    s.entries_.push_back(std::move(e));
    return true;
  });
  if (!ok) return rt::Error{ok.error()};
  if (s.entries_.empty()) return file_error(list, 0, "lists no frame");

  const std::string registration = folder + "/colour_registration.txt";
  if (!options.skip_colour && regular_file(registration)) {
    ok = s.read_registration(registration);
    if (!ok) return rt::Error{ok.error()};
  }
  return s;
}

rt::Result<bool> TumSequence::read_registration(const std::string& path) {
  ColourCamera c;
  unsigned seen = 0;
  auto ok = for_each_line(path, [&](int n, const Tokens& t) -> rt::Result<bool> {
    const char* names[] = {"fx", "fy", "cx", "cy", "R", "t"};
    const std::size_t counts[] = {1, 1, 1, 1, 9, 3};
    std::size_t key = 0;
    while (key < 6 && t[0] != names[key]) ++key;
    if (key == 6) return file_error(path, n, "unknown key '" + t[0] + "' (fx fy cx cy R t)");
    if ((seen & (1U << key)) != 0) return file_error(path, n, "a second '" + t[0] + "'");
    seen |= 1U << key;
    if (t.size() != counts[key] + 1) {
      return file_error(path, n,
                        "'" + t[0] + "' wants " + std::to_string(counts[key]) + " numbers, found " +
                            std::to_string(t.size() - 1));
    }
    double v[9];
    for (std::size_t i = 0; i < counts[key]; ++i) {
      auto number = parse_number(path, n, t[0], t[i + 1]);
      if (!number) return rt::Error{number.error()};
      v[i] = number.value();
    }
    if (key < 2 && !(v[0] > 0)) return file_error(path, n, t[0] + " must be above 0");
    if (key < 4) {
      (key == 0 ? c.fx : key == 1 ? c.fy : key == 2 ? c.cx : c.cy) = v[0];
    } else if (key == 4) {
      c.R << v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8];
      if ((c.R * c.R.transpose() - perception::Mat3::Identity()).norm() > 1e-3) {
        return file_error(path, n, "R is not a rotation");
      }
    } else {
      c.t = Vec3(v[0], v[1], v[2]);
    }
    return true;
  });
  if (ok && seen != 0x3fU) return file_error(path, 0, "fx, fy, cx, cy, R, t must all be there");
  registration_ = c;
  return ok;
}

rt::Result<bool> TumSequence::read(int i, RgbdFrame& out) const {
  if (i < 0 || i >= size()) {
    return rt::Error{folder_ + ": frame " + std::to_string(i) + " is outside 0 ... " +
                     std::to_string(size() - 1)};
  }
  const Entry& e = entries_[static_cast<std::size_t>(i)];
  auto depth = read_image(e.depth_file, CV_16UC1, source_.width, source_.height);
  if (!depth) return rt::Error{depth.error()};
  out.exposure = rt::time_from_ns(rt::nanos_from_seconds(e.depth_s).count());
  out.seq = static_cast<std::uint64_t>(i);
  out.intrinsics = intrinsics_;
  out.has_colour = false;
  for (int v = 0; v < intrinsics_.height; ++v) {
    const auto* row = depth.value().ptr<std::uint16_t>(options_.to_512x424 ? source_v(v) : v);
    for (int u = 0; u < intrinsics_.width; ++u) {
      out.depth().at(u, v) = to_mm(row[options_.to_512x424 ? source_u(u) : u], units_per_metre_);
    }
  }
  if (options_.skip_colour || (registration_ && !options_.register_colour)) return true;

  auto colour = read_image(e.colour_file, CV_8UC3, source_.width, source_.height);
  if (!colour) return rt::Error{colour.error()};
  out.has_colour = true;
  if (registration_) {
    register_colour(colour.value(), out);
    return true;
  }
  for (int v = 0; v < intrinsics_.height; ++v) {
    const auto* row = colour.value().ptr<cv::Vec3b>(options_.to_512x424 ? source_v(v) : v);
    for (int u = 0; u < intrinsics_.width; ++u) {
      out.rgb().at(u, v) = to_rgb(row[options_.to_512x424 ? source_u(u) : u]);
    }
  }
  return true;
}

void TumSequence::register_colour(const cv::Mat& colour, RgbdFrame& out) const {
  const ColourCamera& c = *registration_;
  struct Seen {
    int u = -1, v = -1;
    float z = 0;
  };
  std::vector<Seen> seen(static_cast<std::size_t>(intrinsics_.width) *
                         static_cast<std::size_t>(intrinsics_.height));
  // What the colour camera sees nearest, in 3 x 3 pixel marks: the two grids differ in scale, and a
  // mark of one pixel would leave holes for the background to look through.
  std::vector<float> nearest(colour.total(), 1e9F);
  for (int v = 0; v < intrinsics_.height; ++v) {
    for (int u = 0; u < intrinsics_.width; ++u) {
      const int mm = out.depth().at(u, v);
      if (mm == 0) continue;
      const Vec3 p = c.R * intrinsics_.unproject(u, v, mm * 1e-3) + c.t;
      if (p.z() <= 0.05) continue;
      const double cu = c.fx * p.x() / p.z() + c.cx, cv = c.fy * p.y() / p.z() + c.cy;
      if (!(cu > -0.5 && cv > -0.5 && cu < colour.cols - 0.5 && cv < colour.rows - 0.5)) continue;
      Seen& s = seen[static_cast<std::size_t>(v * intrinsics_.width + u)];
      s = {static_cast<int>(cu + 0.5), static_cast<int>(cv + 0.5), static_cast<float>(p.z())};
      for (int y = std::max(s.v - 1, 0); y <= std::min(s.v + 1, colour.rows - 1); ++y) {
        for (int x = std::max(s.u - 1, 0); x <= std::min(s.u + 1, colour.cols - 1); ++x) {
          float& n = nearest[static_cast<std::size_t>(y * colour.cols + x)];
          n = std::min(n, s.z);
        }
      }
    }
  }
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Seen& s = seen[i];
    const bool visible =
        s.u >= 0 && s.z <= nearest[static_cast<std::size_t>(s.v * colour.cols + s.u)] * 1.04F;
    out.colour[i] = visible ? to_rgb(colour.at<cv::Vec3b>(s.v, s.u)) : Rgb{};
  }
}

}  // namespace drivers
