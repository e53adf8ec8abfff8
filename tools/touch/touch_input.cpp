#include "tools/touch/touch_input.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include "rt/result.hpp"
#include "tools/files/csv.hpp"
#include "tools/files/npy.hpp"

namespace teletact::touch {

using perception::Vec3;

namespace {

template <class T>
T must(rt::Result<T> result) {
  if (!result) throw std::runtime_error(result.error());
  return std::move(result).value();
}

// A row a label: label, stiffness, friction, friction_dynamic, texture_m, texture_period_m. What is
// not named has the label 0's ordinary surface. True for the labels that have a row.
std::array<bool, 256> load_palette(const std::string& path, Palette& palette) {
  const CsvTable table = must(read_csv(path));
  struct Column {
    const char* name;
    double lo, hi;
    float perception::Material::*to;
  };
  using M = perception::Material;
  constexpr std::array kColumns{Column{"stiffness", 0.01, 1, &M::stiffness_scale},
                                Column{"friction", 0, 2, &M::friction_static},
                                Column{"friction_dynamic", 0, 2, &M::friction_dynamic},
                                Column{"texture_m", 0, 0.002, &M::texture_amplitude_m},
                                Column{"texture_period_m", 0.0004, 0.1, &M::texture_period_m}};
  std::array<bool, 256> named{};
  const int label = table.column("label");
  check(label >= 0, path + ": a column 'label' is needed");
  for (const std::string& name : table.header) {
    const bool known =
        name == "label" || std::any_of(kColumns.begin(), kColumns.end(),
                                       [&](const auto& c) { return name == c.name; });
    check(known, path + ": column '" + name +
                     "'; allowed are label, stiffness, friction, friction_dynamic, texture_m, "
                     "texture_period_m");
  }
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const std::string where = path + ":" + std::to_string(table.lines[i]) + ": ";
    const double id = must(table.number(i, static_cast<std::size_t>(label)));
    check(id >= 0 && id < static_cast<double>(palette.size()) && id == std::floor(id),
          where + "label " + table.rows[i][static_cast<std::size_t>(label)] +
              ": allowed are 0 to " + std::to_string(palette.size() - 1));
    const auto slot = static_cast<std::size_t>(id);
    check(!named[slot], where + "label " + std::to_string(slot) + " has a row already");
    named[slot] = true;
    M& m = palette[slot];
    m.texture_period_m = 0.002F;
    for (const Column& c : kColumns) {
      const int at = table.column(c.name);
      if (at < 0) continue;
      const double value = must(table.number(i, static_cast<std::size_t>(at)));
      std::ostringstream text;
      text << where << c.name << " " << value << ": allowed are " << c.lo << " to " << c.hi;
      check(value >= c.lo && value <= c.hi, text.str());
      m.*c.to = static_cast<float>(value);
    }
    if (table.column("friction_dynamic") < 0) m.friction_dynamic = 0.8F * m.friction_static;
    check(m.friction_dynamic <= m.friction_static, where + "friction_dynamic is above friction");
  }
  return named;
}

void load_materials(const Options& o, FieldList& out) {
  if (o.palette.empty()) return;
  const std::array<bool, 256> named = load_palette(o.palette, out.palette);
  if (o.labels.empty()) return;
  NpyLabels labels = must(read_npy_labels(o.labels));
  const auto stray = std::find_if(labels.values.begin(), labels.values.end(),
                                  [&](const std::uint8_t label) { return !named[label]; });
  check(stray == labels.values.end(),
        o.labels + ": label " +
            (stray == labels.values.end() ? std::string() : std::to_string(*stray)) +
            " has no row in " + o.palette + " (allowed are 0 to 15)");
  for (DenseField& field : out.fields) {
    bool same = labels.shape.size() == 3;
    for (std::size_t a = 0; a < 3 && same; ++a) {
      same = labels.shape[a] == static_cast<std::size_t>(field.size[a]);
    }
    check(same, o.labels + ": its shape is not the field's");
    field.label = labels.values;
  }
}

FieldList load_distances(const Options& o) {
  FieldList out;
  if (!o.field.empty()) {
    out.from.push_back(-HUGE_VAL);
    out.fields.push_back(must(to_field(must(read_npy(o.field)), o.field)));
    return out;
  }
  const CsvTable table = must(read_csv(o.fields));
  check((table.header.empty() ? table.rows.front().size() : table.header.size()) == 2,
        o.fields + ": two columns t_s,file are needed");
  const auto folder = std::filesystem::path(o.fields).parent_path();
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double t = must(table.number(i, 0));
    check(out.from.empty() || t > out.from.back(),
          o.fields + ":" + std::to_string(table.lines[i]) + ": t_s must rise from row to row");
    const std::string where = o.fields + ":" + std::to_string(table.lines[i]) + ": ";
    const std::filesystem::path file(table.rows[i][1]);
    check(!file.empty(), where + "no file is named");
    const std::string path = file.is_absolute() ? file.string() : (folder / file).string();
    check(!std::filesystem::is_directory(path), where + path + " is a folder");
    out.from.push_back(t);
    out.fields.push_back(must(to_field(must(read_npy(path)), path)));
  }
  return out;
}

std::string number_text(double v) {
  std::ostringstream text;
  text << v;
  return text.str();
}

// The path's rows as they stand in the file, each with what names it in a message.
std::vector<HandRow> load_rows(const Options& o, const CsvTable& table, HandPath& out) {
  const auto rows = must(numeric_rows(table, {"t_s", "x", "y", "z"}));
  const int clutch = table.column("clutch");
  std::vector<HandRow> hand;
  hand.reserve(rows.size());
  bool leaves = false;  // the reach of a base at the world's origin
  const auto where = [&](std::size_t i) {
    return o.path + ":" + std::to_string(table.lines[i]) + ": ";
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto& r = rows[i];
    hand.push_back({r[0], Vec3(r[1], r[2], r[3])});
    if (clutch >= 0) {
      const auto column = static_cast<std::size_t>(clutch);
      const double held = must(table.number(i, column));
      check(held == 0 || held == 1,
            where(i) + "clutch " + table.rows[i][column] + ": allowed are 0 and 1");
      hand.back().clutch = held == 1;
    }
    const double far = hand.back().p.norm();
    check(far < 1000,
          where(i) + number_text(far) + " m from the world's origin: allowed are 1000 m");
    if (far <= kDeviceReach_m) continue;
    leaves = true;
    check(o.border_m == 0, where(i) + number_text(far) +
                               " m from the world's origin, round which --border lies: " +
                               "allowed are " + number_text(kDeviceReach_m) + " m with it");
  }
  if (!leaves) return hand;
  out.base = hand.front().p;
  for (std::size_t i = 0; i < hand.size(); ++i) {
    const double far = (hand[i].p - out.base).norm();
    check(far <= kDeviceReach_m,
          where(i) + number_text(far) + " m from the path's first row: allowed are " +
              number_text(kDeviceReach_m) + " m, or from the world's origin");
  }
  return hand;
}

}  // namespace

FieldList load_fields(const Options& o) {
  FieldList out = load_distances(o);
  load_materials(o, out);
  return out;
}

HandPath load_hand(const Options& o) {
  const CsvTable table = must(read_csv(o.path));
  HandPath out;
  std::vector<HandRow> hand = load_rows(o, table, out);
  const double spacing =
      hand.size() > 1 ? (hand.back().t - hand.front().t) / static_cast<double>(hand.size() - 1)
                      : 1e-3;
  const double period_s = out.period_s = o.rate_hz > 0 ? 1.0 / o.rate_hz : spacing;
  check(
      period_s >= 1e-5 && period_s <= 0.1,
      o.path + ": row spacing of " + std::to_string(period_s) + " s; allowed are 10 us to 100 ms");
  check((hand.back().t - hand.front().t) / period_s < 1e8, o.path + ": too long a time");
  std::size_t uneven = 1;
  const auto gap = [&](std::size_t i) { return hand[i].t - hand[i - 1].t; };
  while (uneven < hand.size() && std::abs(gap(uneven) - period_s) <= 0.5 * period_s) ++uneven;
  const bool even = uneven >= hand.size();
  check(even || o.rate_hz > 0, o.path + ": row " + std::to_string(uneven + 1) + " is " +
                                   (even ? std::string() : std::to_string(gap(uneven))) +
                                   " s after the one before; rows are ticks, " +
                                   std::to_string(period_s) +
                                   " s apart: give --rate to have them interpolated");
  if (even && std::abs(spacing - period_s) <= 1e-3 * period_s) {
    out.rows = std::move(hand);
    return out;
  }
  std::size_t i = 0;
  for (std::size_t k = 0;; ++k) {
    const double t = hand.front().t + static_cast<double>(k) * period_s;
    if (t > hand.back().t + 1e-9) break;
    while (i + 2 < hand.size() && hand[i + 1].t <= t) ++i;
    const HandRow &a = hand[i], &b = hand[std::min(i + 1, hand.size() - 1)];
    const double s = b.t > a.t ? std::clamp((t - a.t) / (b.t - a.t), 0.0, 1.0) : 0.0;
    out.rows.push_back({t, (1 - s) * a.p + s * b.p, a.clutch});
  }
  return out;
}

}  // namespace teletact::touch
