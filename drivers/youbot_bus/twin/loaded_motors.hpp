// The motors of one arm, or of one wheel, that move together on one grid of time: 100 us from time
// 0, as the ideal motor. What one arm joint bears depends on where all of its arm are.
//
// Lazy, for all of them at once: whoever asks for an instant moves all up to it. So what one of
// them is told for an instant that has passed counts from now on. What boards know ahead, the end
// of their patience with a silent wire, they tell ahead (stop_from).
// One owner; nothing allocates after construction.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "drivers/youbot/arm_gravity.hpp"
#include "drivers/youbot_bus/twin/loaded_drive.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::youbot_bus {

// How an arm's outputs become the angles of its description: q = sign * (output - zero).
struct ArmWeight {
  ArmMasses masses;
  std::array<int, kArmJoints> sign{};
  std::array<double, kArmJoints> zero_rad{};
};

class LoadedMotors {
 public:
  // `weight`: of five joints.
  LoadedMotors(rt::NonRealtime&, const std::vector<LoadedDriveConfig>&,
               const std::optional<ArmWeight>& weight);

  void command(std::size_t i, const MotorCommand&, rt::Time at) noexcept;
  [[nodiscard]] MotorMotion motion(std::size_t i, rt::Time at) noexcept;
  void stop_from(std::size_t i, rt::Time at) noexcept { drives_[i].stop_at = at; }
  [[nodiscard]] bool take_trip(std::size_t i, rt::Time at, rt::Time& when) noexcept;
  [[nodiscard]] double heat_A2(std::size_t i) const noexcept { return drives_[i].drive.heat_A2(); }
  void limit_current(std::size_t i, double limit_A) noexcept {
    drives_[i].drive.limit_current(limit_A);
  }
  // The truth behind the gear.
  [[nodiscard]] double output_rad(std::size_t i, rt::Time at) noexcept;
  // Of the arm's description; zeros where there is no weight.
  [[nodiscard]] ArmAngles angles_rad() const noexcept;

 private:
  struct Member {
    LoadedDrive drive;
    rt::Time stop_at = rt::Time::max();
    bool tripped = false;
    rt::Time tripped_at{};
  };
  void advance(rt::Time to) noexcept;
  void step() noexcept;

  std::vector<Member> drives_;
  std::optional<ArmWeight> weight_;
  std::int64_t steps_ = -1;  // sub-steps since time 0; -1: not begun
};

// One of them, for its board.
class LoadedMotor final : public DriveMotor {
 public:
  LoadedMotor(std::shared_ptr<LoadedMotors> all, std::size_t i) noexcept
      : all_(std::move(all)), i_(i) {}
  void command(const MotorCommand& c, rt::Time at) noexcept override { all_->command(i_, c, at); }
  [[nodiscard]] MotorMotion motion(rt::Time at) noexcept override { return all_->motion(i_, at); }
  void stop_from(rt::Time at) noexcept override { all_->stop_from(i_, at); }
  [[nodiscard]] bool take_trip(rt::Time at, rt::Time& when) noexcept override {
    return all_->take_trip(i_, at, when);
  }
  [[nodiscard]] double heat_A2() const noexcept override { return all_->heat_A2(i_); }
  void limit_current(double limit_A) noexcept override { all_->limit_current(i_, limit_A); }
  [[nodiscard]] LoadedMotors& all() noexcept { return *all_; }
  [[nodiscard]] double output_rad(rt::Time at) noexcept { return all_->output_rad(i_, at); }

 private:
  std::shared_ptr<LoadedMotors> all_;
  std::size_t i_;
};

}  // namespace drivers::youbot_bus
