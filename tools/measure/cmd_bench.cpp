// teletact bench WHAT: figures beside a peer's, measured in the same run.
#include <CLI/CLI.hpp>
#include <array>
#include <filesystem>
#include <iostream>
#include <stdexcept>

#include "tools/cli/number_list.hpp"
#include "tools/cli/option_use.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/bench/audit_bench.hpp"
#include "tools/measure/bench/codec/codec_bench.hpp"
#include "tools/measure/bench/drift.hpp"
#include "tools/measure/bench/log_bench.hpp"
#include "tools/measure/bench/rings.hpp"
#include "tools/measure/bench/table1_instructions.hpp"
#include "tools/measure/bench/table2/table2.hpp"
#include "tools/measure/bench/table2/touches.hpp"
#include "tools/measure/bench/wakeup.hpp"
#include "tools/measure/bench_parts.hpp"
#include "tools/measure/measure_commands.hpp"

namespace teletact {

namespace {

class BenchCommand {
 public:
  BenchCommand(int argc, char** argv);
  // Exit code.
  int run();

 private:
  struct Row {
    const char* what;
    void (BenchCommand::*run)();
  };
  static const std::array<Row, 17> kRows;

  void add_what();
  void add_picture_options();
  void add_part_options();
  bool parse();
  // Prints a result, keeps its figures, counts its limits.
  template <class Result>
  void take(const Result& result);

  void run_rings() { take(bench_rings(std::cerr, rounds_)); }
  void run_wakeup() { take(bench_wakeup(std::cerr, rounds_, slice_s_)); }
  void run_audit();
  void run_table1();
  void run_table2() { take(bench_table2(std::cerr, data())); }
  void run_segmentation() { take(bench_touches(std::cerr, data(), seed_)); }
  void run_fusion();
  void run_codec() { take(bench_codec(std::cerr, codec_)); }
  void run_drift();
  void run_fuzz() { take(fuzz_.run(seed_)); }
  void run_haptic();
  void run_boundary() { take(haptic_.sweep()); }
  void run_prediction() { take(prediction_.run(app_, seed_, haptic_.svg, effects_.file)); }
  void run_effects();
  void run_days() { take(days_.run(effects_.file, command_line())); }
  void run_link() { take(link_.run(effects_.file, command_line())); }
  void run_console();

  [[nodiscard]] const std::string& data() const;
  [[nodiscard]] std::string command_line() const;
  void leave_out_missing_recording();

  int argc_;
  char** argv_;
  CLI::App app_{"Measures one part beside its peers. Ends with 1 when a limit is missed."};
  std::string what_, json_, intrinsics_, data_;
  int rounds_ = 9, frames_ = 0;
  double slice_s_ = 1.0;
  std::uint64_t seed_ = 1;
  bool instructions_ = false;
  CLI::Option* rgbd_ = nullptr;
  Table1Options table1_;
  CodecBenchOptions codec_;
  EffectsBench effects_;
  FuzzBench fuzz_;
  PeerBench peer_;
  HapticBench haptic_;
  PredictionBench prediction_;
  DaysBench days_;
  LinkBench link_;
  ConsoleBench console_;
  DriftOptions drift_;
  Metrics metrics_{"bench"};
  int missed_ = 0;
};

const std::array<BenchCommand::Row, 17> BenchCommand::kRows{{
    {"rings", &BenchCommand::run_rings},
    {"wakeup", &BenchCommand::run_wakeup},
    {"audit", &BenchCommand::run_audit},
    {"table1", &BenchCommand::run_table1},
    {"table2", &BenchCommand::run_table2},
    {"segmentation", &BenchCommand::run_segmentation},
    {"fusion", &BenchCommand::run_fusion},
    {"codec", &BenchCommand::run_codec},
    {"drift", &BenchCommand::run_drift},
    {"fuzz", &BenchCommand::run_fuzz},
    {"haptic", &BenchCommand::run_haptic},
    {"boundary", &BenchCommand::run_boundary},
    {"prediction", &BenchCommand::run_prediction},
    {"effects", &BenchCommand::run_effects},
    {"days", &BenchCommand::run_days},
    {"link", &BenchCommand::run_link},
    {"console", &BenchCommand::run_console},
}};

// The order is that of --help.
BenchCommand::BenchCommand(int argc, char** argv) : argc_(argc), argv_(argv) {
  add_what();
  app_.add_option("--rounds", rounds_, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app_.add_option("--slice", slice_s_, "wakeup: seconds a slice")
      ->check(in_range(0.2, 60))
      ->capture_default_str();
  effects_.add_to(app_);
  add_picture_options();
  add_part_options();
  app_.add_option("--json", json_, "write the figures to this file");
}

void BenchCommand::add_what() {
  std::vector<std::string> names;
  std::string listed;
  for (const Row& row : kRows) {
    names.emplace_back(row.what);
    listed += (listed.empty() ? "" : " | ") + names.back();
  }
  app_.add_option("WHAT", what_, listed)->required()->check(CLI::IsMember(names));
}

void BenchCommand::add_picture_options() {
  table1_.rgbd = "../shared/data/rgbd/7scenes_redkitchen";
  rgbd_ = app_.add_option(
                  "--rgbd", table1_.rgbd,
                  "table1, fusion: recording in TUM or 7-Scenes layout; the default may be absent; "
                  "haptic: touch this recording instead")
              ->capture_default_str();
  app_.add_option("--intrinsics", intrinsics_,
                  "of the recording, where it has no intrinsics.txt: fx,fy,cx,cy in px, and depth "
                  "units a metre if the data set's are not right");
  add_table1_options(app_, table1_, instructions_);
  app_.add_option("--data", data_,
                  "table2, segmentation: folder of images with people's or true masks");
  app_.add_option("--seed", seed_,
                  "segmentation: of the touches; fuzz: of the damage; haptic: of the hand's path; "
                  "codec: of the room; prediction: of the driven traces, default 4")
      ->capture_default_str();
  app_.add_flag("--long", codec_.long_run,
                "codec: 100,000 damaged frames of each kind, 10,000 states; "
                "console: growth over an hour's worth of views");
}

void BenchCommand::add_part_options() {
  fuzz_.add_to(app_);
  peer_.add_to(app_);
  haptic_.add_to(app_);
  prediction_.add_to(app_);
  days_.add_to(app_);
  link_.add_to(app_);
  console_.add_to(app_);
  app_.add_option("--frames,--count", frames_,
                  "how many of each sequence (a shorter recording: as many as it has); default: "
                  "table1 150, "
                  "fusion and codec 60, drift 10000")
      ->check(CLI::Range(20, 10000000));
  drift_.add_to(app_);
}

// False: help was asked for, and printed.
bool BenchCommand::parse() {
  if (!parse_options(app_, argc_, argv_)) return false;
  check_bench_use(app_, what_, rgbd_->count() > 0);
  check_outputs({{"--json", json_}, {"--record", haptic_.record}, {"--write", effects_.file}}, {});
  if (!haptic_.svg.empty()) make_output_folder("--svg", haptic_.svg);
  if (!intrinsics_.empty())
    table1_.pinhole = peer_.options.pinhole = haptic_.recording.pinhole =
        parse_pinhole(intrinsics_);
  if (frames_ > 0) table1_.frames = peer_.options.frames = codec_.frames = frames_;
  codec_.seed = seed_;
  return true;
}

int BenchCommand::run() {
  if (!parse()) return 0;
  metrics_ = Metrics("bench " + what_);
  for (const Row& row : kRows) {
    if (what_ == row.what) (this->*row.run)();
  }
  if (!json_.empty()) metrics_.write(json_);
  return missed_ == 0 ? 0 : 1;
}

template <class Result>
void BenchCommand::take(const Result& result) {
  result.print(std::cout);
  for (const auto& m : result.metrics()) metrics_.add(m.name, m.value, m.unit);
  missed_ += result.missed();
}

void BenchCommand::run_audit() {
  // A second each: others' load is told in ticks of 10 ms.
  take(bench_audit(1000));
  take(bench_log(30000));
}

void BenchCommand::leave_out_missing_recording() {
  if (rgbd_->count() > 0 || std::filesystem::exists(table1_.rgbd)) return;
  std::cerr << table1_.rgbd << " is not there: only the synthetic room\n";
  table1_.rgbd.clear();
}

void BenchCommand::run_table1() {
  leave_out_missing_recording();
  if (!instructions_) {
    take(bench_table1(std::cerr, table1_));
    return;
  }
  const InstructionsResult result = count_table1(std::cerr, table1_, frames_ > 0 ? frames_ : 20);
  take(result);
  missed_ += result.not_counted.empty() ? 0 : 1;
}

void BenchCommand::run_fusion() {
  leave_out_missing_recording();
  take(peer_.run(table1_.rgbd));
}

const std::string& BenchCommand::data() const {
  if (data_.empty()) throw std::runtime_error("bench " + what_ + " needs --data DIR");
  return data_;
}

void BenchCommand::run_drift() {
  take(bench_drift(std::cerr, frames_ > 0 ? frames_ : 10000, drift_.voxel_m,
                   drift_.half_size ? 2 : 1));
}

void BenchCommand::run_haptic() {
  if (rgbd_->count() > 0) {
    take(haptic_.touch(table1_.rgbd, seed_));
  } else {
    take(bench_haptic(std::cerr, haptic_.options));
  }
}

void BenchCommand::run_effects() {
  const EffectCosts costs = effects_.run(app_.count("--rounds") > 0 ? rounds_ : 3);
  if (!effects_.effect.empty()) {
    costs.print(std::cout);  // one of them: nothing is missing
    for (const auto& m : costs.metrics()) metrics_.add(m.name, m.value, m.unit);
  } else {
    take(costs);
  }
  if (!effects_.file.empty()) write_whole_file(effects_.file, effect_costs_toml(costs));
}

void BenchCommand::run_console() {
  take(console_.run(table1_.rgbd, app_.count("--seconds") > 0 ? fuzz_.options.seconds : 0,
                    codec_.long_run, effects_.file, command_line()));
}

std::string BenchCommand::command_line() const {
  std::string command = "teletact";
  for (int i = 0; i < argc_; ++i) command += " " + std::string(argv_[i]);
  return command;
}

}  // namespace

int cmd_bench(int argc, char** argv) { return BenchCommand(argc, argv).run(); }

}  // namespace teletact
