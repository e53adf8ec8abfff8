#include "tools/offline/segment.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>

#include "perception/geometry/no_colour.hpp"
#include "perception/segmentation/click_segmenter.hpp"
#include "perception/segmentation/object_summary.hpp"
#include "perception/segmentation/region_merge.hpp"
#include "perception/segmentation/touch_segmenter.hpp"
#include "perception/segmentation/whole_depth.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/image_files.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/take.hpp"
#include "tools/files/whole_file.hpp"

namespace teletact {
namespace {

using perception::Image;
using perception::Rgb;

struct Touch {
  int u = 0, v = 0;
};

// What one touch selected: pixels, and d of each for the overlap.
struct Selected {
  std::vector<int> pixels;
  std::vector<float> d;
};

double cpu_ms() { return 1e-6 * static_cast<double>(rt::thread_cpu_ns()); }

Touch parse_touch(const std::string& option, const std::string& text, int width, int height) {
  const auto v = number_list(option, text, 2, 2);
  if (v[0] != std::floor(v[0]) || v[1] != std::floor(v[1]) || v[0] < 0 || v[1] < 0 ||
      v[0] >= width || v[1] >= height) {
    throw std::runtime_error(option + " " + text + ": must be a pixel of the image, 0..." +
                             std::to_string(width - 1) + ",0..." + std::to_string(height - 1));
  }
  return {static_cast<int>(v[0]), static_cast<int>(v[1])};
}

perception::Intrinsics parse_intrinsics(const std::string& text, int width, int height) {
  static_cast<void>(number_list("--intrinsics", text, 4, 4));  // --depth-unit says the unit
  const auto p = parse_pinhole(text);
  return {p.fx, p.fy, p.cx, p.cy, width, height};
}

class Segmenter {
 public:
  Segmenter(const SegmentOptions& o, const Image<Rgb>& rgb, const Image<std::uint16_t>* depth,
            const perception::Intrinsics& k)
      : o_(o),
        rgb_(rgb),
        depth_(depth),
        lab_(rgb.width(), rgb.height()),
        points_(rgb.width(), rgb.height()) {
    lab_.set(rgb.view());
    if (depth_ != nullptr) points_.set(depth_->view(), k, static_cast<float>(o.depth_unit_mm));
    if (o.method == "paper") {
      grower_.emplace(rgb.width(), rgb.height());
    } else if (depth_ != nullptr) {
      touch_.emplace(rgb.width(), rgb.height());
      touch_->set_frame(rgb.view(), depth_->view(), k, static_cast<float>(o.depth_unit_mm));
    } else {
      whole_ = perception::segment_whole(rgb.view(), {});
    }
  }

  Selected select(const Touch& t) {
    const int seed = t.v * rgb_.width() + t.u;
    Selected s;
    if (grower_) {
      if (grower_->grow(lab_, depth_ != nullptr ? &points_ : nullptr, seed, o_.grow) == 0) {
        throw std::runtime_error(o_.depth + ": holds no reading: every pixel is 0 or 65535");
      }
      s.pixels.assign(grower_->members().begin(), grower_->members().end());
      s.d = grower_->distances();
      return s;
    }
    if (touch_) touch_->touch(t.u, t.v);
    for (int i = 0; i < rgb_.width() * rgb_.height(); ++i) {
      const bool in = touch_ ? touch_->in(i % rgb_.width(), i / rgb_.width())
                             : whole_.labels[static_cast<std::size_t>(i)] ==
                                   whole_.labels[static_cast<std::size_t>(seed)];
      if (in || i == seed) s.pixels.push_back(i);
    }
    measure(s);
    return s;
  }

  [[nodiscard]] perception::ObjectSummary summary(const std::vector<int>& pixels) const {
    std::vector<perception::Vec3f> points;
    std::vector<Rgb> colours;
    for (const int i : pixels) {
      colours.push_back(rgb_.data()[i]);
      if (depth_ == nullptr || !(points_.z_mm()[i] > 0)) continue;
      points.push_back(1e-3F *
                       perception::Vec3f(points_.x_mm()[i], points_.y_mm()[i], points_.z_mm()[i]));
    }
    std::vector<float> scratch(points.size());
    return perception::summarise(points, colours, scratch);
  }

 private:
  // d of every pixel to the means of the whole region.
  void measure(Selected& s) const {
    double m[6] = {0, 0, 0, 0, 0, 0}, placed = 0;
    const bool flat = depth_ == nullptr;
    const auto place = [&](int i, double p[3]) {
      p[0] = flat ? i % rgb_.width() : static_cast<double>(points_.x_mm()[i]);
      const int row = i / rgb_.width();
      p[1] = flat ? row : static_cast<double>(points_.y_mm()[i]);
      p[2] = flat ? 0 : static_cast<double>(points_.z_mm()[i]);
      return flat || points_.z_mm()[i] > 0;
    };
    const auto n = static_cast<double>(s.pixels.size());
    double p[3];
    for (const int i : s.pixels) {
      const perception::Lab c = lab_.at(i);
      m[0] += static_cast<double>(c.L) / n, m[1] += static_cast<double>(c.a) / n,
          m[2] += static_cast<double>(c.b) / n;
      if (!place(i, p)) continue;
      m[3] += p[0], m[4] += p[1], m[5] += p[2], placed += 1;
    }
    for (int k = 3; k < 6; ++k) m[k] /= std::max(1.0, placed);
    const double beta =
        static_cast<double>(o_.grow.m) / static_cast<double>(flat ? o_.grow.g_px : o_.grow.g_mm);
    s.d.reserve(s.pixels.size());
    for (const int i : s.pixels) {
      const perception::Lab c = lab_.at(i);
      const double colour =
          std::hypot(static_cast<double>(c.L) - m[0], static_cast<double>(c.a) - m[1],
                     static_cast<double>(c.b) - m[2]);
      const double far = place(i, p) ? std::hypot(p[0] - m[3], p[1] - m[4], p[2] - m[5]) : 0;
      s.d.push_back(static_cast<float>(colour + beta * far));
    }
  }

  const SegmentOptions& o_;
  const Image<Rgb>& rgb_;
  const Image<std::uint16_t>* depth_;
  perception::LabImage lab_;
  perception::PointImage points_;
  std::optional<perception::RegionGrower> grower_;
  std::optional<perception::TouchSegmenter> touch_;
  perception::WholeImage whole_;
};

void add_metrics(Metrics& metrics, int number, const perception::ObjectSummary& s,
                 std::size_t pixels) {
  const std::string head = "segment.object_" + std::to_string(number) + ".";
  metrics.add(head + "pixels", static_cast<double>(pixels), "1");
  char colour[16];
  std::snprintf(colour, sizeof colour, "#%02x%02x%02x", s.colour.r, s.colour.g, s.colour.b);
  metrics.add(head + "colour", colour, "sRGB");
  if (s.points == 0) return;
  const Eigen::Quaterniond q(s.X_FO.linear());
  const double sign = q.w() < 0 ? -1 : 1;
  const char* axis[] = {"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    metrics.add(head + "centroid_" + axis[k] + "_m", s.X_FO.translation()[k], "m");
    metrics.add(head + "extent_" + axis[k] + "_m", s.extent_m[k], "m");
    metrics.add(head + "q" + axis[k], sign * q.vec()[k], "1");
  }
  metrics.add(head + "qw", sign * q.w(), "1");
}

// Depth of the colour image's size, and its pinhole.
struct Depth {
  Image<std::uint16_t> image;
  perception::Intrinsics k;
};
std::optional<Depth> read_depth(const SegmentOptions& o, int w, int h) {
  if (o.depth.empty()) return std::nullopt;
  Depth depth{{}, parse_intrinsics(o.intrinsics, w, h)};
  depth.image = take(read_grey(o.depth));
  if (depth.image.width() != w || depth.image.height() != h) {
    throw std::runtime_error(o.depth + ": is " + std::to_string(depth.image.width()) + " x " +
                             std::to_string(depth.image.height()) + ", the colour image " +
                             std::to_string(w) + " x " + std::to_string(h));
  }
  const std::uint16_t* begin = depth.image.data();
  if (std::all_of(begin, begin + static_cast<std::ptrdiff_t>(w) * h,
                  [](std::uint16_t d) { return d == 0 || d == 65535; })) {
    throw std::runtime_error(o.depth + ": holds no reading: every pixel is 0 or 65535");
  }
  return depth;
}

Image<std::uint16_t> segment_all(const SegmentOptions& o, const Image<Rgb>& rgb, Metrics& metrics) {
  const auto depth = read_depth(o, rgb.width(), rgb.height());
  const double t0 = cpu_ms();
  const auto whole = depth ? perception::segment_whole(rgb.view(), depth->image.view(), depth->k,
                                                       static_cast<float>(o.depth_unit_mm), {})
                           : perception::segment_whole(rgb.view(), {});
  metrics.add("segment.cpu_ms", cpu_ms() - t0, "ms");
  metrics.add("segment.regions", whole.regions, "1");
  Image<std::uint16_t> labels(rgb.width(), rgb.height());
  std::copy(whole.labels.begin(), whole.labels.end(), labels.data());
  return labels;
}

Image<std::uint16_t> segment_touches(const SegmentOptions& o, const Image<Rgb>& rgb,
                                     Metrics& metrics) {
  const int w = rgb.width(), h = rgb.height();
  std::vector<Touch> touches;
  for (const std::string& t : o.touches) touches.push_back(parse_touch("--touch", t, w, h));
  const auto depth = read_depth(o, w, h);
  const double t0 = cpu_ms();
  Segmenter segmenter(o, rgb, depth ? &depth->image : nullptr,
                      depth ? depth->k : perception::Intrinsics{});
  Image<std::uint16_t> out(w, h, 0);
  std::vector<float> least(static_cast<std::size_t>(w * h), 1e30F);
  for (std::size_t n = 0; n < touches.size(); ++n) {
    const Selected s = segmenter.select(touches[n]);
    for (std::size_t i = 0; i < s.pixels.size(); ++i) {
      const auto p = static_cast<std::size_t>(s.pixels[i]);
      if (s.d[i] < least[p]) least[p] = s.d[i], out.data()[p] = static_cast<std::uint16_t>(n + 1);
    }
    add_metrics(metrics, static_cast<int>(n + 1), segmenter.summary(s.pixels), s.pixels.size());
  }
  for (std::size_t n = 0; n < touches.size(); ++n) {
    out.at(touches[n].u, touches[n].v) = static_cast<std::uint16_t>(n + 1);
  }
  metrics.add("segment.cpu_ms", cpu_ms() - t0, "ms");
  return out;
}

// One object, by all the clicks together.
Image<std::uint16_t> segment_clicks(const SegmentOptions& o, const Image<Rgb>& rgb,
                                    Metrics& metrics) {
  const int w = rgb.width(), h = rgb.height();
  std::vector<perception::Click> clicks;
  for (const std::string& text : o.touches) {
    const Touch t = parse_touch("--touch", text, w, h);
    clicks.push_back({t.u, t.v, true});
  }
  for (const std::string& text : o.nots) {
    const Touch t = parse_touch("--not", text, w, h);
    clicks.push_back({t.u, t.v, false});
  }
  const auto depth = read_depth(o, w, h);
  if (!depth) throw std::runtime_error("--not and --one-object need --depth");
  const auto unit = static_cast<float>(o.depth_unit_mm);
  const double t0 = cpu_ms();
  perception::ClickSegmenter segmenter(w, h);
  segmenter.set_frame(rgb.view(), depth->image.view(), depth->k, unit);
  const auto answer = segmenter.segment(clicks);
  if (perception::refused(answer))
    throw std::runtime_error(std::string("--touch, --not: ") + perception::reason(answer));
  Image<std::uint16_t> out(w, h, 0);
  std::vector<int> pixels;
  for (int i = 0; i < w * h; ++i) {
    if (!segmenter.in(i % w, i / w)) continue;
    out.data()[i] = 1;
    pixels.push_back(i);
  }
  metrics.add("segment.cpu_ms", cpu_ms() - t0, "ms");
  add_metrics(metrics, 1, Segmenter(o, rgb, &depth->image, depth->k).summary(pixels),
              pixels.size());
  return out;
}

// A depth image lies as the camera saw it, so the colour image beside it has to.
Image<Rgb> read_upright(const SegmentOptions& o) {
  auto upright = take(read_colour(o.color, Orientation::kUpright));
  if (o.depth.empty()) return upright;
  auto stored = take(read_colour(o.color));
  const std::size_t pixels = static_cast<std::size_t>(stored.width() * stored.height());
  if (stored.width() != upright.width() ||
      !std::equal(stored.data(), stored.data() + pixels, upright.data())) {
    throw std::runtime_error(o.color + ": is turned by its EXIF orientation, " + o.depth +
                             " is not: store the colour image upright, without that tag");
  }
  return stored;
}

}  // namespace

void segment_image(const SegmentOptions& o) {
  check_outputs({{"--out", o.out}, {"--json", o.json}}, {o.color, o.depth});
  auto rgb = read_upright(o);
  // An image file's black is black. Without depth nothing asks (region_grow.hpp).
  if (!o.depth.empty()) perception::lift_black(rgb.view());
  if (rgb.width() < 2 || rgb.height() < 2)
    throw std::runtime_error(o.color + ": is below 2 x 2 pixels");
  Metrics metrics("segment");
  const bool one = o.one_object || !o.nots.empty();
  const Image<std::uint16_t> labels = o.whole ? segment_all(o, rgb, metrics)
                                      : one   ? segment_clicks(o, rgb, metrics)
                                              : segment_touches(o, rgb, metrics);
  const std::string png = encode_labels(labels.view());
  write_outputs({{o.out, [&](const auto& path) { write_whole_file(path, png); }},
                 {o.json, [&](const auto& path) { metrics.write(path); }}});
  for (const auto& row : metrics.rows()) {
    if (row.name == "segment.cpu_ms" || row.name == "segment.regions") {
      std::printf("%s %.1f %s\n", row.name.c_str(), row.value, row.unit.c_str());
    }
  }
}

}  // namespace teletact
