#include "tools/report/report.hpp"
#include "rt/quantile.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "rt/random.hpp"
#include "tests/support/xml_check.hpp"
#include "tools/files/whole_file.hpp"

namespace {

using teletact::Metrics;
using teletact::ReportData;
using testing::HasSubstr;
namespace fs = std::filesystem;

const std::set<std::string> kVoid = {"meta", "br", "img"};

// Shaped like a run: log-normal CPU, late sentinel tail, presses, a drive round a box.
ReportData sample() {
  ReportData d;
  rt::Random r(12);
  d.title = "teletact demo";
  d.version = "0.1.0";
  d.command = "teletact demo --seconds 20";
  d.started = "2025-01-01T12:00:00Z";
  d.host = {{"host", "bench"}, {"CPU", "a <fast> one & more"}, {"kernel", "Linux 6.1"}};
  d.seeds = {{"run", "42"}, {"faults", "7"}};
  using State = teletact::ReportVerdict::State;
  d.verdicts = {{State::kGood, "haptic: 20000 releases, 0 misses of its own"},
                {State::kNote, "not real-time: no privilege for SCHED_FIFO"},
                {State::kBad, "robot: 1 collision"}};
  d.config_toml = "[haptic]\nstiffness_N_per_m = 1000.0 # < 14500\n";
  d.admission = "core 0: U = 0.61\n  haptic R = 112 us <= 1000 us\n";
  d.calibration = "calibration.json of this host";
  const struct {
    const char* name;
    const char* box;
    double hz, cpu, budget;
  } rows[] = {{"haptic", "operator", 1000, 22, 100},
              {"fusion", "operator", 30, 14000, 25000},
              {"planning", "operator", 10, 900, 50000},
              {"robot_io", "robot", 1000, 12, 100}};
  for (const auto& row : rows) {
    teletact::ReportTask t;
    t.name = row.name;
    t.box = row.box;
    t.task_class = "hard";
    t.policy = "skip";
    t.level = "full";
    t.rate_hz = row.hz;
    t.budget_us = row.budget;
    t.analysis_response_us = row.budget * 1.3;
    t.releases = static_cast<std::uint64_t>(20 * row.hz);
    t.skipped = t.misses = t.platform = 3;
    t.completed = t.releases - 3;
    t.priority = 90;
    plot::Bins cpu, late, sentinel;
    cpu.name = "CPU";
    late.name = "task";
    sentinel.name = "sentinel";
    for (double e = 1; e < 1e5; e *= std::sqrt(2.0)) {
      for (auto* b : {&cpu, &late, &sentinel}) b->lower.push_back(e), b->count.push_back(0);
    }
    const auto put = [](plot::Bins& b, double v) {
      for (std::size_t i = b.lower.size(); i-- > 0;) {
        if (b.lower[i] <= v) {
          ++b.count[i];
          return;
        }
      }
    };
    std::vector<double> values;
    for (std::uint64_t i = 0; i < t.completed; ++i) {
      const double v = row.cpu * std::exp(0.25 * r.normal());
      values.push_back(v);
      put(cpu, v);
      const double l = 6 * std::exp(0.5 * r.normal()) + (r.uniform() < 0.002 ? 300 : 0);
      put(late, l + 2);
      put(sentinel, l);
    }
    std::sort(values.begin(), values.end());
    const auto q = [&](double p) { return rt::quantile_of_sorted(std::span(values), p); };
    t.cpu_us = {q(0.5), q(0.99), q(0.999), values.back()};
    t.lateness_us = {8, 21, 310, 420};
    t.response_us = {row.cpu + 8, row.cpu * 1.8, row.cpu * 2.2, row.cpu * 2.5};
    t.slack_us = {400, 310, 120, -35.5};
    t.cpu_histogram = {cpu};
    t.response_histogram = {cpu};
    t.slack_histogram = {late, sentinel};
    t.lateness_histogram = {late, sentinel};
    d.tasks.push_back(t);
  }
  for (int i = 0; i < 20000; ++i) {
    const double t = i * 1e-3, press = std::max(0.0, std::sin(t * 1.3)) * 4;
    d.touch.t_s.push_back(t);
    d.touch.force_N.push_back(press > 0.2 ? press + 0.05 * r.normal() : 0);
    d.touch.penetration_mm.push_back(press > 0.2 ? press : 0);
  }
  auto& m = d.map;
  m.width = 140, m.height = 110;
  m.x0_m = -3.5, m.y0_m = -2.5;
  m.cost.assign(140 * 110, 255);
  const auto cell = [&](int x, int y) -> std::uint8_t& {
    return m.cost[static_cast<std::size_t>(y * 140 + x)];
  };
  for (int y = 10; y < 100; ++y) {
    for (int x = 10; x < 130; ++x) {
      const double dx = std::max({60 - x, x - 75, 0}), dy = std::max({40 - y, y - 70, 0});
      const double dist = std::hypot(dx, dy);
      cell(x, y) = dist == 0   ? 254
                   : dist < 6  ? 253
                   : dist < 14 ? static_cast<std::uint8_t>(252 * (14 - dist) / 8)
                               : 0;
    }
  }
  teletact::ReportMap::Line path;
  for (int i = 0; i <= 100; ++i) {
    const double a = 3.1 - i * 0.031;
    path.x_m.push_back(1.6 * std::cos(a));
    path.y_m.push_back(0.2 + 1.5 * std::sin(a));
  }
  m.planned = {path};
  m.driven = path;
  for (auto& v : m.driven.y_m) v += 0.012;
  m.truth = path;
  for (auto& v : m.truth.y_m) v -= 0.01;
  m.mark_x_m = {1.9}, m.mark_y_m = {0.1};
  m.goal_x_m = {path.x_m.back()}, m.goal_y_m = {path.y_m.back()};
  teletact::ReportPicture p;
  p.title = "The map from the last camera pose";
  p.caption = "Shaded surface; circle: proxy, cross: mark";
  p.image.width = 512, p.image.height = 424;
  for (int v = 0; v < 424; ++v) {
    for (int u = 0; u < 512; ++u) {
      const double s = 0.5 + 0.5 * std::sin(u * 0.02) * std::cos(v * 0.03);
      for (int c = 0; c < 3; ++c)
        p.image.pixels.push_back(static_cast<std::uint8_t>(60 + 150 * s + 10 * c));
    }
  }
  using Kind = plot::Overlay::Kind;
  p.overlays = {
      {Kind::kCircle, {250}, {200}, "#e6007e", "proxy", 2, 8, false},
      {Kind::kCross, {300}, {220}, "#d81b60", "mark", 2.5, 6, false},
      {Kind::kPolyline, {100, 200, 300}, {400, 300, 320}, "#0072b2", "robot", 2, 5, false}};
  d.pictures = {p, p};
  d.effects = {{"camera noise", "camera.noise"}, {"network delay", "link.delay_ms"}};
  d.faults = {{"F-HAP-02 patch stale", 2}};
  d.files = {"trace.json"};
  d.metrics.add("haptic.releases", 20000, "1");
  d.metrics.add("run.sched_hash", "0123456789abcdef", "hash");
  d.metrics.add("fusion.ate_first_pose_mm", std::nan(""), "mm");
  return d;
}

// Anything that would make a browser ask somebody else.
void expect_self_contained(const std::string& html) {
  for (const char* bad :
       {"http:", "https:", "//", "<script", "<link", "@import", "src=\"/", "url("}) {
    std::string text = html;
    // Base64 may hold "//".
    for (std::size_t i; (i = text.find("base64,")) != std::string::npos;) {
      text.erase(i, text.find('"', i) - i);
    }
    EXPECT_EQ(text.find(bad), std::string::npos) << bad;
  }
  for (std::size_t i = html.find("href=\""); i != std::string::npos;
       i = html.find("href=\"", i + 1)) {
    const char first = html[i + 6];
    EXPECT_TRUE(first == '#' || html.compare(i + 6, 10, "data:image") == 0) << html.substr(i, 60);
  }
}

TEST(Report, HtmlIsSelfContainedAndWellFormed) {
  const std::string html = teletact::report_html(sample());
  EXPECT_EQ(support::xml_problem(html, kVoid), "");
  expect_self_contained(html);
  EXPECT_THAT(html, HasSubstr("a &lt;fast&gt; one &amp; more"));
  EXPECT_THAT(html, HasSubstr("haptic: CPU of a job"));
  EXPECT_THAT(html, HasSubstr("haptic: response of a job"));
  EXPECT_THAT(html, HasSubstr("haptic: slack of a job"));
  EXPECT_THAT(html, HasSubstr("-35.5"));
  EXPECT_THAT(html, HasSubstr("Force on the hand"));
  EXPECT_THAT(html, HasSubstr("camera.noise"));
  EXPECT_THAT(html, HasSubstr("F-HAP-02"));
  EXPECT_LT(html.size(), 3000000U);
  if (const char* keep = std::getenv("TELETACT_KEEP_REPORT"))
    teletact::write_report(keep, sample());
}

// The sections in the order of the page, and where a text stands in it.
TEST(Report, WhatAPersonLooksForComesFirstAndChartsAreFolded) {
  const std::string html = teletact::report_html(sample());
  std::vector<std::string> order;
  for (std::size_t at = html.find("<h2 id=\""); at != std::string::npos;
       at = html.find("<h2 id=\"", at + 1))
    order.push_back(html.substr(at + 8, html.find('"', at + 8) - at - 8));
  EXPECT_THAT(order, testing::ElementsAre("verdict", "pictures", "touch", "ground", "timing",
                                          "effects", "faults", "run"));
  // Every chart of a task lies within a fold that is closed, one a task.
  const std::string timing = html.substr(html.find("<h2 id=\"timing\""));
  EXPECT_EQ(timing.find("<details open"), std::string::npos);
  int folds = 0;
  std::size_t outside = 0;
  for (std::size_t at = timing.find("<figure>"); at != std::string::npos;
       at = timing.find("<figure>", at + 1)) {
    const std::size_t open = timing.rfind("<details>", at), end = timing.rfind("</details>", at);
    outside += open == std::string::npos || (end != std::string::npos && end > open) ? 1 : 0;
  }
  for (const auto& t : sample().tasks) {
    const std::string fold = "<details><summary>" + t.name + ": charts</summary>";
    folds += timing.find(fold) != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(outside, 0U);
  EXPECT_EQ(folds, 4);
}

TEST(Report, AllocationsOfAJobStandInTheTableAndAHardTasksAreAnAlarm) {
  ReportData d = sample();
  EXPECT_EQ(teletact::report_html(d).find(" / 755"), std::string::npos) << "none counted";
  d.tasks[2].task_class = "firm";
  d.tasks[2].allocations_p50 = 0;
  d.tasks[2].allocations_max = 755;
  d.tasks[1].allocations_p50 = d.tasks[1].allocations_max = 0;
  const std::string html = teletact::report_html(d);
  EXPECT_THAT(html, HasSubstr("<td>0 / 755</td>"));
  EXPECT_THAT(html, HasSubstr("<td>0 / 0</td>"));
  d.tasks[1].allocations_max = 2;
  EXPECT_THAT(teletact::report_html(d), HasSubstr("<td class=\"alarm\">0 / 2</td>"));
  const auto j = nlohmann::json::parse(teletact::report_json(d));
  EXPECT_FALSE(j["tasks"][0].contains("allocations"));
  EXPECT_EQ(j["tasks"][2]["allocations"]["max"], 755);
}

TEST(Report, ScriptInDataStaysText) {
  ReportData d = sample();
  const std::string evil = "</pre><script>alert(1)</script>\"'&\x01";
  d.title = d.command = d.config_toml = d.admission = d.version = d.started = d.calibration = evil;
  d.verdicts[0].text = d.tasks[0].name = d.tasks[0].level = d.pictures[0].title = evil;
  d.pictures[0].caption = d.effects[0].first = d.faults[0].first = d.files[0] = evil;
  d.pictures[0].overlays[0].label = d.map.driven.label = evil;
  const std::string html = teletact::report_html(d);
  EXPECT_EQ(support::xml_problem(html, kVoid), "");
  EXPECT_EQ(html.find("<script"), std::string::npos);
  EXPECT_FALSE(nlohmann::json::parse(teletact::report_json(d), nullptr, false).is_discarded());
}

TEST(Report, EmptyDataGivesAPage) {
  const std::string html = teletact::report_html(ReportData{});
  EXPECT_EQ(support::xml_problem(html, kVoid), "");
  expect_self_contained(html);
  EXPECT_THAT(html, HasSubstr("the scene calls for no effect"));
  EXPECT_EQ(html.find("NaN"), std::string::npos);
  EXPECT_FALSE(
      nlohmann::json::parse(teletact::report_json(ReportData{}), nullptr, false).is_discarded());
}

TEST(Report, InconsistentMapIsLeftOut) {
  ReportData d = sample();
  d.map.cost.resize(10);
  EXPECT_EQ(teletact::report_html(d).find("cost map"), std::string::npos);
  d.map.width = -1;
  EXPECT_NO_THROW((void)teletact::report_html(d));
}

TEST(Report, JsonHoldsMetricsAndTasks) {
  const auto j = nlohmann::json::parse(teletact::report_json(sample()));
  EXPECT_EQ(j.at("command"), "demo");
  EXPECT_EQ(j.at("metrics").size(), 3U);
  EXPECT_EQ(j["metrics"][0]["name"], "haptic.releases");
  EXPECT_EQ(j["metrics"][0]["value"], 20000);
  EXPECT_EQ(j["metrics"][1]["value"], "0123456789abcdef");
  EXPECT_TRUE(j["metrics"][2]["value"].is_null()) << "not measured is null, not 0";
  ASSERT_EQ(j.at("tasks").size(), 4U);
  const auto& m = j["tasks"][0]["misses"];
  EXPECT_EQ(m["all"], m["own"].get<int>() + m["queued"].get<int>() + m["carried"].get<int>() +
                          m["charged"].get<int>() + m["platform"].get<int>() +
                          m["unknown"].get<int>());
  EXPECT_EQ(j["tasks"][0]["slack_us"]["min"], -35.5);
  for (const char* name : {"cpu_us", "lateness_us", "response_us", "slack_us"}) {
    const auto& h = j["tasks"][0]["histograms"].at(name).at(0);
    EXPECT_EQ(h.at("lower").size(), h.at("count").size()) << name;
    EXPECT_FALSE(h.at("lower").empty()) << name;
  }
  EXPECT_EQ(j.at("seeds").at("run"), "42");
  EXPECT_EQ(j.at("effects")[0].at("name"), "camera noise");
}

TEST(Metrics, FileIsWholeOrNotThere) {
  const fs::path folder = fs::path(testing::TempDir()) / "teletact_metrics_test";
  fs::remove_all(folder);
  fs::create_directories(folder);
  Metrics m("bench rings");
  m.add("ring.own.8B.Mops", 123.456, "Mops");
  m.add("odd \"name\"", std::string("\xff\xfe not UTF-8"), "");
  const std::string path = (folder / "m.json").string();
  m.write(path);
  std::ifstream in(path);
  const auto j = nlohmann::json::parse(in);
  EXPECT_EQ(j.at("command"), "bench rings");
  EXPECT_TRUE(j.contains("version"));
  EXPECT_TRUE(j.contains("host"));
  EXPECT_EQ(j["metrics"][0]["unit"], "Mops");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
  try {
    m.write((folder / "no" / "such" / "folder.json").string());
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("folder.json"));
  }
  // A target that can not be replaced leaves no part file behind.
  fs::create_directories(folder / "is_a_folder" / "x");
  EXPECT_THROW(m.write((folder / "is_a_folder").string()), std::runtime_error);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 2);
  fs::remove_all(folder);
}

TEST(Report, FolderIsMade) {
  const fs::path folder = fs::path(testing::TempDir()) / "teletact_report_test" / "deep";
  fs::remove_all(folder.parent_path());
  teletact::write_report(folder.string(), sample());
  EXPECT_TRUE(fs::exists(folder / "report.html"));
  EXPECT_TRUE(fs::exists(folder / "report.json"));
  fs::remove_all(folder.parent_path());
  EXPECT_THROW(teletact::write_report("/proc/nowhere/report", ReportData{}), std::runtime_error);
}

}  // namespace
