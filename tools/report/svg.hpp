// Small SVG figures for reports: line plots, histograms, images with overlays. No dependency beyond
// OpenCV's PNG encoder; the text stays text, so a figure can be searched and read by a person.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace plot {

struct Series {
  std::string name;
  std::vector<double> x, y;  // a point that is not finite breaks the line
  std::string colour;        // empty: the next of the palette
  bool points = false;       // markers instead of a line
  bool filled = false;       // area down to the axis
};

// A vertical or horizontal reference, e.g. a budget.
struct Rule {
  double at = 0;
  bool vertical = true;
  std::string label, colour = "#b03a2e";
};

// A point with its name beside it; with a ring round it where it stands out.
struct Mark {
  double x = 0, y = 0;
  std::string label;
  bool ring = false;
};

struct Figure {
  std::string title, x_label, y_label;
  bool log_x = false, log_y = false;
  int width_px = 720, height_px = 320;
  std::vector<Series> series;
  std::vector<Rule> rules;
  std::vector<Mark> marks;
};
// A line plot with axes, ticks, grid and legend. More points than pixels are thinned to the
// smallest and largest of each pixel column, so that no peak is lost.
[[nodiscard]] std::string line_plot(const Figure& figure);

struct Bins {
  std::string name;
  std::vector<double> lower;  // lower edge of each bin, ascending; the last one ends at `upper_end`
  std::vector<double> count;
  double upper_end = 0;  // 0: the last bin is as wide as the one before
  std::string colour;
};
// Histograms as outlined steps over each other; with log_y a count of 1 is drawn above the axis.
[[nodiscard]] std::string histogram(const Figure& axes, std::span<const Bins> bins);

// Overlays are given in image pixels (pixel centres at integers) or, for a map, in the map's units.
struct Overlay {
  enum class Kind : std::uint8_t { kPolyline, kCross, kDot, kCircle, kArrow };
  Kind kind = Kind::kPolyline;
  std::vector<double> x, y;
  std::string colour = "#d81b60", label;
  double width_px = 2, radius_px = 5;
  bool dashed = false;
};

// 8-bit images, row-major.
struct Picture {
  int width = 0, height = 0;
  int channels = 3;  // 3: RGB, 1: grey
  std::vector<std::uint8_t> pixels;
};
// data:image/png;base64,... Throws std::runtime_error on an inconsistent size.
[[nodiscard]] std::string png_data_url(const Picture& picture);

// An image with overlays in pixels, scaled to width_px, with a legend for labelled overlays.
[[nodiscard]] std::string image_plot(const std::string& title, const Picture& picture,
                                     std::span<const Overlay> overlays, int width_px = 720);

// A top view: `picture` row 0 is at the smallest y; x to the right, y up, axes in metres.
struct MapAxes {
  std::string title;
  double x0_m = 0, y0_m = 0;   // lower left corner of the picture
  double resolution_m = 0.05;  // a pixel
  int width_px = 720;
};
[[nodiscard]] std::string map_plot(const MapAxes& axes, const Picture& picture,
                                   std::span<const Overlay> overlays);

[[nodiscard]] std::string escaped(const std::string& text);  // for XML and HTML
[[nodiscard]] std::string base64(std::span<const std::uint8_t> bytes);
// Ticks at 1, 2, 5 x 10^n inside [lo, hi], about `wanted` of them.
[[nodiscard]] std::vector<double> nice_ticks(double lo, double hi, int wanted);

}  // namespace plot
