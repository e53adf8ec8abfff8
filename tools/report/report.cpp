#include "tools/report/report.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "perception/ground/cost_map.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/report/report_style.hpp"

namespace teletact {

namespace {

using perception::CostMap;
using plot::escaped;

std::string figure_number(double v, int digits = 4) {
  if (!std::isfinite(v)) return "–";
  char buffer[40];
  if (v != 0 && std::abs(v) < 1e-3) {
    std::snprintf(buffer, sizeof buffer, "%.2e", v);
  } else if (std::abs(v) >= 1000 || v == std::floor(v)) {
    std::snprintf(buffer, sizeof buffer, "%.0f", v);
  } else {
    std::snprintf(buffer, sizeof buffer, "%.*g", digits, v);
  }
  return buffer;
}

std::string us(double v) {
  char buffer[40];
  std::snprintf(buffer, sizeof buffer, std::abs(v) < 100 ? "%.1f" : "%.0f", v);
  return std::isfinite(v) ? buffer : "–";
}

// The name space is for files on their own; a page needs none, and then names no address at all.
std::string inlined(std::string svg) {
  static const std::string name_space = " xmlns=\"http://www.w3.org/2000/svg\"";
  if (const auto at = svg.find(name_space); at != std::string::npos)
    svg.erase(at, name_space.size());
  return "<figure>" + svg + "</figure>\n";
}

std::string heading(const char* id, const char* text) {
  return std::string("<h2 id=\"") + id + "\">" + text + "</h2>\n";
}

std::string pairs_table(const std::vector<std::pair<std::string, std::string>>& rows) {
  std::string out = "<table class=\"pairs\">\n";
  for (const auto& [name, value] : rows) {
    out += "<tr><th>" + escaped(name) + "</th><td>" + escaped(value) + "</td></tr>\n";
  }
  return out + "</table>\n";
}

void verdicts(const ReportData& d, std::string& out) {
  if (d.verdicts.empty()) return;
  out += heading("verdict", "Verdict") + "<ul class=\"verdicts\">\n";
  for (const auto& v : d.verdicts) {
    const char* name = v.state == ReportVerdict::State::kGood   ? "good"
                       : v.state == ReportVerdict::State::kNote ? "note"
                                                                : "bad";
    const char* sign = v.state == ReportVerdict::State::kGood   ? "✓"
                       : v.state == ReportVerdict::State::kNote ? "!"
                                                                : "✗";
    out += std::string("<li class=\"") + name + "\"><b>" + sign + "</b> " + escaped(v.text) +
           "</li>\n";
  }
  out += "</ul>\n";
}

std::string count_cell(std::uint64_t n, bool bad = false) {
  const std::string text = n == 0 ? "<span class=\"zero\">0</span>" : std::to_string(n);
  return std::string(bad && n > 0 ? "<td class=\"alarm\">" : "<td>") + text + "</td>";
}

std::string allocations_cell(const ReportTask& t) {
  if (t.allocations_max < 0) return "<td>–</td>";
  const std::string text =
      figure_number(t.allocations_p50) + " / " + figure_number(t.allocations_max);
  return (t.task_class == "hard" && t.allocations_max > 0 ? "<td class=\"alarm\">" : "<td>") +
         text + "</td>";
}

void task_table(const ReportData& d, std::string& out) {
  out +=
      "<div class=\"wide\"><table class=\"numbers\">\n<caption>What was promised, and what came "
      "of it</caption>\n<thead><tr><th>task</th><th class=\"t\">box</th><th "
      "class=\"t\">class</th><th>Hz</th><th>core"
      "</th><th>prio</th><th class=\"t\">policy</th><th class=\"t\">level</th><th>budget "
      "µs</th><th>R µs</th>"
      "<th>releases</th><th>completed</th><th>skipped</th><th>aborted</th><th>allocations</th></tr>"
      "</thead>\n";
  for (const auto& t : d.tasks) {
    out += "<tr><th>" + escaped(t.name) + "</th><td class=\"t\">" + escaped(t.box) +
           "</td><td class=\"t\">" + escaped(t.task_class) + "</td><td>" +
           figure_number(t.rate_hz) + "</td><td>" + std::to_string(t.core) + "</td><td>" +
           std::to_string(t.priority) + "</td><td class=\"t\">" + escaped(t.policy) +
           "</td><td class=\"t\">" + escaped(t.level) + "</td><td>" + us(t.budget_us) +
           "</td><td>" + (t.analysis_response_us > 0 ? us(t.analysis_response_us) : "–") + "</td>" +
           count_cell(t.releases) + count_cell(t.completed) + count_cell(t.skipped, true) +
           count_cell(t.aborted, true) + allocations_cell(t) + "</tr>\n";
  }
  out +=
      "</table></div>\n<p class=\"hint\">R is the worst response that the admission computed; "
      "releases = completed + skipped + aborted; allocations: of the heap, in one job, median and "
      "most. A hard task makes none, "
      "in a firm one they are its libraries'.</p>\n";
  out +=
      "<div class=\"wide\"><table class=\"numbers\">\n<caption>Misses, and whose fault they were"
      "</caption>\n<thead><tr><th>task</th><th>misses</th><th>own</th><th>queued</th>"
      "<th>carried</th><th>charged</th><th>platform</th><th>unknown</th></tr></thead>\n";
  for (const auto& t : d.tasks) {
    out += "<tr><th>" + escaped(t.name) + "</th>" + count_cell(t.misses) + count_cell(t.own, true) +
           count_cell(t.queued) + count_cell(t.carried) + count_cell(t.charged) +
           count_cell(t.platform) + count_cell(t.unknown) + "</tr>\n";
  }
  out +=
      "</table></div>\n<p class=\"hint\">own: over its budget with more work than calibrated. "
      "queued: behind tasks of higher priority. carried: behind its own late predecessor. "
      "charged: over budget in CPU for no more work (caches, interrupts on its account). "
      "platform: the sentinel of its core was late too.</p>\n";
}

void quantile_table(const ReportData& d, std::string& out) {
  out +=
      "<div class=\"wide\"><table class=\"numbers\">\n<caption>Microseconds a job</caption>\n"
      "<thead><tr><th rowspan=\"2\">task</th><th colspan=\"4\">CPU</th><th colspan=\"4\">lateness "
      "of the start</th><th colspan=\"4\">response</th><th colspan=\"4\">slack</th></tr>\n<tr>";
  for (int i = 0; i < 3; ++i)
    out += "<th class=\"first\">p50</th><th>p99</th><th>p99.9</th><th>max</th>";
  out += "<th class=\"first\">p50</th><th>p1</th><th>p0.1</th><th>least</th>";
  out += "</tr></thead>\n";
  for (const auto& t : d.tasks) {
    out += "<tr><th>" + escaped(t.name) + "</th>";
    for (const auto* q : {&t.cpu_us, &t.lateness_us, &t.response_us}) {
      out += "<td class=\"first\">" + us(q->p50) + "</td><td>" + us(q->p99) + "</td><td>" +
             us(q->p999) + "</td><td>" + us(q->max) + "</td>";
    }
    out += "<td class=\"first\">" + us(t.slack_us.p50) + "</td><td>" + us(t.slack_us.p1) +
           "</td><td>" + us(t.slack_us.p01) + "</td><td>" + us(t.slack_us.least) + "</td></tr>\n";
  }
  out +=
      "</table></div>\n<p class=\"hint\">Response: end - release. Slack: deadline - end; below 0 "
      "the job was late.</p>\n";
}

// Folded: a person looks at them when a task is in question. Where there is nothing else they lie
// open.
void task_charts(const ReportTask& t, bool open, std::string& out) {
  std::string charts;
  const auto chart = [&](const char* of, const char* x_label, const std::vector<plot::Bins>& bins,
                         std::vector<plot::Rule> rules = {}) {
    if (bins.empty()) return;
    plot::Figure f;
    f.log_x = f.log_y = true;
    f.width_px = 540;
    f.height_px = 250;
    f.y_label = "jobs";
    f.title = t.name + ": " + of;
    f.x_label = x_label;
    f.rules = std::move(rules);
    charts += inlined(plot::histogram(f, bins));
  };
  const auto at = [](double us, const char* name) {
    return us > 0 ? std::vector<plot::Rule>{{us, true, name, "#b03a2e"}}
                  : std::vector<plot::Rule>{};
  };
  chart("CPU of a job", "µs", t.cpu_histogram, at(t.budget_us, "budget"));
  chart("lateness of the start", "µs after the release", t.lateness_histogram);
  chart("response of a job", "µs from the release to the end", t.response_histogram,
        at(t.analysis_response_us, "R"));
  chart("slack of a job", "µs from the end to the deadline", t.slack_histogram);
  if (charts.empty()) return;
  out += std::string(open ? "<details open>" : "<details>") + "<summary>" + escaped(t.name) +
         ": charts</summary>\n<div class=\"grid\">\n" + charts + "</div></details>\n";
}

void timing(const ReportData& d, std::string& out) {
  if (d.tasks.empty()) return;
  out += heading("timing", "Timing");
  task_table(d, out);
  quantile_table(d, out);
  for (const auto& t : d.tasks) task_charts(t, d.timing_only, out);
  if (!d.choices.empty() || !d.steps.empty()) {
    out += "<p>What was admitted, and why:</p>\n<ul>\n";
    for (const auto* lines : {&d.choices, &d.steps}) {
      for (const auto& line : *lines) out += "<li>" + escaped(line) + "</li>\n";
    }
    out += "</ul>\n";
  }
  if (!d.admission.empty()) {
    out +=
        "<details><summary>Admission</summary><pre>" + escaped(d.admission) + "</pre></details>\n";
  }
  if (!d.calibration.empty()) {
    out += "<p class=\"hint\">Calibration: " + escaped(d.calibration) + "</p>\n";
  }
}

void touch(const ReportData& d, std::string& out) {
  if (d.touch.t_s.empty()) return;
  out += heading("touch", "Touch");
  plot::Figure f;
  f.width_px = 1080;
  f.height_px = 240;
  f.x_label = "s";
  f.title = "Force on the hand";
  f.y_label = "N";
  f.series = {{"", d.touch.t_s, d.touch.force_N, "", false, true}};
  out += inlined(plot::line_plot(f));
  f.title = "Penetration: from the proxy on the surface to the hand";
  f.y_label = "mm";
  f.series = {{"", d.touch.t_s, d.touch.penetration_mm, "#d55e00", false, true}};
  out += inlined(plot::line_plot(f));
}

struct CellColour {
  std::uint8_t r, g, b;
};
CellColour cell_colour(std::uint8_t cost) {
  if (cost == CostMap::kUnknown) return {205, 208, 214};
  if (cost == CostMap::kOccupied) return {58, 58, 66};
  if (cost == CostMap::kInscribed) return {226, 158, 104};
  if (cost == CostMap::kFree) return {255, 255, 255};
  const double t = cost / 252.0;
  return {255, static_cast<std::uint8_t>(252 - 52 * t), static_cast<std::uint8_t>(240 - 90 * t)};
}

// Something moves there: the older its last sight, the paler.
constexpr double kPale_s = 3;
CellColour moving_colour(double age_s) {
  const double t = std::clamp(age_s / kPale_s, 0.0, 1.0);
  const auto mixed = [t](double now, double then) {
    return static_cast<std::uint8_t>(now + t * (then - now));
  };
  return {mixed(123, 214), mixed(31, 178), mixed(162, 224)};
}

bool has_cells(const ReportMap& m) {
  const auto cells = static_cast<std::size_t>(std::max(0, m.width)) *
                     static_cast<std::size_t>(std::max(0, m.height));
  return cells > 0 && m.cost.size() >= cells;
}

void ground_map(const ReportMap& m, const std::string& title, std::string& out) {
  const auto cells = static_cast<std::size_t>(m.width) * static_cast<std::size_t>(m.height);
  plot::Picture picture;
  picture.width = m.width;
  picture.height = m.height;
  picture.pixels.reserve(3 * cells);
  for (std::size_t i = 0; i < cells; ++i) {
    const CellColour c = cell_colour(m.cost[i]);
    picture.pixels.insert(picture.pixels.end(), {c.r, c.g, c.b});
  }
  for (const auto& moving : m.moving) {
    if (moving.cell >= cells) continue;
    const CellColour c = moving_colour(moving.age_s);
    const std::uint8_t rgb[] = {c.r, c.g, c.b};
    std::copy_n(rgb, 3, picture.pixels.begin() + static_cast<std::ptrdiff_t>(3 * moving.cell));
  }
  using Kind = plot::Overlay::Kind;
  std::vector<plot::Overlay> overlays;
  if (!m.truth.x_m.empty()) {
    overlays.push_back({Kind::kPolyline, m.truth.x_m, m.truth.y_m, "#8a8f98",
                        m.truth.label.empty() ? "true path" : m.truth.label, 5, 5, false});
  }
  if (!m.driven.x_m.empty()) {
    overlays.push_back({Kind::kPolyline, m.driven.x_m, m.driven.y_m, "#2ca02c",
                        m.driven.label.empty() ? "driven (odometry)" : m.driven.label, 2, 5,
                        false});
    overlays.push_back({Kind::kDot,
                        {m.driven.x_m.front()},
                        {m.driven.y_m.front()},
                        "#2ca02c",
                        "start",
                        2,
                        5,
                        false});
  }
  for (std::size_t i = 0; i < m.planned.size(); ++i) {
    // One entry of the legend for all paths.
    overlays.push_back({Kind::kPolyline, m.planned[i].x_m, m.planned[i].y_m, "#0072b2",
                        i == 0 ? "planned" : "", 2, 5, true});
  }
  overlays.push_back({Kind::kCircle, m.goal_x_m, m.goal_y_m, "#0072b2", "goal", 2.5, 7, false});
  overlays.push_back({Kind::kCross, m.mark_x_m, m.mark_y_m, "#d81b60", "mark", 2.5, 6, false});
  const plot::MapAxes axes{title, m.x0_m, m.y0_m, m.resolution_m, 820};
  out += inlined(plot::map_plot(axes, picture, overlays));
}

void ground(const ReportData& d, std::string& out) {
  if (!has_cells(d.map)) return;
  out += heading("ground", "Ground");
  ground_map(d.map, "The robot over the cost map", out);
  const bool moved = has_cells(d.moving_map);
  if (moved) {
    char title[80];
    std::snprintf(title, sizeof title, "What moved, when most of it did: at %.1f s",
                  d.moving_map_at_s);
    ground_map(d.moving_map, title, out);
  }
  out += "<p class=\"cells\">";
  const std::pair<std::uint8_t, const char*> legend[] = {
      {CostMap::kFree, "free"},
      {160, "near an obstacle"},
      {CostMap::kInscribed, "too near for the base"},
      {CostMap::kOccupied, "obstacle"},
      {CostMap::kUnknown, "not seen"}};
  const auto entry = [&out](const CellColour& c, const char* name) {
    out += "<span><i style=\"background:rgb(" + std::to_string(c.r) + "," + std::to_string(c.g) +
           "," + std::to_string(c.b) + ")\"></i>" + name + "</span> ";
  };
  for (const auto& [cost, name] : legend) entry(cell_colour(cost), name);
  if (moved) {
    entry(moving_colour(0), "moves");
    entry(moving_colour(kPale_s / 2), "moved 1.5 s ago");
    entry(moving_colour(kPale_s), "moved 3 s ago or more");
  }
  out += "</p>\n";
}

void pictures(const ReportData& d, std::string& out) {
  if (d.pictures.empty()) return;
  out += heading("pictures", "Pictures") + "<div class=\"grid\">\n";
  for (const auto& p : d.pictures) {
    const int width = std::clamp(p.image.width, 480, 820);
    std::string svg = inlined(plot::image_plot(p.title, p.image, p.overlays, width));
    if (!p.caption.empty()) {
      svg.insert(svg.rfind("</figure>"), "<figcaption>" + escaped(p.caption) + "</figcaption>");
    }
    out += svg;
  }
  out += "</div>\n";
}

void effects_and_faults(const ReportData& d, std::string& out) {
  if (d.timing_only) return;
  out += heading("effects", "Effects");
  if (d.effects.empty()) {
    out += "<p>None: the scene calls for no effect, so none was constructed.</p>\n";
  } else {
    out += "<p>Constructed because the scene calls for them; nothing else was.</p>\n" +
           pairs_table(d.effects);
  }
  out += heading("faults", "Faults");
  if (d.faults.empty()) {
    out += "<p>None.</p>\n";
    return;
  }
  out += "<table class=\"numbers\">\n<thead><tr><th>fault</th><th>times</th></tr></thead>\n";
  for (const auto& [name, count] : d.faults) {
    out += "<tr><th>" + escaped(name) + "</th>" + count_cell(count) + "</tr>\n";
  }
  out += "</table>\n";
}

void run_facts(const ReportData& d, std::string& out) {
  out += heading("run", "Run");
  std::vector<std::pair<std::string, std::string>> rows{
      {"command", d.command}, {"version", d.version}, {"started", d.started}};
  rows.insert(rows.end(), d.host.begin(), d.host.end());
  for (const auto& [name, value] : d.seeds) rows.emplace_back("seed " + name, value);
  for (const auto& file : d.files) rows.emplace_back("file", file);
  std::erase_if(rows, [](const auto& r) { return r.second.empty(); });
  out += pairs_table(rows);
  if (!d.metrics.rows().empty()) {
    out +=
        "<details><summary>All metrics</summary>\n<table class=\"numbers\">\n<thead><tr>"
        "<th>name</th><th>value</th><th>unit</th></tr></thead>\n";
    for (const auto& m : d.metrics.rows()) {
      out += "<tr><th>" + escaped(m.name) + "</th><td>" +
             (m.is_text ? escaped(m.text) : figure_number(m.value, 6)) + "</td><td>" +
             escaped(m.unit) + "</td></tr>\n";
    }
    out += "</table></details>\n";
  }
  if (!d.config_toml.empty()) {
    out += "<details><summary>Effective configuration</summary><pre>" + escaped(d.config_toml) +
           "</pre></details>\n";
  }
}

}  // namespace

std::string report_html(const ReportData& d) {
  std::string body;
  // What a person looks for comes first: did it work, what did it see, what was felt. Timing is for
  // when it did not.
  verdicts(d, body);
  pictures(d, body);
  touch(d, body);
  ground(d, body);
  timing(d, body);
  effects_and_faults(d, body);
  run_facts(d, body);
  // The list of contents is what came out.
  std::string nav;
  for (std::size_t at = body.find("<h2 id=\""); at != std::string::npos;
       at = body.find("<h2 id=\"", at + 1)) {
    const std::size_t id = at + 8, id_end = body.find('"', id), text = id_end + 2;
    nav += "<a href=\"#" + body.substr(id, id_end - id) + "\">" +
           body.substr(text, body.find('<', text) - text) + "</a> ";
  }
  return "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>" +
         escaped(d.title) +
         "</title>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
         "<style>\n" +
         std::string(kReportStyle) + "</style>\n</head>\n<body>\n<header><h1>" + escaped(d.title) +
         "</h1>\n<p>" + escaped(d.started) +
         (d.version.empty() ? "" : " · version " + escaped(d.version)) + "</p>\n<nav>" + nav +
         "</nav></header>\n<main>\n" + body + "</main>\n</body>\n</html>\n";
}

void write_report(const std::string& folder, const ReportData& data) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder + ": can not be made: " + error.message());
  write_whole_file(folder + "/report.html", report_html(data));
  write_whole_file(folder + "/report.json", report_json(data));
}

}  // namespace teletact
