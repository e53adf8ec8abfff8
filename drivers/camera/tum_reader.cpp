#include "drivers/camera/tum_reader.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>

#include "drivers/camera/recording/image_header.hpp"
#include "drivers/camera/recording/intrinsics_file.hpp"
#include "drivers/camera/recording/tum_files.hpp"
#include "perception/geometry/no_colour.hpp"

namespace drivers {

using perception::Intrinsics;
using perception::Rgb;
using perception::RgbdFrame;
using perception::Vec3;

namespace {

constexpr int kKinectWidth = 512, kKinectHeight = 424;
constexpr int kSourceWidth = 640, kSourceHeight = 480;
constexpr double kScale = static_cast<double>(kKinectHeight) / kSourceHeight;
constexpr int kCropLeft = 26;  // (640 kScale - 512) / 2, whole pixels

// Pixel of the 640 x 480 source that pixel (u, v) of the 512 x 424 image shows.
int source_u(int u) { return static_cast<int>(std::floor((u + kCropLeft + 0.5) / kScale)); }
int source_v(int v) { return static_cast<int>(std::floor((v + 0.5) / kScale)); }

std::uint16_t to_mm(std::uint16_t raw, double units_per_metre) {
  if (raw == 0 || raw == 65535) return 0;
  const double mm = raw * 1000.0 / units_per_metre + 0.5;
  return mm < 65535.0 ? static_cast<std::uint16_t>(mm) : std::uint16_t{0};
}

Rgb to_rgb(const cv::Vec3b& bgr) { return perception::lifted({bgr[2], bgr[1], bgr[0]}); }

}  // namespace

rt::Result<TumSequence> TumSequence::open(const std::string& folder, const TumOptions& options) {
  opencv_threads_off();
  TumSequence s;
  s.folder_ = folder;
  s.options_ = options;
  const std::string intrinsics = folder + "/intrinsics.txt";
  const bool has_intrinsics = regular_file(intrinsics);
  if (has_intrinsics) {
    const auto read = read_intrinsics(intrinsics);
    if (!read) return rt::Error{read.error()};
    s.source_ = read.value().k;
    s.units_per_metre_ = read.value().units_per_metre;
    if (options.pinhole) {
      return file_error(intrinsics, 0, "is there: other intrinsics are only for a folder without");
    }
  }
  auto layout = find_images(folder, !options.skip_colour);
  if (!layout && !has_intrinsics && !regular_file(folder + "/associations.txt") &&
      !regular_file(folder + "/depth.txt")) {
    return file_error(intrinsics, 0, "can not be opened, and " + layout.error());
  }
  if (!layout) return rt::Error{layout.error()};
  s.layout_ = std::move(layout).value();
  if (s.layout_.left_out > 0) {
    s.assumed_.push_back(folder + ": " + std::to_string(s.layout_.left_out) +
                         " depth images have no colour image within 20 ms and are left out");
  }
  if (!has_intrinsics) {
    const auto ok = s.assume_pinhole();
    if (!ok) return rt::Error{ok.error()};
  }
  s.intrinsics_ = s.source_;
  if (options.to_512x424) {
    if (s.source_.width != kSourceWidth || s.source_.height != kSourceHeight) {
      return file_error(intrinsics, 0,
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
  const auto ok = s.find_registration();
  if (!ok) return rt::Error{ok.error()};
  return s;
}

// The size of the first depth image, and the pinhole asked for or the data set's own.
rt::Result<bool> TumSequence::assume_pinhole() {
  const std::string& first = layout_.images.front().depth_file;
  std::ifstream file(first, std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  const auto header =
      image_header({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, first);
  if (!header) return rt::Error{header.error()};
  const int w = header.value().width, h = header.value().height;
  const std::string size = std::to_string(w) + " x " + std::to_string(h);
  if (w > RgbdFrame::kMaxWidth || h > RgbdFrame::kMaxHeight) {
    return file_error(first, 0,
                      "is " + size + ", the largest image is " +
                          std::to_string(RgbdFrame::kMaxWidth) + " x " +
                          std::to_string(RgbdFrame::kMaxHeight));
  }
  const bool scenes = layout_.kind == SequenceLayout::Kind::kSevenScenes;
  units_per_metre_ = scenes ? 1000 : 5000;
  if (options_.pinhole) {
    const auto& p = *options_.pinhole;
    source_ = {p.fx, p.fy, p.cx, p.cy, w, h};
    if (p.units_per_metre > 0) units_per_metre_ = p.units_per_metre;
    return true;
  }
  if (w != kSourceWidth || h != kSourceHeight) {
    return file_error(folder_ + "/intrinsics.txt", 0,
                      "can not be opened, and no other intrinsics are given for images of " + size);
  }
  source_ =
      scenes ? Intrinsics{585, 585, 320, 240, w, h} : Intrinsics{525, 525, 319.5, 239.5, w, h};
  char said[256];
  std::snprintf(said, sizeof said,
                ": no intrinsics.txt; those of %s are assumed: %g,%g,%g,%g px, %g a metre",
                scenes ? "7-Scenes" : "the TUM RGB-D benchmark", source_.fx, source_.fy, source_.cx,
                source_.cy, units_per_metre_);
  assumed_.push_back(folder_ + said);
  return true;
}

rt::Result<bool> TumSequence::find_registration() {
  if (options_.skip_colour) return true;
  const std::string path = folder_ + "/colour_registration.txt";
  if (regular_file(path)) return read_registration(path);
  if (layout_.kind != SequenceLayout::Kind::kSevenScenes) return true;
  // Fitted to the depth steps of its RedKitchen; the data set says nothing of its colour camera.
  ColourCamera c;
  c.fx = c.fy = 526;
  c.cx = 320.7, c.cy = 237.1;
  c.R << 0.999974, -0.007227, 0, 0.007227, 0.999974, 0, 0, 0, 1;
  c.t = Vec3(-0.025, 0.0024, 0);
  registration_ = c;
  assumed_.push_back(folder_ +
                     ": no colour_registration.txt; the colour camera is assumed where it was "
                     "found for RedKitchen of 7-Scenes");
  return true;
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
  const RecordedImage& e = layout_.images[static_cast<std::size_t>(i)];
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
    out.colour[i] = visible ? to_rgb(colour.at<cv::Vec3b>(s.v, s.u)) : perception::kNoColour;
  }
}

}  // namespace drivers
