// The calibration drive: forwards and back, sideways, turns both ways, circles both ways. About one
// minute, slowly.
#pragma once

#include <string>
#include <vector>

#include "perception/geometry/planar.hpp"

namespace teletact {

struct DriveLeg {
  const char* what = "";
  perception::Twist2 v;  // in the body frame, at full speed
  double seconds = 0;    // with both ramps
};

class DriveScript {
 public:
  DriveScript();
  [[nodiscard]] const std::vector<DriveLeg>& legs() const { return legs_; }
  [[nodiscard]] double seconds() const;
  // Body twist t seconds after the start; zero before it and after its end.
  [[nodiscard]] perception::Twist2 at(double t) const;
  // What the base's centre keeps to, from its start, x ahead.
  struct Room {
    double x_least_m = 0, x_most_m = 0, y_least_m = 0, y_most_m = 0;
  };
  [[nodiscard]] Room room() const;
  // t_s,vx,vy,wz at 50 Hz.
  [[nodiscard]] std::string csv() const;

  static constexpr double kSpeed_m_per_s = 0.25, kTurn_rad_per_s = 0.5;
  static constexpr double kRamp_s = 0.5, kRest_s = 0.2;

 private:
  std::vector<DriveLeg> legs_;
};

}  // namespace teletact
