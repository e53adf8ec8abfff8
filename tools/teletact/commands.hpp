// The subcommands of the program. Each lives in cmd_<name>.cpp, parses its own arguments (CLI11),
// throws std::runtime_error with one line for bad input, and returns the exit code.
#pragma once

namespace teletact {

int cmd_demo(int argc, char** argv);
int cmd_robot(int argc, char** argv);
int cmd_operator(int argc, char** argv);
int cmd_status(int argc, char** argv);
int cmd_explain(int argc, char** argv);
int cmd_fuse(int argc, char** argv);
int cmd_film(int argc, char** argv);
int cmd_codec(int argc, char** argv);
int cmd_touch(int argc, char** argv);
int cmd_segment(int argc, char** argv);
int cmd_predict(int argc, char** argv);
int cmd_doctor(int argc, char** argv);
int cmd_device(int argc, char** argv);
int cmd_identify(int argc, char** argv);
int cmd_identify_robot(int argc, char** argv);  // identify robot
int cmd_calibrate(int argc, char** argv);
int cmd_audit(int argc, char** argv);
int cmd_report(int argc, char** argv);
int cmd_replay(int argc, char** argv);
int cmd_keys(int argc, char** argv);
int cmd_can(int argc, char** argv);
int cmd_ethercat(int argc, char** argv);
int cmd_youbot(int argc, char** argv);
int cmd_twin(int argc, char** argv);

}  // namespace teletact
