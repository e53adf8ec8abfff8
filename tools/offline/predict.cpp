#include "tools/offline/predict.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "rt/quantile.hpp"
#include "tasks/prediction/hand_back.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/csv.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/take.hpp"
#include "tools/files/whole_file.hpp"

namespace teletact {
namespace {

struct Log {
  std::vector<std::string> stamps;  // t_s as the file writes it
  // t, x, y, yaw, vx, vy, wz [, cmd vx, vy, wz]; t, x and y less those of `first`.
  std::vector<std::vector<double>> rows;
  // Of the first row that counts: a stamp of Unix time or a place in a national grid leaves the
  // digits to what moves.
  std::array<double, 3> first{};
  bool commands = false;
  std::vector<std::string> refused;  // "line 7: not finite"
};

struct LogLine {
  std::size_t at;  // of the table
  std::vector<double> row;
};

// Nothing to say: the row counts.
std::string why_not(const std::vector<double>& row, const Log& log) {
  for (const double v : row)
    if (!std::isfinite(v)) return "not finite (nan or inf)";
  for (std::size_t c = 0; c < row.size(); ++c) {
    const bool moves = c < log.first.size();
    // Where a log may begin: Unix time, any map grid.
    constexpr double kFarthest_s = 1e10, kFarthest_m = 1e8;
    if (moves && log.rows.empty()) {
      if (std::abs(row[c]) > (c == 0 ? kFarthest_s : kFarthest_m)) return "no time or place";
    } else if (std::abs(row[c] - (moves ? log.first[c] : 0)) > tasks::MotionHistory::kLargest) {
      return moves ? "more than 1e6 from the first row" : "larger than 1e6";
    }
  }
  if (log.rows.empty() || row[0] - log.first[0] > log.rows.back()[0]) return {};
  return row[0] - log.first[0] == log.rows.back()[0] ? "t_s repeated: it must rise"
                                                     : "t_s goes back: it must rise";
}

// One clock reading that jumps ahead must not cost the rows behind it, which go back only from
// there: the two that follow rise, between the row before and this one.
bool alone_ahead(const std::vector<LogLine>& lines, std::size_t i, const Log& log) {
  if (i + 2 >= lines.size()) return false;
  const double here = lines[i].row[0], next = lines[i + 1].row[0], then = lines[i + 2].row[0];
  const bool behind = next < then && then < here;
  return behind && (log.rows.empty() || next - log.first[0] > log.rows.back()[0]);
}

// Nor must a first row from before the clock was set, or with a place that is none: all counts from
// the first row, and the two that follow lie together and far from it.
bool alone_at_first(const std::vector<LogLine>& lines, std::size_t i, const Log& log) {
  if (!log.rows.empty() || i + 2 >= lines.size()) return false;
  const auto far = [&](std::size_t a, std::size_t b) {
    for (std::size_t c = 0; c < log.first.size(); ++c)
      if (!(std::abs(lines[a].row[c] - lines[b].row[c]) <= tasks::MotionHistory::kLargest))
        return true;
    return false;
  };
  return far(i, i + 1) && far(i, i + 2) && !far(i + 1, i + 2);
}

void read_rows(const CsvTable& table, const std::vector<std::string>& columns, Log& log) {
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const int at = table.header.empty() ? static_cast<int>(i) : table.column(columns[i]);
    if (at < 0) throw std::runtime_error(table.name + ": column '" + columns[i] + "' is missing");
    index.push_back(static_cast<std::size_t>(at));
  }
  std::vector<LogLine> lines;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    std::vector<double> row;
    for (const std::size_t c : index) row.push_back(take(table.any_number(r, c)));
    lines.push_back({r, std::move(row)});
  }
  for (std::size_t i = 0; i < lines.size(); ++i) {
    auto& row = lines[i].row;
    std::string why = why_not(row, log);
    if (why.empty() && alone_ahead(lines, i, log)) why = "t_s is ahead of the rows behind it";
    if (why.empty() && alone_at_first(lines, i, log)) why = "more than 1e6 from the rows behind it";
    if (!why.empty()) {
      log.refused.push_back("line " + std::to_string(table.lines[lines[i].at]) + ": " + why);
      continue;
    }
    if (log.rows.empty()) std::copy_n(row.begin(), log.first.size(), log.first.begin());
    for (std::size_t c = 0; c < log.first.size(); ++c) row[c] -= log.first[c];
    log.rows.push_back(std::move(row));
    log.stamps.push_back(table.rows[lines[i].at][index[0]]);
  }
}

// One line: how many, and the first of them by name.
std::string refusals(const Log& log) {
  if (log.refused.empty()) return {};
  constexpr std::size_t kNamed = 20;
  std::string text = std::to_string(log.refused.size()) + " of " +
                     std::to_string(log.refused.size() + log.rows.size()) + " rows refused: ";
  for (std::size_t i = 0; i < std::min(kNamed, log.refused.size()); ++i)
    text += (i > 0 ? "; " : "") + log.refused[i];
  if (log.refused.size() > kNamed)
    text += "; and " + std::to_string(log.refused.size() - kNamed) + " more";
  return text;
}

Log read_log(const std::string& path) {
  const std::vector<std::string> needed{"t_s", "x_m", "y_m", "yaw_rad", "vx", "vy", "wz"};
  const std::vector<std::string> extra{"cmd_vx", "cmd_vy", "cmd_wz"};
  const CsvTable table = take(read_csv(path));
  Log log;
  std::size_t found = 0;
  for (const std::string& name : extra) found += table.column(name) >= 0 ? 1 : 0;
  if (table.header.empty() && table.rows.front().size() == needed.size() + extra.size()) found = 3;
  if (found != 0 && found != extra.size()) {
    throw std::runtime_error(path +
                             ": the columns cmd_vx, cmd_vy and cmd_wz come together, or none");
  }
  log.commands = found != 0;
  std::vector<std::string> columns = needed;
  if (log.commands) columns.insert(columns.end(), extra.begin(), extra.end());
  for (const std::string& name : table.header) {
    bool known = false;
    for (const std::string& c : columns) known = known || c == name;
    if (!known) throw std::runtime_error(path + ": unknown column '" + name + "'");
  }
  if (table.header.empty() && table.rows.front().size() != columns.size()) {
    throw std::runtime_error(path + ": " + std::to_string(table.rows.front().size()) +
                             " columns without a header; allowed are 7 or 10");
  }
  read_rows(table, columns, log);
  return log;
}

std::string predict(const Log& log, const PredictOptions& o, Metrics& metrics) {
  tasks::MotionPredictorConfig config;
  config.method = o.method;
  tasks::MotionPredictor predictor(config);
  tasks::HandBack hand_back({std::max(o.hand_back_s, 1e-3), 0.3, 0.6});
  std::string text = "t_s,x_m,y_m,yaw_rad\n";
  std::size_t known = 0, predicted = 0;
  std::vector<double> conditions;
  constexpr double kSameInstant_s = 1e-6;
  for (std::size_t i = 0; i < log.rows.size(); ++i) {
    const double t = log.rows[i][0];
    if (log.commands) {
      const auto& r = log.rows[i];
      (void)predictor.add_command(t, {r[7], r[8], r[9]});
    }
    tasks::MotionPredictor::Prediction before, p;
    const bool shown = predictor.peek(t, before);
    const std::size_t was = known;
    for (; known < log.rows.size() && log.rows[known][0] <= t - o.delay_s + kSameInstant_s;
         ++known) {
      const auto& r = log.rows[known];
      (void)predictor.add({r[0], {r[1], r[2], r[3]}, {r[4], r[5], r[6]}});
    }
    if (!predictor.predict(t, p)) continue;
    perception::Pose2 X = p.X_OB;
    if (o.hand_back_s > 0) {
      if (shown && known > was) hand_back.take(t, before.X_OB, p.X_OB);
      X = hand_back.show(t, p.X_OB);
    }
    char line[160];
    std::snprintf(line, sizeof line, ",%.6f,%.6f,%.6f\n", log.first[1] + X.x, log.first[2] + X.y,
                  X.yaw);
    text += log.stamps[i] + line;
    ++predicted;
    conditions.push_back(p.condition);
  }
  metrics.add("predict.rows", static_cast<double>(log.rows.size() + log.refused.size()), "1");
  metrics.add("predict.predicted", static_cast<double>(predicted), "1");
  metrics.add("predict.condition_p50", rt::quantile(conditions, 0.5, 0), "1");
  metrics.add("predict.condition_max", rt::quantile(conditions, 1, 0), "1");
  metrics.add("predict.refused", static_cast<double>(log.refused.size()), "1");
  return text;
}

}  // namespace

void predict_log(const PredictOptions& o) {
  Metrics metrics("predict");
  const Log log = read_log(o.log);
  const std::string text = predict(log, o, metrics), refused = refusals(log);
  if (text.find('\n') + 1 == text.size()) {
    throw std::runtime_error(o.log + ": no row has data " + std::to_string(o.delay_s) +
                             " s older than itself" + (refused.empty() ? "" : "; ") + refused);
  }
  write_outputs({{o.out, [&](const auto& path) { write_whole_file(path, text); }},
                 {o.json, [&](const auto& path) { metrics.write(path); }}});
  if (!refused.empty()) std::fprintf(stderr, "%s: %s\n", o.log.c_str(), refused.c_str());
}

}  // namespace teletact
