// A haptic run on disk: all inputs and outputs of the task, tick by tick. A run can so be repeated
// to the last bit, or the same hand on the same surface can be rendered by another method.
//
//   header   "telehapt", uint32 version (1), uint32 bytes of what follows
//            period_s, origin (3), the device's stated numbers, then every key of [haptic] by name
//   records  uint8 tag, uint32 bytes, payload; in the order in which the task met them
//            'W' window: a SurfacePatch; material and free bits run-length coded, distances of the
//                        observed nodes only (the others are never read)
//            'S' ray cast of method force_shading
//            'T' tick: times, stylus, mode, clutch, then force, raw force, proxy
//            'E' end: uint64 ticks; without it the file was cut off; nothing may follow
//
// Little-endian, doubles as their bytes. The file may come from anywhere: every length and count is
// checked before memory is allocated, every number before it is used. Errors are one line: file,
// what.
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "drivers/haptic/haptic_device.hpp"
#include "perception/patch/surface_patch.hpp"
#include "rt/result.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace teletact {

struct HapticRunHeader {
  tasks::HapticConfig config;
  drivers::DeviceProperties device;
  double period_s = 1e-3;
  perception::Vec3 origin = perception::Vec3::Zero();  // added to positions in traces
};

struct HapticRunTick {
  rt::Tick tick;
  drivers::StylusSample stylus;
  bool stylus_ok = true;
  bool clutch = false;
  std::optional<double> view_yaw_rad;
  tasks::Mode mode = tasks::Mode::kHold;
  std::uint64_t mode_seq = 1;
  // What the task answered.
  perception::Vec3 f_D = perception::Vec3::Zero(), f_raw_D = f_D, p_WP = f_D, p_WH = f_D;
  std::int32_t contacts = 0;
  bool in_contact = false;
};

// Of a tick as the task has it.
[[nodiscard]] HapticRunTick run_tick(const rt::Tick&, const tasks::HapticTask::In&,
                                     const tasks::HapticTask::Out&) noexcept;
// And back: everything but patch and surface.
void set_inputs(const HapticRunTick&, tasks::HapticTask::In&) noexcept;

class HapticRunWriter {
 public:
  // Writes to an open file, which stays the caller's. Throws std::runtime_error when the disk is
  // full.
  HapticRunWriter(std::FILE* file, const HapticRunHeader& header);
  void window(const perception::SurfacePatch& patch);
  void surface(const tasks::SurfacePoints& points);
  void tick(const HapticRunTick& t);
  void finish();

 private:
  void record(char tag);
  std::FILE* file_;
  std::string bytes_;  // of the record that is being made
  std::uint64_t ticks_ = 0;
};

class HapticRunReader {
 public:
  enum class Kind : std::uint8_t { kWindow, kSurface, kTick, kEnd };

  // Reads the header. The file is the caller's and must outlive the reader.
  [[nodiscard]] static rt::Result<std::unique_ptr<HapticRunReader>> open(std::FILE* file,
                                                                         const std::string& name);
  [[nodiscard]] const HapticRunHeader& header() const { return header_; }
  // The next record goes into whichever it is. A window whose fields no map can have is an error.
  [[nodiscard]] rt::Result<Kind> next(perception::SurfacePatch& window,
                                      tasks::SurfacePoints& surface, HapticRunTick& tick);

 private:
  HapticRunReader(std::FILE* file, std::string name) : file_(file), name_(std::move(name)) {}
  [[nodiscard]] rt::Error error(const std::string& what) const { return {name_ + ": " + what}; }
  [[nodiscard]] bool fetch(std::size_t bytes);
  std::FILE* file_;
  std::string name_;
  HapticRunHeader header_;
  std::string bytes_;
  std::uint64_t ticks_ = 0;
};

// A run on disk, open, with its header read. Throws std::runtime_error with one line.
struct OpenHapticRun {
  explicit OpenHapticRun(const std::string& path);
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file;
  std::unique_ptr<HapticRunReader> reader;
};

}  // namespace teletact
