#include "tools/measure/bench/table1_instructions.hpp"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <type_traits>

#include "tools/measure/bench/callgrind.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

class Scratch {
 public:
  Scratch() : path_((fs::temp_directory_path() / "teletact_count_XXXXXX").string()) {
    if (::mkdtemp(path_.data()) == nullptr) throw std::runtime_error(path_ + ": can not be made");
  }
  ~Scratch() {
    std::error_code ec;
    fs::remove_all(path_, ec);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

void write_frames(const FusionSequence& sequence, int frames, const std::string& path) {
  static_assert(std::is_trivially_copyable_v<perception::RgbdFrame>);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "wbe"),
                                                             &std::fclose);
  if (!file) throw std::runtime_error(path + ": can not be written");
  const auto frame = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < frames; ++i) {
    sequence.frame(i, *frame);
    if (std::fwrite(frame.get(), sizeof *frame, 1, file.get()) != 1)
      throw std::runtime_error(path + ": can not be written");
  }
}

struct Setting {
  double voxel_m;
  int level;
};
constexpr Setting kSettings[] = {{0.02, 0}, {0.02, 2}, {0.01, 0}};

void count(std::ostream& progress, const std::string& program, const FusionSequence& sequence,
           InstructionsResult& out) {
  const Scratch scratch;
  const std::string file = scratch.path() + "/frames.raw";
  if (sequence.size() < out.frames)
    throw std::runtime_error(sequence.name + " has fewer images than are counted");
  write_frames(sequence, out.frames, file);
  for (const Setting& s : kSettings) {
    InstructionsRow& row = out.rows.emplace_back();
    row.sequence = sequence.name;
    row.voxel_m = s.voxel_m;
    row.level = s.level;
    for (const bool on : {false, true}) {
      progress << "callgrind: " << sequence.name << ", " << 1e3 * s.voxel_m << " mm, level "
               << s.level << ", watch " << (on ? "on" : "off") << std::endl;
      (on ? row.frame : row.frame_without) =
          callgrind_count(
              program,
              {file, std::to_string(s.voxel_m), std::to_string(s.level), on ? "on" : "off"},
              "tasks::FusionTask::*_step*", scratch.path()) /
          out.frames;
    }
    if (!(row.frame_without > 1e6))
      throw std::runtime_error("callgrind counted nothing of " + sequence.name);
  }
}

}  // namespace

InstructionsResult count_table1(std::ostream& progress, const Table1Options& options, int frames) {
  InstructionsResult out;
  out.frames = frames;
  const std::string program = own_folder() + "/teletact_fusion_count";
  if (!fs::exists(program)) {
    out.not_counted = "the counting program is not beside this one";
  } else if (!have_valgrind()) {
    out.not_counted = "valgrind is not installed";
  }
  if (!out.not_counted.empty()) return out;
  if (!options.rgbd.empty()) {
    RecordingOptions recording;
    recording.frames = recording.at_least = frames;
    recording.pinhole = options.pinhole;
    count(progress, program, recorded_sequence(progress, options.rgbd, recording), out);
  }
  rt::Startup startup;
  if (options.synthetic)
    count(progress, program, synthetic_sequence(startup.token(), furnished_room(), frames), out);
  return out;
}

std::vector<Limit> InstructionsResult::limits() const {
  Limits all;
  for (const auto& r : rows) {
    char name[160];
    std::snprintf(name, sizeof name, "%s %.0f mm, level %d, watch adds, %%", r.sequence.c_str(),
                  1e3 * r.voxel_m, r.level);
    all.add(name, 100 * r.added(), "<=", 3);
  }
  return all.all();
}

std::vector<BenchMetric> InstructionsResult::metrics() const {
  std::vector<BenchMetric> out;
  for (const auto& r : rows) {
    char name[160];
    std::snprintf(name, sizeof name, "table1.instructions.%s.%.0fmm.%d.", r.sequence.c_str(),
                  1e3 * r.voxel_m, r.level);
    out.push_back({name + std::string("frame"), r.frame, "1"});
    out.push_back({name + std::string("watch_share"), r.added(), "1"});
  }
  return out;
}

void InstructionsResult::print(std::ostream& out) const {
  if (!not_counted.empty()) {
    out << "not counted: " << not_counted << "\n";
    return;
  }
  char line[200];
  std::snprintf(line, sizeof line, "%-12s %6s %6s %14s %16s %8s   (%d frames, AVX2)\n", "sequence",
                "voxel", "level", "M a frame", "without watch", "added", frames);
  out << line;
  for (const auto& r : rows) {
    std::snprintf(line, sizeof line, "%-12s %3.0f mm %6d %14.2f %16.2f %7.2f %%\n",
                  r.sequence.c_str(), 1e3 * r.voxel_m, r.level, 1e-6 * r.frame,
                  1e-6 * r.frame_without, 100 * r.added());
    out << line;
  }
  teletact::print(out, limits());
}

}  // namespace teletact
