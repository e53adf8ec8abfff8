#include "tools/report/canvas.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace plot {

const std::string& palette(std::size_t i) {
  static const std::array<std::string, 7> colours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                     "#b8860b", "#56b4e9", "#222222"};
  return colours[i % colours.size()];
}

std::string number(double v) {
  if (!std::isfinite(v)) return "-";
  char buffer[40];
  const double a = std::abs(v);
  if (a != 0 && (a >= 1e6 || a < 1e-4)) {
    std::snprintf(buffer, sizeof buffer, "%.3g", v);
  } else if (a >= 1000) {
    std::snprintf(buffer, sizeof buffer, "%.0f", v);
  } else {
    std::snprintf(buffer, sizeof buffer, "%.4g", v);
  }
  std::string out = buffer;
  // "1e+06" reads as "1e6".
  if (const auto e = out.find('e'); e != std::string::npos) {
    std::string exponent = out.substr(e + 1);
    const bool negative = exponent[0] == '-';
    exponent.erase(0, exponent.find_first_not_of("+-0"));
    out = out.substr(0, e) + "e" + (negative ? "-" : "") + exponent;
  }
  return out == "-0" ? "0" : out;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        // Control characters are not allowed in XML at all.
        out += static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t' ? '?' : c;
    }
  }
  return out;
}

std::vector<double> nice_ticks(double lo, double hi, int wanted) {
  std::vector<double> out;
  if (!(hi > lo) || wanted < 1 || !std::isfinite(hi - lo)) return out;
  const double raw = (hi - lo) / wanted;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double m : {1.0, 2.0, 5.0}) {
    if (m * power >= raw * 0.999) {
      step = m * power;
      break;
    }
  }
  // By index, so that no rounding adds up.
  for (double i = std::ceil(lo / step - 1e-9); i * step <= hi + step * 1e-9; ++i) {
    out.push_back(i == 0 ? 0.0 : i * step);
    if (out.size() > 200) break;
  }
  return out;
}

// ---- scale --------------------------------------------------------------------------------------

double Scale::px(double v) const {
  const double t =
      log ? (std::log(v) - std::log(lo)) / (std::log(hi) - std::log(lo)) : (v - lo) / (hi - lo);
  return p0 + t * (p1 - p0);
}

std::vector<double> Scale::ticks(int wanted) const {
  if (!log) return nice_ticks(lo, hi, wanted);
  std::vector<double> out;
  const double decades = std::log10(hi) - std::log10(lo);
  const int every = std::max(1, static_cast<int>(std::ceil(decades / (wanted * 1.5))));
  const int first = static_cast<int>(std::floor(std::log10(lo) + 1e-9));
  for (int e = first; std::pow(10.0, e) <= hi * 1.000001; ++e) {
    if ((e - first) % every != 0) continue;
    for (const double m : {1.0, 2.0, 5.0}) {
      if (m > 1 && decades > 2.5) continue;
      const double v = m * std::pow(10.0, e);
      if (v >= lo * 0.999999 && v <= hi * 1.000001) out.push_back(v);
    }
  }
  // Within less than a decade 1, 2 and 5 may leave an axis bare.
  if (out.size() < 3 && hi < 10 * lo) out = nice_ticks(lo, hi, wanted);
  return out;
}

Scale Scale::over(double lo, double hi, bool log) {
  Scale s;
  s.log = log;
  if (log) {
    if (!(lo > 0) || !std::isfinite(lo)) lo = 1;
    if (!(hi >= lo) || !std::isfinite(hi)) hi = lo;
    s.lo = hi > lo ? lo : lo / 2;
    s.hi = hi > lo ? hi : hi * 2;
    return s;
  }
  if (!std::isfinite(lo) || !std::isfinite(hi)) lo = 0, hi = 1;
  if (hi < lo) std::swap(lo, hi);
  if (hi == lo) {
    const double pad = lo == 0 ? 1 : std::abs(lo) * 0.1;
    lo -= pad, hi += pad;
  }
  const double pad = 0.04 * (hi - lo);
  // An axis that nearly begins at zero begins at zero.
  s.lo = lo >= 0 && lo < 0.35 * hi ? 0 : lo - pad;
  s.hi = hi <= 0 && hi > 0.35 * lo ? 0 : hi + pad;
  return s;
}

// ---- canvas -------------------------------------------------------------------------------------

namespace {

std::string f(double v) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.1f", std::isfinite(v) ? v : 0.0);
  std::string out = buffer;
  if (out.ends_with(".0")) out.resize(out.size() - 2);
  return out == "-0" ? "0" : out;
}

// Bytes of UTF-8 that begin a character, times a mean width.
double text_width(const std::string& s, double size) {
  const auto n = std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xc0) != 0x80; });
  return static_cast<double>(n) * size * 0.56;
}

constexpr double kLegendSize = 12, kLegendLine = 17, kSwatch = 22;

}  // namespace

Canvas::Canvas(double width, double height, const std::string& title) {
  out_ = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + f(width) + " " + f(height) +
         "\" width=\"" + f(width) + "\" height=\"" + f(height) +
         "\" font-family=\"system-ui, 'DejaVu Sans', sans-serif\" style=\"max-width:100%;"
         "height:auto;background:#fff\" role=\"img\">\n";
  if (!title.empty()) {
    out_ += "<title>" + escaped(title) + "</title>\n";
    out_ += "<text x=\"12\" y=\"20\" font-size=\"14\" font-weight=\"600\" fill=\"#222\">" +
            escaped(title) + "</text>\n";
  }
}

void Canvas::text(double x, double y, const std::string& s, const char* anchor, double size,
                  const char* colour, double rotate) {
  out_.append("<text x=\"").append(f(x)).append("\" y=\"").append(f(y));
  out_.append("\" font-size=\"").append(f(size)).append("\" fill=\"").append(escaped(colour));
  out_.append("\" text-anchor=\"").append(anchor).append("\"");
  if (rotate != 0) {
    out_.append(" transform=\"rotate(").append(f(rotate)).append(" ").append(f(x));
    out_.append(" ").append(f(y)).append(")\"");
  }
  out_.append(">").append(escaped(s)).append("</text>\n");
}

void Canvas::line(double x0, double y0, double x1, double y1, const std::string& colour,
                  double width, bool dashed) {
  out_ += "<line x1=\"" + f(x0) + "\" y1=\"" + f(y0) + "\" x2=\"" + f(x1) + "\" y2=\"" + f(y1) +
          "\" stroke=\"" + escaped(colour) + "\" stroke-width=\"" + f(width) + "\"" +
          (dashed ? " stroke-dasharray=\"5 4\"" : "") + "/>\n";
}

void Canvas::rect(double x, double y, double w, double h, const std::string& fill,
                  const std::string& stroke) {
  out_ += "<rect x=\"" + f(x) + "\" y=\"" + f(y) + "\" width=\"" + f(std::max(0.0, w)) +
          "\" height=\"" + f(std::max(0.0, h)) + "\" fill=\"" + escaped(fill) + "\" stroke=\"" +
          escaped(stroke) + "\"/>\n";
}

void Canvas::push_clip(double x, double y, double w, double h) {
  const std::string box = f(x) + " " + f(y) + " " + f(w) + " " + f(h);
  out_ += "<svg x=\"" + f(x) + "\" y=\"" + f(y) + "\" width=\"" + f(w) + "\" height=\"" + f(h) +
          "\" viewBox=\"" + box + "\" overflow=\"hidden\">\n";
}

namespace {
// Walks the places of legend items; `draw` may be empty.
template <class Draw>
double lay_legend(double x, double x1, const std::vector<LegendItem>& items, Draw&& draw) {
  double cx = x, cy = 0;
  bool any = false;
  for (const auto& item : items) {
    if (item.label.empty()) continue;
    const double w = kSwatch + 6 + text_width(item.label, kLegendSize) + 14;
    if (any && cx + w > x1) cx = x, cy += kLegendLine;
    draw(item, cx, cy);
    cx += w;
    any = true;
  }
  return any ? cy + kLegendLine : 0;
}
}  // namespace

double legend_height(double x, double x1, const std::vector<LegendItem>& items) {
  return lay_legend(x, x1, items, [](const LegendItem&, double, double) {});
}

double Canvas::legend(double x, double x1, double y, const std::vector<LegendItem>& items) {
  return lay_legend(x, x1, items, [&](const LegendItem& item, double dx, double dy) {
    const double my = y + dy + 8;
    const std::string colour = escaped(item.colour), mid = f(dx + kSwatch / 2), height = f(my);
    const auto circle = [&](const char* r, const std::string& paint) {
      raw(std::string("<circle cx=\"")
              .append(mid)
              .append("\" cy=\"")
              .append(height)
              .append("\" r=\"")
              .append(r)
              .append("\" ")
              .append(paint)
              .append("/>\n"));
    };
    switch (item.sign) {
      case LegendItem::Sign::kLine:
        line(dx, my, dx + kSwatch, my, item.colour, 2.5, item.dashed);
        break;
      case LegendItem::Sign::kDot:
        circle("4.5", "fill=\"" + colour + "\"");
        break;
      case LegendItem::Sign::kCircle:
        circle("4.5", "fill=\"none\" stroke-width=\"2\" stroke=\"" + colour + "\"");
        break;
      case LegendItem::Sign::kCross: {
        const double mx = dx + kSwatch / 2;
        line(mx - 4, my - 4, mx + 4, my + 4, item.colour, 2.2);
        line(mx - 4, my + 4, mx + 4, my - 4, item.colour, 2.2);
        break;
      }
    }
    text(dx + kSwatch + 6, y + dy + 12, item.label, "start", kLegendSize);
  });
}

std::string Canvas::finish() { return out_ + "</svg>\n"; }

void draw_axes(Canvas& c, const Scale& x, const Scale& y, const std::string& x_label,
               const std::string& y_label) {
  const double left = x.p0, right = x.p1, bottom = y.p0, top = y.p1;
  // Labels must not touch: about 70 px across, 36 px up.
  for (const double v : x.ticks(std::max(2, static_cast<int>((right - left) / 75)))) {
    c.line(x.px(v), top, x.px(v), bottom, "#e6e6e6", 1);
    c.text(x.px(v), bottom + 16, number(v), "middle", 11);
  }
  for (const double v : y.ticks(std::max(2, static_cast<int>((bottom - top) / 38)))) {
    c.line(left, y.px(v), right, y.px(v), "#e6e6e6", 1);
    c.text(left - 7, y.px(v) + 4, number(v), "end", 11);
  }
  c.line(left, bottom, right, bottom, "#666", 1);
  c.line(left, top, left, bottom, "#666", 1);
  if (!x_label.empty()) c.text((left + right) / 2, bottom + 36, x_label, "middle", 12);
  if (!y_label.empty()) c.text(left - 50, (top + bottom) / 2, y_label, "middle", 12, "#333", -90);
}

}  // namespace plot
