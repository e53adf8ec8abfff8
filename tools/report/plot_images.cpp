// Pictures with overlays, and top views.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "tools/report/canvas.hpp"
#include "tools/report/svg.hpp"

namespace plot {

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t w = 0;
    for (std::size_t k = 0; k < 3; ++k) w = w << 8U | (k < n ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k) {
      out += k <= n ? kDigits[w >> (18U - 6U * k) & 63U] : '=';
    }
  }
  return out;
}

namespace {

std::string encode(const Picture& p, bool flip_rows) {
  const auto c = static_cast<std::size_t>(p.channels);
  if (p.width <= 0 || p.height <= 0 || (p.channels != 1 && p.channels != 3) ||
      p.pixels.size() !=
          static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height) * c) {
    throw std::runtime_error("picture of " + std::to_string(p.width) + " x " +
                             std::to_string(p.height) + " x " + std::to_string(p.channels) +
                             " with " + std::to_string(p.pixels.size()) + " bytes");
  }
  cv::Mat m(p.height, p.width, p.channels == 3 ? CV_8UC3 : CV_8UC1);
  for (int v = 0; v < p.height; ++v) {
    const int from = flip_rows ? p.height - 1 - v : v;
    const std::uint8_t* row =
        p.pixels.data() + static_cast<std::size_t>(from) * static_cast<std::size_t>(p.width) * c;
    auto* out = m.ptr<std::uint8_t>(v);
    for (std::size_t u = 0; u < static_cast<std::size_t>(p.width); ++u) {
      // The encoder wants blue first.
      for (std::size_t k = 0; k < c; ++k) out[u * c + k] = row[u * c + (c - 1 - k)];
    }
  }
  std::vector<std::uint8_t> png;
  cv::imencode(".png", m, png, {cv::IMWRITE_PNG_COMPRESSION, 7});
  return "data:image/png;base64," + base64(png);
}

std::string one_decimal(double v) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.1f", std::isfinite(v) ? v : 0.0);
  return buffer;
}

struct View {
  double x0, y0, sx, sy;  // overlay units to canvas: x0 + sx x, y0 + sy y
  [[nodiscard]] double x(double v) const { return x0 + sx * v; }
  [[nodiscard]] double y(double v) const { return y0 + sy * v; }
};

void draw_lines(Canvas& c, const Overlay& o, const View& view, const std::string& style) {
  std::string points;
  int n = 0;
  const auto flush = [&] {
    if (n > 1) c.raw("<polyline points=\"" + points + "\" fill=\"none\" " + style + "/>\n");
    points.clear();
    n = 0;
  };
  double last_x = 0, last_y = 0;
  for (std::size_t i = 0; i < std::min(o.x.size(), o.y.size()); ++i) {
    if (!std::isfinite(o.x[i]) || !std::isfinite(o.y[i])) {
      flush();
      continue;
    }
    const double px = view.x(o.x[i]), py = view.y(o.y[i]);
    // A path sampled at 1 kHz needs no point every hundredth of a pixel.
    const bool end = i + 1 == std::min(o.x.size(), o.y.size());
    if (n > 0 && !end && std::hypot(px - last_x, py - last_y) < 0.7) continue;
    points += one_decimal(px) + "," + one_decimal(py) + " ";
    last_x = px, last_y = py;
    ++n;
  }
  flush();
}

void draw_arrow(Canvas& c, const Overlay& o, const View& view, const std::string& style) {
  if (o.x.size() < 2 || o.y.size() < 2) return;
  const double x0 = view.x(o.x[0]), y0 = view.y(o.y[0]);
  const double x1 = view.x(o.x[1]), y1 = view.y(o.y[1]);
  const double length = std::hypot(x1 - x0, y1 - y0);
  if (!(length > 0)) return;
  const double ux = (x1 - x0) / length, uy = (y1 - y0) / length, h = 4 + 2 * o.width_px;
  c.raw("<path d=\"M" + one_decimal(x0) + " " + one_decimal(y0) + "L" + one_decimal(x1) + " " +
        one_decimal(y1) + "M" + one_decimal(x1 - h * (ux - 0.5 * uy)) + " " +
        one_decimal(y1 - h * (uy + 0.5 * ux)) + "L" + one_decimal(x1) + " " + one_decimal(y1) +
        "L" + one_decimal(x1 - h * (ux + 0.5 * uy)) + " " + one_decimal(y1 - h * (uy - 0.5 * ux)) +
        "\" fill=\"none\" " + style + "/>\n");
}

// Points that repeat the last drawn one (marks of a stroke) are drawn once.
void draw_symbols(Canvas& c, const Overlay& o, const View& view, const std::string& style) {
  double last_x = -1e9, last_y = -1e9;
  for (std::size_t i = 0; i < std::min(o.x.size(), o.y.size()); ++i) {
    if (!std::isfinite(o.x[i]) || !std::isfinite(o.y[i])) continue;
    const double px = view.x(o.x[i]), py = view.y(o.y[i]), r = o.radius_px;
    if (std::hypot(px - last_x, py - last_y) < 0.5) continue;
    last_x = px, last_y = py;
    if (o.kind == Overlay::Kind::kCross) {
      c.raw("<path d=\"M" + one_decimal(px - r) + " " + one_decimal(py - r) + "L" +
            one_decimal(px + r) + " " + one_decimal(py + r) + "M" + one_decimal(px - r) + " " +
            one_decimal(py + r) + "L" + one_decimal(px + r) + " " + one_decimal(py - r) + "\" " +
            style + "/>\n");
    } else if (o.kind == Overlay::Kind::kDot) {
      c.raw("<circle cx=\"" + one_decimal(px) + "\" cy=\"" + one_decimal(py) + "\" r=\"" +
            one_decimal(r) + "\" fill=\"" + escaped(o.colour) +
            "\" stroke=\"#fff\" stroke-width=\"1\"/>\n");
    } else {
      c.raw("<circle cx=\"" + one_decimal(px) + "\" cy=\"" + one_decimal(py) + "\" r=\"" +
            one_decimal(r) + "\" fill=\"none\" " + style + "/>\n");
    }
  }
}

void draw_overlays(Canvas& c, std::span<const Overlay> overlays, const View& view) {
  for (const Overlay& o : overlays) {
    const std::string style = "stroke=\"" + escaped(o.colour) + "\" stroke-width=\"" +
                              one_decimal(o.width_px) +
                              "\" stroke-linejoin=\"round\" stroke-linecap=\"round\"" +
                              (o.dashed ? " stroke-dasharray=\"6 5\"" : "");
    switch (o.kind) {
      case Overlay::Kind::kPolyline:
        draw_lines(c, o, view, style);
        break;
      case Overlay::Kind::kArrow:
        draw_arrow(c, o, view, style);
        break;
      case Overlay::Kind::kCross:
      case Overlay::Kind::kDot:
      case Overlay::Kind::kCircle:
        draw_symbols(c, o, view, style);
        break;
    }
  }
}

std::vector<LegendItem> legend_of(std::span<const Overlay> overlays) {
  std::vector<LegendItem> items;
  for (const Overlay& o : overlays) {
    if (o.label.empty() || o.x.empty()) continue;
    using Sign = LegendItem::Sign;
    const Sign sign = o.kind == Overlay::Kind::kDot      ? Sign::kDot
                      : o.kind == Overlay::Kind::kCross  ? Sign::kCross
                      : o.kind == Overlay::Kind::kCircle ? Sign::kCircle
                                                         : Sign::kLine;
    items.push_back({o.label, o.colour, sign, o.dashed});
  }
  return items;
}

void draw_image(Canvas& c, const std::string& url, double x, double y, double w, double h,
                bool smooth) {
  c.raw("<image x=\"" + one_decimal(x) + "\" y=\"" + one_decimal(y) + "\" width=\"" +
        one_decimal(w) + "\" height=\"" + one_decimal(h) + "\" preserveAspectRatio=\"none\"" +
        (smooth ? "" : " style=\"image-rendering:pixelated\"") + " href=\"" + url + "\"/>\n");
}

}  // namespace

std::string png_data_url(const Picture& picture) { return encode(picture, false); }

std::string image_plot(const std::string& title, const Picture& picture,
                       std::span<const Overlay> overlays, int width_px) {
  const std::string url = encode(picture, false);
  const auto items = legend_of(overlays);
  const double w = width_px, scale = w / picture.width, h = picture.height * scale;
  const double head = title.empty() ? 0 : 30, legend = legend_height(8, w - 8, items);
  const double top = head + legend + (legend > 0 ? 4 : 0);
  Canvas c(w, top + h, title);
  c.legend(8, w - 8, head, items);
  draw_image(c, url, 0, top, w, h, scale < 1.5);
  c.push_clip(0, top, w, h);
  // Pixel centres are at integers.
  draw_overlays(c, overlays, {0.5 * scale, top + 0.5 * scale, scale, scale});
  c.pop_clip();
  return c.finish();
}

std::string map_plot(const MapAxes& axes, const Picture& picture,
                     std::span<const Overlay> overlays) {
  const std::string url = encode(picture, true);
  const auto items = legend_of(overlays);
  const double width_m = picture.width * axes.resolution_m;
  const double height_m = picture.height * axes.resolution_m;
  const double left = 68, right = axes.width_px - 18.0;
  // Metres are as long up as across; a tall map is drawn narrower rather than without end.
  double w = right - left, h = w * height_m / width_m;
  const double tallest = 1.1 * axes.width_px;
  if (h > tallest) w *= tallest / h, h = tallest;
  const double top = 30 + legend_height(left, right, items) + 6;
  Canvas c(axes.width_px, top + h + 46, axes.title);
  c.legend(left, right, 28, items);
  Scale x{axes.x0_m, axes.x0_m + width_m, left, left + w, false};
  Scale y{axes.y0_m, axes.y0_m + height_m, top + h, top, false};
  draw_axes(c, x, y, "x in m", "y in m");
  draw_image(c, url, left, top, w, h, false);
  c.push_clip(left, top, w, h);
  draw_overlays(c, overlays, {x.px(0), y.px(0), w / width_m, -h / height_m});
  c.pop_clip();
  return c.finish();
}

}  // namespace plot
