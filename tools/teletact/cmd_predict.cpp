// teletact predict: where a ground robot is, told only what was known `delay` seconds ago.
//
//   --log ODO.csv   t_s,x_m,y_m,yaw_rad,vx,vy,wz (body frame), optional cmd_vx,cmd_vy,cmd_wz
//   --delay S       row t_s is made from the rows with t <= t_s - S only (to 1 us: stamps are
//                   decimal); commands are known up to t_s
//   --method M      a method of the prediction task (motion_predictor.hpp)
//   --hand-back S   what is written follows the prediction without a jump: differences fade with S
//                   (hand_back.hpp)
//   --out P.csv     t_s,x_m,y_m,yaw_rad for each row that has data at least S older
//
// A row that is not finite, repeated or out of order is left out, counted, and named at the end.
#include <CLI/CLI.hpp>

#include "tools/cli/options.hpp"
#include "tools/offline/predict.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_predict(int argc, char** argv) {
  PredictOptions o;
  CLI::App app("teletact predict: pose of a ground robot, predicted across a delay",
               "teletact predict");
  app.add_option("--log", o.log, "CSV t_s,x_m,y_m,yaw_rad,vx,vy,wz[,cmd_vx,cmd_vy,cmd_wz]")
      ->required();
  app.add_option("--delay", o.delay_s, "s between what is known and what is predicted")
      ->required()
      ->check(in_range(0, 10));
  app.add_option("--method", o.method, "of the prediction task")
      ->check(CLI::IsMember(tasks::MotionPredictorConfig::methods()))
      ->capture_default_str();
  app.add_option("--hand-back", o.hand_back_s,
                 "s that a step of the prediction fades with; 0: steps are written")
      ->check(in_range(0, 10))
      ->capture_default_str();
  app.add_option("--out", o.out, "CSV to write: t_s,x_m,y_m,yaw_rad")->required();
  app.add_option("--json", o.json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--out", o.out}, {"--json", o.json}}, {o.log});
  predict_log(o);
  return 0;
}

}  // namespace teletact
