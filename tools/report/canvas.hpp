// What the figures share: number formats, scales, and a text buffer that writes SVG elements.
#pragma once

#include <string>
#include <vector>

#include "tools/report/svg.hpp"

namespace plot {

// Colours that stay apart for colour-blind readers (Okabe, Ito 2008).
[[nodiscard]] const std::string& palette(std::size_t i);
// Short: 4 significant digits, no trailing zeros, "1e6" beyond a million.
[[nodiscard]] std::string number(double v);

// One axis: values [lo, hi] onto pixels [p0, p1].
struct Scale {
  double lo = 0, hi = 1, p0 = 0, p1 = 1;
  bool log = false;
  [[nodiscard]] double px(double v) const;
  [[nodiscard]] std::vector<double> ticks(int wanted) const;
  // A usable range round the given values; `log` looks at positive ones only.
  static Scale over(double lo, double hi, bool log);
};

struct LegendItem {
  enum class Sign : std::uint8_t { kLine, kDot, kCross, kCircle };
  std::string label, colour;
  Sign sign = Sign::kLine;
  bool dashed = false;
};

class Canvas {
 public:
  Canvas(double width, double height, const std::string& title);
  void text(double x, double y, const std::string& s, const char* anchor = "start",
            double size = 12, const char* colour = "#333", double rotate = 0);
  void line(double x0, double y0, double x1, double y1, const std::string& colour, double width,
            bool dashed = false);
  void rect(double x, double y, double w, double h, const std::string& fill,
            const std::string& stroke = "none");
  void raw(const std::string& s) { out_ += s; }
  // A row of labels from (x, y), wrapped at x1; returns the height used.
  double legend(double x, double x1, double y, const std::vector<LegendItem>& items);
  // Everything up to pop_clip() is cut at this rectangle; coordinates stay those of the canvas.
  void push_clip(double x, double y, double w, double h);
  void pop_clip() { out_ += "</svg>\n"; }
  [[nodiscard]] std::string finish();

 private:
  std::string out_;
};

[[nodiscard]] double legend_height(double x, double x1, const std::vector<LegendItem>& items);
// Grid, ticks and labels of a plot area with corners (x.p0, y.p1) and (x.p1, y.p0).
void draw_axes(Canvas& c, const Scale& x, const Scale& y, const std::string& x_label,
               const std::string& y_label);

}  // namespace plot
