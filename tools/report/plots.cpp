// Line plots and histograms.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "tools/report/canvas.hpp"
#include "tools/report/svg.hpp"

namespace plot {

namespace {

constexpr double kLeft = 68, kRight = 18, kTop = 30, kBottom = 46;

struct Range {
  double lo = std::numeric_limits<double>::infinity(), hi = -lo;
  bool positive_only = false;
  void take(double v) {
    if (!std::isfinite(v) || (positive_only && v <= 0)) return;
    lo = std::min(lo, v);
    hi = std::max(hi, v);
  }
};

std::string pt(double x, double y) {
  char buffer[48];
  std::snprintf(buffer, sizeof buffer, "%.1f,%.1f ", x, y);
  return buffer;
}

bool drawable(const Figure& f, double x, double y) {
  return std::isfinite(x) && std::isfinite(y) && (!f.log_x || x > 0) && (!f.log_y || y > 0);
}

// One unbroken run of a line, thinned to first, lowest, highest and last of each pixel column.
class Run {
 public:
  void add(double x, double y) {
    const long column = std::lround(x);
    if (count_ > 0 && column == column_) {
      if (y < low_.second) low_ = {x, y};
      if (y > high_.second) high_ = {x, y};
      last_ = {x, y};
      ++count_;
      return;
    }
    flush();
    column_ = column;
    first_ = last_ = low_ = high_ = {x, y};
    count_ = 1;
  }
  void flush() {
    if (count_ == 0) return;
    put(first_);
    if (count_ > 1) {
      const bool low_first = low_.first <= high_.first;
      put(low_first ? low_ : high_);
      put(low_first ? high_ : low_);
      put(last_);
    }
    count_ = 0;
  }
  std::string points;
  int size = 0;
  double x_begin = 0, x_end = 0;

 private:
  void put(std::pair<double, double> p) {
    if (size > 0 && p == put_) return;
    if (size == 0) x_begin = p.first;
    x_end = p.first;
    put_ = p;
    points += pt(p.first, p.second);
    ++size;
  }
  long column_ = 0;
  int count_ = 0;
  std::pair<double, double> first_, last_, low_, high_, put_;
};

void draw_run(Canvas& c, Run& run, const Series& s, const std::string& colour, double base) {
  run.flush();
  if (run.size == 0) return;
  if (s.filled) {
    c.raw("<polygon points=\"" + pt(run.x_begin, base) + run.points + pt(run.x_end, base) +
          "\" fill=\"" + escaped(colour) + "\" fill-opacity=\"0.18\" stroke=\"none\"/>\n");
  }
  if (run.size == 1) {
    // A lone point would be an invisible line.
    const auto comma = run.points.find(',');
    c.raw("<circle cx=\"" + run.points.substr(0, comma) + "\" cy=\"" +
          run.points.substr(comma + 1, run.points.size() - comma - 2) + "\" r=\"1.5\" fill=\"" +
          escaped(colour) + "\"/>\n");
  } else {
    c.raw("<polyline points=\"" + run.points + "\" fill=\"none\" stroke=\"" + escaped(colour) +
          "\" stroke-width=\"1.5\" stroke-linejoin=\"round\"/>\n");
  }
  run = Run{};
}

void draw_series(Canvas& c, const Figure& f, const Series& s, const std::string& colour,
                 const Scale& x, const Scale& y) {
  const std::size_t n = std::min(s.x.size(), s.y.size());
  if (s.points) {
    for (std::size_t i = 0; i < n; ++i) {
      if (!drawable(f, s.x[i], s.y[i])) continue;
      char buffer[160];
      std::snprintf(
          buffer, sizeof buffer,
          "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2.5\" fill=\"%s\" fill-opacity=\"0.8\"/>\n",
          x.px(s.x[i]), y.px(s.y[i]), escaped(colour).c_str());
      c.raw(buffer);
    }
    return;
  }
  const double base = std::clamp(y.px(f.log_y ? y.lo : std::max(y.lo, 0.0)), y.p1, y.p0);
  Run run;
  for (std::size_t i = 0; i < n; ++i) {
    if (drawable(f, s.x[i], s.y[i])) {
      run.add(x.px(s.x[i]), y.px(s.y[i]));
    } else {
      draw_run(c, run, s, colour, base);
    }
  }
  draw_run(c, run, s, colour, base);
}

void draw_rules(Canvas& c, const std::vector<Rule>& rules, const Scale& x, const Scale& y) {
  int row = 0;
  for (const Rule& r : rules) {
    const Scale& axis = r.vertical ? x : y;
    if (!std::isfinite(r.at) || r.at < axis.lo || r.at > axis.hi || (axis.log && r.at <= 0))
      continue;
    const double p = axis.px(r.at);
    if (r.vertical) {
      c.line(p, y.p1, p, y.p0, r.colour, 1.2, true);
      // Labels of near rules stand under each other, on the side that has room.
      const bool left = p > (x.p0 + x.p1) * 0.6;
      c.text(left ? p - 4 : p + 4, y.p1 + 12 + 14 * (row++ % 4), r.label, left ? "end" : "start",
             11, r.colour.c_str());
    } else {
      c.line(x.p0, p, x.p1, p, r.colour, 1.2, true);
      c.text(x.p1 - 4, p - 4, r.label, "end", 11, r.colour.c_str());
    }
  }
}

// Names stand above their points; where one would lie on an earlier one it goes below, then farther
// off.
void draw_marks(Canvas& c, const Figure& f, const Scale& x, const Scale& y) {
  struct Box {
    double x0, y0, x1, y1;
  };
  std::vector<Box> taken;
  for (const Mark& m : f.marks) {
    if (!drawable(f, m.x, m.y)) continue;
    const double px = x.px(m.x), py = y.px(m.y);
    const double width = 6.0 * static_cast<double>(m.label.size());
    const bool left = px + width > x.p1;
    const double x0 = left ? px - width - 4 : px + 4;
    double base = py - 6;
    for (const double shift : {-6.0, 15.0, -19.0, 28.0, -32.0, 41.0}) {
      base = py + shift;
      const Box b{x0, base - 10, x0 + width, base + 2};
      const bool free = std::none_of(taken.begin(), taken.end(), [&](const Box& t) {
        return b.x0 < t.x1 && t.x0 < b.x1 && b.y0 < t.y1 && t.y0 < b.y1;
      });
      if (free && b.y0 > y.p1 && b.y1 < y.p0) break;
    }
    taken.push_back({x0, base - 10, x0 + width, base + 2});
    c.text(left ? px - 4 : px + 4, base, m.label, left ? "end" : "start", 10,
           m.ring ? "#b03a2e" : "#555");
    char buffer[160];
    std::snprintf(buffer, sizeof buffer,
                  "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%s\" fill=\"%s\" stroke=\"#b03a2e\" "
                  "stroke-width=\"%s\"/>\n",
                  px, py, m.ring ? "5" : "1", m.ring ? "none" : "#555", m.ring ? "2" : "0");
    c.raw(buffer);
  }
}

// Lays out title, legend and axes; the caller draws between push_clip and pop_clip.
struct Frame {
  Frame(const Figure& f, const std::vector<LegendItem>& items, Scale sx, Scale sy)
      : canvas(f.width_px, f.height_px, f.title), x(sx), y(sy) {
    const double right = f.width_px - kRight;
    double top = f.title.empty() ? 12 : kTop;
    top += legend_height(kLeft, right, items);
    x.p0 = kLeft, x.p1 = right;
    y.p0 = f.height_px - kBottom, y.p1 = std::min(top + 6, y.p0 - 20);
    canvas.legend(kLeft, right, f.title.empty() ? 8 : kTop - 2, items);
    draw_axes(canvas, x, y, f.x_label, f.y_label);
    canvas.push_clip(x.p0, y.p1 - 3, x.p1 - x.p0, y.p0 - y.p1 + 3);
  }
  Canvas canvas;
  Scale x, y;
};

}  // namespace

std::string line_plot(const Figure& f) {
  Range rx, ry;
  rx.positive_only = f.log_x;
  ry.positive_only = f.log_y;
  std::vector<LegendItem> items;
  for (std::size_t k = 0; k < f.series.size(); ++k) {
    const Series& s = f.series[k];
    const std::size_t n = std::min(s.x.size(), s.y.size());
    for (std::size_t i = 0; i < n; ++i) {
      if (!drawable(f, s.x[i], s.y[i])) continue;
      rx.take(s.x[i]);
      ry.take(s.y[i]);
    }
    items.push_back({s.name, s.colour.empty() ? palette(k) : s.colour,
                     s.points ? LegendItem::Sign::kDot : LegendItem::Sign::kLine, false});
  }
  for (const Mark& m : f.marks) {
    if (drawable(f, m.x, m.y)) rx.take(m.x), ry.take(m.y);
  }
  const bool empty = !(rx.hi >= rx.lo);
  for (const Rule& r : f.rules) (r.vertical ? rx : ry).take(r.at);
  Scale sx = Scale::over(rx.lo, rx.hi, f.log_x);
  if (!f.log_x && rx.hi > rx.lo) sx.lo = std::min(rx.lo, sx.lo == 0 ? 0 : rx.lo), sx.hi = rx.hi;
  Frame frame(f, items, sx, Scale::over(ry.lo, ry.hi, f.log_y));
  for (std::size_t k = 0; k < f.series.size(); ++k) {
    draw_series(frame.canvas, f, f.series[k], items[k].colour, frame.x, frame.y);
  }
  if (empty) {
    frame.canvas.text((frame.x.p0 + frame.x.p1) / 2, (frame.y.p0 + frame.y.p1) / 2, "no data",
                      "middle", 14, "#999");
  }
  draw_rules(frame.canvas, f.rules, frame.x, frame.y);
  draw_marks(frame.canvas, f, frame.x, frame.y);
  frame.canvas.pop_clip();
  return frame.canvas.finish();
}

namespace {

double upper(const Bins& b, std::size_t i) {
  if (i + 1 < b.lower.size()) return b.lower[i + 1];
  if (b.upper_end > b.lower[i]) return b.upper_end;
  return i > 0 ? 2 * b.lower[i] - b.lower[i - 1] : b.lower[i] + 1;
}

void draw_steps(Frame& frame, const Bins& b, const std::string& colour) {
  const double base = frame.y.p0;
  std::string steps;
  double first = 0, last = 0;
  bool any = false;
  for (std::size_t i = 0; i < std::min(b.lower.size(), b.count.size()); ++i) {
    const double lo = std::clamp(b.lower[i], frame.x.lo, frame.x.hi);
    const double hi = std::clamp(upper(b, i), frame.x.lo, frame.x.hi);
    if (!(hi > lo)) continue;
    const double y = b.count[i] > 0 ? std::min(base, frame.y.px(b.count[i])) : base;
    const double x0 = frame.x.px(lo), x1 = frame.x.px(hi);
    if (!any) first = x0;
    any = true;
    last = x1;
    steps += pt(x0, y) + pt(x1, y);
  }
  if (!any) return;
  steps = pt(first, base) + steps + pt(last, base);
  frame.canvas.raw("<polygon points=\"" + steps + "\" fill=\"" + escaped(colour) +
                   "\" fill-opacity=\"0.15\" stroke=\"" + escaped(colour) +
                   "\" stroke-width=\"1.5\" stroke-linejoin=\"round\"/>\n");
}

}  // namespace

std::string histogram(const Figure& axes, std::span<const Bins> bins) {
  Figure f = axes;
  Range rx, ry;
  rx.positive_only = f.log_x;
  std::vector<LegendItem> items;
  for (std::size_t k = 0; k < bins.size(); ++k) {
    const Bins& b = bins[k];
    for (std::size_t i = 0; i < std::min(b.lower.size(), b.count.size()); ++i) {
      if (!(b.count[i] > 0)) continue;
      rx.take(b.lower[i]);
      rx.take(upper(b, i));
      ry.take(b.count[i]);
    }
    items.push_back(
        {b.name, b.colour.empty() ? palette(k) : b.colour, LegendItem::Sign::kLine, false});
  }
  const bool empty = !(ry.hi > 0);
  for (const Rule& r : f.rules) {
    if (r.vertical) rx.take(r.at);
  }
  Scale sx = Scale::over(rx.lo, rx.hi, f.log_x);
  if (f.log_x) sx.lo /= 1.1, sx.hi *= 1.1;
  Scale sy = f.log_y ? Scale::over(0.5, std::max(2.0, ry.hi * 1.6), true)
                     : Scale::over(0, empty ? 1 : ry.hi, false);
  Frame frame(f, items, sx, sy);
  for (std::size_t k = 0; k < bins.size(); ++k) draw_steps(frame, bins[k], items[k].colour);
  if (empty) {
    frame.canvas.text((frame.x.p0 + frame.x.p1) / 2, (frame.y.p0 + frame.y.p1) / 2, "no data",
                      "middle", 14, "#999");
  }
  draw_rules(frame.canvas, f.rules, frame.x, frame.y);
  frame.canvas.pop_clip();
  return frame.canvas.finish();
}

}  // namespace plot
