// The subcommands of teletact-measure: teletact bench|accuracy|stability. Each lives in cmd_<name>.cpp, parses its own
// arguments (CLI11), throws std::runtime_error with one line for bad input, and returns the exit
// code.
#pragma once

namespace teletact {

int cmd_bench(int argc, char** argv);
int cmd_accuracy(int argc, char** argv);
int cmd_moving(int argc, char** argv);            // accuracy moving
int cmd_recording(int argc, char** argv);         // accuracy recording
int cmd_choice(int argc, char** argv);            // accuracy choice
int cmd_codec_study(int argc, char** argv);       // accuracy codec
int cmd_prediction_study(int argc, char** argv);  // accuracy prediction
int cmd_stability(int argc, char** argv);

}  // namespace teletact
