// What came of a hand on a recording: limits, figures, table, drawings.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "tools/measure/haptic/recording_touch.hpp"
#include "tools/report/svg.hpp"

namespace teletact {

namespace {

constexpr double kJumpShare = 0.01;        // of the contact ticks
constexpr std::uint64_t kJumpsInARow = 2;  // ticks
constexpr std::size_t kAfter = 50;         // ticks: the optimum may be somewhat later

void print_events(const std::vector<TouchedRow::Event>& events, const std::vector<Place>& places,
                  std::ostream& out) {
  char line[320];
  for (const TouchedRow::Event& e : events) {
    const auto at = static_cast<std::size_t>(e.place);
    std::snprintf(
        line, sizeof line,
        "  %7.3f s %-7s raw step %.2f N%s%s%s, blend %.2f, hand (%.4f, %.4f, %.4f), proxy (%.4f, "
        "%.4f, %.4f), before (%.4f, %.4f, %.4f)\n",
        e.t_s, e.place >= 0 ? name_of(places[at].kind) : "between", e.step_raw_N,
        e.jump ? ", over" : "", e.flipped ? ", turned" : "", e.sunk ? ", sunk" : "", e.blend,
        e.p_WH.x(), e.p_WH.y(), e.p_WH.z(), e.p_WP.x(), e.p_WP.y(), e.p_WP.z(), e.p_before_WP.x(),
        e.p_before_WP.y(), e.p_before_WP.z());
    out << line;
    if (!e.flipped || e.place < 0) continue;
    const Place& place = places[at];
    const auto degrees = [&](const perception::Vec3& n) {
      return 180 / std::numbers::pi * std::acos(std::clamp(e.entry_W.dot(n), -1.0, 1.0));
    };
    std::snprintf(
        line, sizeof line,
        "          came in %.0f deg off the place's normal; force turned by %.0f deg, to %.0f "
        "deg off the normal; edges %.0f and %.0f deg off it\n",
        degrees(place.n_W), degrees((e.p_WP - e.p_WH).normalized()),
        180 / std::numbers::pi *
            std::acos(std::clamp((e.p_WP - e.p_WH).normalized().dot(place.n_W), -1.0, 1.0)),
        degrees(place.out_W[0]), degrees(place.out_W[1]));
    out << line;
  }
}

// One line: of product or optimum in the contacts that were asked about.
void print_asked(const char* who, const ContactFigures& f, std::ostream& out) {
  char line[200];
  std::snprintf(line, sizeof line,
                "  %s in the contacts that missed (%.1f s): %llu steps over, %llu in a row, "
                "largest %.2f N, %llu turned\n",
                who, 1e-3 * static_cast<double>(f.ticks), static_cast<unsigned long long>(f.jumps),
                static_cast<unsigned long long>(f.longest_jump), f.step_max_N,
                static_cast<unsigned long long>(f.turned));
  out << line;
}

}  // namespace

int TouchedPath::surfaces_touched() const {
  const auto& p = rows.front().places;
  return static_cast<int>(
      std::count_if(p.begin(), p.end() - 1, [](const auto& f) { return f.contact_s >= 0.5; }));
}

std::vector<Limit> TouchedPath::limits() const {
  const TouchedRow& row = rows.front();
  const auto touched = [&](Place::Kind kind) {
    int n = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
      n += places[i].kind == kind && row.places[i].contact_s >= 0.5 ? 1 : 0;
    }
    return n;
  };
  Limits all;
  all.add("time in contact, s", 1e-3 * static_cast<double>(row.contact), ">=", seconds / 1.5);
  all.add("surfaces touched", surfaces_touched(), ">=", 5);
  all.add("walls touched", touched(Place::Kind::kWall), ">=", 1);
  all.add("edges touched", touched(Place::Kind::kEdge), ">=", 1);
  all.add("corners touched", touched(Place::Kind::kCorner), ">=", 1);
  all.add("raw steps over K|dh| + 0.5 N, %", 100 * row.jump_share(), "<=", 100 * kJumpShare);
  all.add("most of them in a row, ticks", static_cast<double>(row.longest_jump),
          "<=", static_cast<double>(kJumpsInARow));
  all.add("ticks not finite", static_cast<double>(row.not_finite), "<=", 0);
  all.add("least E + booked + credit at b 2 N s/m, mJ", 1e3 * row.energy_min_J, ">=", -1);
  all.add("ticks through the surface", static_cast<double>(row.sunk + row.flipped), "<=", 0);
  return all.all();
}

std::vector<TickSpan> TouchedPath::missed_contacts() const {
  const TouchedRow& row = rows.front();
  const bool share = row.jump_share() > kJumpShare, long_ones = row.longest_jump > kJumpsInARow;
  std::vector<TickSpan> spans;
  for (const TouchedRow::Event& e : row.events) {
    if (!(e.flipped || (e.jump && (share || (long_ones && e.in_a_row > kJumpsInARow))))) continue;
    const TickSpan span{e.begin, e.tick + kAfter};
    if (spans.empty() || e.begin > spans.back().second)
      spans.push_back(span);
    else
      spans.back().second = std::max(spans.back().second, span.second);
  }
  return spans;
}

int TouchedPath::missed_alone() const {
  const TouchedRow& row = rows.front();
  const auto alone = [](std::uint64_t ours, std::uint64_t limit, std::uint64_t theirs) {
    return ours > limit && theirs < ours ? 1 : 0;
  };
  return alone(row.longest_jump, kJumpsInARow, optimum.longest_jump) +
         alone(row.flipped, 0, optimum.turned) +
         (row.jump_share() > kJumpShare && optimum.jumps < asked.jumps ? 1 : 0) +
         (row.sunk > 0 ? 1 : 0);
}

void TouchedPath::print(std::ostream& out) const {
  char line[320];
  std::snprintf(line, sizeof line,
                "seed %llu: %.1f m through the free, hand at most %.0f mm/s; %.1f s in contact\n",
                static_cast<unsigned long long>(seed), way_m, 1e3 * hand_speed_max_m_per_s,
                1e-3 * static_cast<double>(rows.front().contact));
  out << line << "            at, m                contact s  steps over  largest raw N  through\n";
  for (std::size_t i = 0; i < rows.front().places.size(); ++i) {
    const PlaceFigures& f = rows.front().places[i];
    char at[64] = "";
    if (i < places.size()) {
      const auto& p = places[i].p_W;
      std::snprintf(at, sizeof at, "(%.2f, %.2f, %.2f)", p.x(), p.y(), p.z());
    }
    std::snprintf(line, sizeof line, "  %-8s  %-19s  %-9.1f  %-10llu  %-13.2f  %llu\n",
                  i < places.size() ? name_of(places[i].kind) : "between", at, f.contact_s,
                  static_cast<unsigned long long>(f.jumps), f.step_raw_max_N,
                  static_cast<unsigned long long>(f.pops));
    out << line;
  }
  out << "                contact  raw steps over K|dh| + 0.5 N     largest step N   largest  not  "
         "   "
         "through the surface\n"
         "                s        share %   longest ticks          raw     sent     force N  "
         "finite  sunk  turned  deepest mm  not judged\n";
  for (const TouchedRow& row : rows) {
    std::snprintf(
        line, sizeof line,
        "  %-13s %-8.1f %-9.3f %-22llu %-7.2f %-8.2f %-8.2f %-7llu %-5llu %-7llu %-11.2f "
        "%llu\n",
        row.method.c_str(), 1e-3 * static_cast<double>(row.contact), 100 * row.jump_share(),
        static_cast<unsigned long long>(row.longest_jump), row.step_raw_max_N, row.step_max_N,
        row.force_max_N, static_cast<unsigned long long>(row.not_finite),
        static_cast<unsigned long long>(row.sunk), static_cast<unsigned long long>(row.flipped),
        row.deepest_mm, static_cast<unsigned long long>(row.unknown));
    out << line;
  }
  std::snprintf(
      line, sizeof line,
      "  %s: the hand at most %.1f mm from the proxy; let go %llu times by a surface that came or "
      "went; E + booked + credit at least %.3f mJ\n",
      rows.front().method.c_str(), rows.front().stretch_max_mm,
      static_cast<unsigned long long>(rows.front().let_go), 1e3 * rows.front().energy_min_J);
  out << line;
  print_events(rows.front().events, places, out);
  if (optimum.ticks > 0) {
    print_asked("product", asked, out);
    print_asked("optimum", optimum, out);
  }
  out << "  seed " << seed
      << (teletact::missed(limits()) == 0 ? ": within all limits" : ": MISSED");
  const char* between = " ";
  for (const Limit& l : limits()) {
    if (l.state != Limit::State::kMissed) continue;
    out << between << l.what;
    between = "; ";
  }
  out << "\n";
}

std::vector<Limit> RecordingTouchResult::limits() const {
  std::vector<Limit> worst;
  for (const TouchedPath& path : paths) {
    const auto of_path = path.limits();
    if (worst.empty()) worst = of_path;
    for (std::size_t i = 0; i < of_path.size(); ++i) {
      const Limit &l = of_path[i], &w = worst[i];
      if (l.sense == std::string(">=") ? l.value < w.value : l.value > w.value) worst[i] = l;
    }
  }
  if (optimum) {
    int alone = 0;
    for (const TouchedPath& path : paths) alone += path.missed_alone();
    Limits more;
    more.add("misses that the field's optimum does not make", alone, "<=", 0);
    worst.push_back(more.all().front());
  }
  return worst;
}

std::vector<BenchMetric> RecordingTouchResult::metrics() const {
  int surfaces = std::numeric_limits<int>::max();
  for (const TouchedPath& p : paths) surfaces = std::min(surfaces, p.surfaces_touched());
  std::vector<BenchMetric> m{{"haptic.recording.frames", static_cast<double>(frames_played), "1"},
                             {"haptic.recording.integrated", static_cast<double>(integrated), "1"},
                             {"haptic.recording.paths", static_cast<double>(paths.size()), "1"},
                             {"haptic.recording.surfaces", static_cast<double>(surfaces), "1"}};
  double energy = 0;
  for (const TouchedPath& p : paths) energy = std::min(energy, p.rows.front().energy_min_J);
  m.push_back({"haptic.energy_min_mJ", 1e3 * energy, "mJ"});
  for (std::size_t i = 0; i < paths.front().rows.size(); ++i) {
    const std::string name = "haptic.recording." + paths.front().rows[i].method + ".";
    double contact_s = std::numeric_limits<double>::infinity(), share = 0, longest = 0, step = 0,
           not_finite = 0, pops = 0;
    for (const TouchedPath& p : paths) {
      const TouchedRow& row = p.rows[i];
      contact_s = std::min(contact_s, 1e-3 * static_cast<double>(row.contact));
      share = std::max(share, row.jump_share());
      longest = std::max(longest, static_cast<double>(row.longest_jump));
      step = std::max(step, row.step_raw_max_N);
      not_finite = std::max(not_finite, static_cast<double>(row.not_finite));
      pops = std::max(pops, static_cast<double>(row.sunk + row.flipped));
    }
    m.push_back({name + "contact_s", contact_s, "s"});
    m.push_back({name + "jump_share", share, "1"});
    m.push_back({name + "jump_longest_ticks", longest, "1"});
    m.push_back({name + "step_raw_max_N", step, "N"});
    m.push_back({name + "not_finite", not_finite, "1"});
    m.push_back({name + "pops", pops, "1"});
  }
  return m;
}

void RecordingTouchResult::print(std::ostream& out) const {
  char line[120];
  std::snprintf(line, sizeof line, "%.0f s of virtual time: %d frames played, %d integrated\n",
                seconds, frames_played, integrated);
  out << line;
  for (const TouchedPath& p : paths) p.print(out);
  teletact::print(out, limits());
}

namespace {

std::string over_time(const std::vector<TouchedRow>& rows, const char* title, const char* label,
                      std::vector<float> TouchedRow::*values) {
  plot::Figure f;
  f.title = title;
  f.x_label = "virtual time, s";
  f.y_label = label;
  f.width_px = 1100;
  f.height_px = 420;
  // The baselines below, ours on top.
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) {
    plot::Series s{row->method, {}, {}, "", false, false};
    const auto& v = (*row).*values;
    for (std::size_t k = 0; k < v.size(); ++k) {
      s.x.push_back(1e-3 * static_cast<double>(k));
      s.y.push_back(static_cast<double>(v[k]));
    }
    f.series.push_back(std::move(s));
  }
  return plot::line_plot(f);
}

}  // namespace

std::string RecordingTouchResult::force_drawing() const {
  return over_time(paths.front().rows, "Force on the hand, the recording forward and back",
                   "|F|, N", &TouchedRow::force_N);
}

std::string RecordingTouchResult::step_drawing() const {
  return over_time(paths.front().rows, "Raw change of force a tick, the recording forward and back",
                   "|dF|, N", &TouchedRow::step_raw_N);
}

}  // namespace teletact
