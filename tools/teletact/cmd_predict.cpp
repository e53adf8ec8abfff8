// teletact predict: where a ground robot is, told only what was known `delay` seconds ago.
//
//   --log ODO.csv   t_s,x_m,y_m,yaw_rad,vx,vy,wz (body frame), optional cmd_vx,cmd_vy,cmd_wz
//   --delay S       row t_s is made from the rows with t <= t_s - S only; commands are known up to
//   t_s
//   --method M      none, hold, lsq: the predictor of the prediction task (motion_predictor.hpp)
//   --out P.csv     t_s,x_m,y_m,yaw_rad for each row that has data at least S older
#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "tasks/prediction/motion_predictor.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/csv.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/take.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

struct PredictOptions {
  std::string log, method = "lsq", out, json;
  double delay_s = 0;
};

struct Log {
  std::vector<std::string> stamps;        // t_s as the file writes it
  std::vector<std::vector<double>> rows;  // t, x, y, yaw, vx, vy, wz [, cmd vx, vy, wz]
  bool commands = false;
};

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
  log.rows = take(numeric_rows(table, columns));
  const auto stamp = static_cast<std::size_t>(table.header.empty() ? 0 : table.column("t_s"));
  for (const auto& row : table.rows) log.stamps.push_back(row[stamp]);
  return log;
}

std::string predict(const Log& log, const PredictOptions& o, Metrics& metrics) {
  tasks::MotionPredictorConfig config;
  config.method = o.method;
  tasks::MotionPredictor predictor(config);
  std::string text = "t_s,x_m,y_m,yaw_rad\n";
  std::size_t known = 0, predicted = 0;
  for (std::size_t i = 0; i < log.rows.size(); ++i) {
    const double t = log.rows[i][0];
    if (log.commands) {
      const auto& r = log.rows[i];
      (void)predictor.add_command(t, {r[7], r[8], r[9]});
    }
    for (; known < log.rows.size() && log.rows[known][0] <= t - o.delay_s; ++known) {
      const auto& r = log.rows[known];
      (void)predictor.add({r[0], {r[1], r[2], r[3]}, {r[4], r[5], r[6]}});
    }
    tasks::MotionPredictor::Prediction p;
    if (!predictor.predict(t, p)) continue;
    char line[160];
    std::snprintf(line, sizeof line, ",%.6f,%.6f,%.6f\n", p.X_OB.x, p.X_OB.y, p.X_OB.yaw);
    text += log.stamps[i] + line;
    ++predicted;
  }
  metrics.add("predict.rows", static_cast<double>(log.rows.size()), "1");
  metrics.add("predict.predicted", static_cast<double>(predicted), "1");
  return text;
}

}  // namespace

int cmd_predict(int argc, char** argv) {
  PredictOptions o;
  CLI::App app("teletact predict: pose of a ground robot, predicted across a delay",
               "teletact predict");
  app.add_option("--log", o.log, "CSV t_s,x_m,y_m,yaw_rad,vx,vy,wz[,cmd_vx,cmd_vy,cmd_wz]")
      ->required();
  app.add_option("--delay", o.delay_s, "s between what is known and what is predicted, 0 to 10")
      ->required();
  app.add_option("--method", o.method, "none, hold or lsq")->capture_default_str();
  app.add_option("--out", o.out, "CSV to write: t_s,x_m,y_m,yaw_rad")->required();
  app.add_option("--json", o.json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  if (!(o.delay_s >= 0 && o.delay_s <= 10)) {
    throw std::runtime_error("--delay " + std::to_string(o.delay_s) + ": allowed are 0 to 10 s");
  }
  if (o.method != "none" && o.method != "hold" && o.method != "lsq") {
    throw std::runtime_error("--method " + o.method + ": allowed are none, hold, lsq");
  }
  check_outputs({{"--out", o.out}, {"--json", o.json}}, {o.log});
  Metrics metrics("predict");
  const std::string text = predict(read_log(o.log), o, metrics);
  if (text.find('\n') + 1 == text.size()) {
    throw std::runtime_error(o.log + ": no row has data " + std::to_string(o.delay_s) +
                             " s older than itself");
  }
  write_outputs({{o.out, [&](const auto& path) { write_whole_file(path, text); }},
                 {o.json, [&](const auto& path) { metrics.write(path); }}});
  return 0;
}

}  // namespace teletact
