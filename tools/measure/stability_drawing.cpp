#include "tools/measure/stability_drawing.hpp"

#include <algorithm>
#include <utility>

#include "tools/report/svg.hpp"

namespace teletact {

namespace {

constexpr int kWidth_px = 860, kPanel_px = 300;

StabilityTrace trace_of(const std::string& method, const stability::Run& run) {
  StabilityTrace out;
  out.method = method;
  for (const rig::Row& row : run.rows) {
    out.t.push_back(row.t - run.rows.front().t);
    out.force_N.push_back(row.f.norm());
    out.raw_N.push_back(row.f_raw.norm());
    out.x_mm.push_back(1e3 * row.p.x());
    out.z_mm.push_back(1e3 * row.p.z());
  }
  return out;
}

plot::Series series(std::string name, const std::vector<double>& x, const std::vector<double>& y,
                    std::string colour = "") {
  plot::Series s;
  s.name = std::move(name);
  s.x = x;
  s.y = y;
  s.colour = std::move(colour);
  return s;
}

// Dots: mostly it lies on the judged method's line.
plot::Series dots(std::string name, const std::vector<double>& x, const std::vector<double>& y) {
  constexpr std::size_t kDots = 80;
  plot::Series s;
  s.name = std::move(name);
  s.points = true;
  s.colour = "#009e73";
  const std::size_t every = std::max<std::size_t>(1, x.size() / kDots);
  for (std::size_t i = 0; i < x.size(); i += every) {
    s.x.push_back(x[i]);
    s.y.push_back(y[i]);
  }
  return s;
}

// What is drawn later lies above: the judged method last. Each keeps its colour in all panels.
const char* colour_of(const std::string& method) {
  if (method.starts_with("constrained")) return "#0072b2";
  if (method.starts_with("nearest10")) return "#56b4e9";
  if (method.starts_with("nearest")) return "#e69f00";
  return "#cc79a7";  // force_shading
}
constexpr const char *kHand = "#999999", *kRaw = "#d55e00";

// A figure into its place of the whole one.
std::string placed(const plot::Figure& figure, int y_px) {
  std::string text = plot::line_plot(figure);
  const std::string head = "<svg ";
  text.insert(text.find(head) + head.size(), "x=\"0\" y=\"" + std::to_string(y_px) + "\" ");
  return text;
}

}  // namespace

void StabilityDrawing::begin(const stability::Case& c, const std::string& method,
                             const stability::Run& run) {
  *this = {};
  title = "Case " + std::to_string(c.id) + ", " + c.name + ": " + run.name;
  traces.push_back(trace_of(method, run));
  for (const rig::Row& row : run.rows) {
    hand_t.push_back(row.t - run.rows.front().t);
    hand_x_mm.push_back(1e3 * row.h.x());
    hand_z_mm.push_back(1e3 * row.h.z());
  }
  for (const rig::Optimum& o : run.optimum) {
    optimum.t.push_back(hand_t[o.row]);
    optimum.force_N.push_back(o.f.norm());
    optimum.x_mm.push_back(1e3 * o.p.x());
    optimum.z_mm.push_back(1e3 * o.p.z());
  }
}

void StabilityDrawing::beside(const std::string& method, const stability::Run& run) {
  traces.push_back(trace_of(method, run));
}

std::string StabilityDrawing::svg() const {
  plot::Figure force, height, path;
  force.title = title;
  force.y_label = "force on the hand, N";
  height.title = "Height of the proxy";
  height.y_label = "z, mm";
  path.title = "Path of the proxy, from the side";
  path.x_label = "x, mm";
  path.y_label = "z, mm";
  force.x_label = height.x_label = "time, s";
  for (plot::Figure* f : {&force, &height, &path}) {
    f->width_px = kWidth_px;
    f->height_px = kPanel_px;
  }
  height.series.push_back(series("hand", hand_t, hand_z_mm, kHand));
  path.series.push_back(series("hand", hand_x_mm, hand_z_mm, kHand));
  for (std::size_t i = traces.size(); i-- > 0;) {
    const StabilityTrace& t = traces[i];
    const char* colour = colour_of(t.method);
    if (i == 0) {
      force.series.push_back(series(t.method + " before the guard", t.t, t.raw_N, kRaw));
    }
    force.series.push_back(series(t.method, t.t, t.force_N, colour));
    height.series.push_back(series(t.method, t.t, t.z_mm, colour));
    path.series.push_back(series(t.method, t.x_mm, t.z_mm, colour));
  }
  if (!optimum.t.empty()) {
    force.series.push_back(dots("field optimum", optimum.t, optimum.force_N));
    height.series.push_back(dots("field optimum", optimum.t, optimum.z_mm));
    path.series.push_back(dots("field optimum", optimum.x_mm, optimum.z_mm));
  }
  std::vector<plot::Figure*> panels{&force, &height};
  const auto [lo, hi] = std::minmax_element(hand_x_mm.begin(), hand_x_mm.end());
  if (lo != hand_x_mm.end() && *hi - *lo > 2) panels.push_back(&path);
  const auto height_px = static_cast<int>(panels.size()) * kPanel_px;
  const std::string w = std::to_string(kWidth_px), h = std::to_string(height_px);
  std::string out = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + w + " " + h +
                    "\" width=\"" + w + "\" height=\"" + h +
                    "\" style=\"max-width:100%;height:auto;background:#fff\" role=\"img\">\n";
  for (std::size_t i = 0; i < panels.size(); ++i) {
    out += placed(*panels[i], static_cast<int>(i) * kPanel_px);
  }
  return out + "</svg>\n";
}

}  // namespace teletact
