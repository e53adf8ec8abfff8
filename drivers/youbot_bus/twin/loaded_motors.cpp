#include "drivers/youbot_bus/twin/loaded_motors.hpp"

#include <algorithm>
#include <stdexcept>

namespace drivers::youbot_bus {

namespace {

constexpr std::int64_t kLoadStep_ns = 100'000;
constexpr double kLoadStep_s = 1e-9 * kLoadStep_ns;
// As the ideal motor's: a bound on the work after a long time in which nobody asked.
constexpr std::int64_t kMostLoadSteps = 100'000;

}  // namespace

LoadedMotors::LoadedMotors(rt::NonRealtime&, const std::vector<LoadedDriveConfig>& drives,
                           const std::optional<ArmWeight>& weight)
    : weight_(weight) {
  if (weight && drives.size() != static_cast<std::size_t>(kArmJoints))
    throw std::invalid_argument("the weight of an arm is borne by five joints");
  for (const LoadedDriveConfig& c : drives) drives_.push_back({LoadedDrive(c)});
}

ArmAngles LoadedMotors::angles_rad() const noexcept {
  ArmAngles q{};
  if (!weight_) return q;
  for (std::size_t j = 0; j < q.size(); ++j)
    q[j] = weight_->sign[j] * (drives_[j].drive.output_rad() - weight_->zero_rad[j]);
  return q;
}

void LoadedMotors::step() noexcept {
  ArmAngles load_Nm{};
  if (weight_) {
    load_Nm = arm_gravity_Nm(angles_rad(), weight_->masses);
    for (std::size_t j = 0; j < load_Nm.size(); ++j) load_Nm[j] *= weight_->sign[j];
  }
  const rt::Time begin = rt::time_from_ns(steps_ * kLoadStep_ns);
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    Member& m = drives_[i];
    if (begin >= m.stop_at) {
      m.drive.command({});
      m.stop_at = rt::Time::max();
    }
    const double load = weight_ ? load_Nm[i] : 0;
    if (!m.drive.step(kLoadStep_s, load)) continue;
    m.tripped = true;
    m.tripped_at = begin + rt::Nanos{kLoadStep_ns};
  }
}

void LoadedMotors::advance(rt::Time to) noexcept {
  const std::int64_t target = rt::ns_of(to) / kLoadStep_ns;
  if (steps_ < 0) steps_ = target;
  steps_ = std::max(steps_, target - kMostLoadSteps);
  for (; steps_ < target; ++steps_) step();
}

void LoadedMotors::command(std::size_t i, const MotorCommand& c, rt::Time at) noexcept {
  advance(at);
  drives_[i].drive.command(c);
}

MotorMotion LoadedMotors::motion(std::size_t i, rt::Time at) noexcept {
  advance(at);
  return drives_[i].drive.motion();
}

double LoadedMotors::output_rad(std::size_t i, rt::Time at) noexcept {
  advance(at);
  return drives_[i].drive.output_rad();
}

bool LoadedMotors::take_trip(std::size_t i, rt::Time at, rt::Time& when) noexcept {
  advance(at);
  if (!drives_[i].tripped) return false;
  drives_[i].tripped = false;
  when = drives_[i].tripped_at;
  return true;
}

}  // namespace drivers::youbot_bus
