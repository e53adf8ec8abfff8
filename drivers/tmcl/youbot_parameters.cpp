#include "drivers/tmcl/youbot_parameters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace drivers::tmcl {

namespace {

constexpr auto R = Access::kRead, RW = Access::kReadWrite, P = Access::kProtected,
               W = Access::kWrite;

constexpr std::array kAxisTable{
    AxisParameter{0, "target position", "ticks", RW, 0, 0},
    AxisParameter{1, "actual position", "ticks", RW, 0, 0},
    AxisParameter{2, "target speed", "rpm", RW, -200000, 200000},
    AxisParameter{3, "actual speed", "rpm", R, 0, 0},
    AxisParameter{4, "maximum ramp velocity", "rpm", RW, 0, 200000},
    AxisParameter{5, "PWM limit", "duty", RW, 0, 1799},
    AxisParameter{6, "maximum current", "mA", P, 0, 20000},
    AxisParameter{7, "maximum velocity for position reached", "rpm", RW, 0, 200000},
    AxisParameter{8, "velocity PID switching threshold", "rpm", RW, 0, 200000},
    AxisParameter{9, "motor halted velocity", "rpm", P, 0, 200000},
    AxisParameter{10, "maximum distance for position reached", "ticks", RW, 0, 100000},
    AxisParameter{11, "acceleration", "rpm/s", RW, 0, 100000},
    AxisParameter{12, "position PID switching threshold", "rpm", RW, 0, 200000},
    AxisParameter{13, "ramp generator speed", "rpm", R, 0, 0},
    AxisParameter{14, "velocity threshold for hallFX", "rpm", RW, 0, 200000},
    AxisParameter{15, "BLDC initialised", "flag", RW, 0, 1},
    AxisParameter{25, "thermal winding time constant", "ms", P, 0, 0},
    AxisParameter{26, "I2t limit", "1", P, 0, 0},
    AxisParameter{27, "I2t sum", "1", R, 0, 0},
    AxisParameter{28, "I2t exceed counter", "1", P, 0, 0},
    AxisParameter{29, "clear I2t exceeded flag", "any", W, 0, 0},
    AxisParameter{30, "operating time", "min", R, 0, 0},
    AxisParameter{31, "re-initialise encoder", "any", W, 0, 0},
    AxisParameter{130, "position P, set 1", "1", RW, 0, 0},
    AxisParameter{131, "position I, set 1", "1", RW, 0, 0},
    AxisParameter{132, "position D, set 1", "1", RW, 0, 0},
    AxisParameter{133, "PID period", "ms", P, 0, 0},
    AxisParameter{134, "current loop delay", "50 us", P, 0, 0},
    AxisParameter{135, "position I clipping, set 1", "1", RW, 0, 0},
    AxisParameter{140, "velocity P, set 1", "1", RW, 0, 0},
    AxisParameter{141, "velocity I, set 1", "1", RW, 0, 0},
    AxisParameter{142, "velocity D, set 1", "1", RW, 0, 0},
    AxisParameter{143, "velocity I clipping, set 1", "1", RW, 0, 0},
    AxisParameter{146, "ramp generator", "flag", RW, 0, 1},
    AxisParameter{150, "actual current", "mA", R, 0, 0},
    AxisParameter{151, "supply voltage", "0.01 V", R, 0, 0},
    AxisParameter{152, "driver temperature", "ADC counts", R, 0, 0},
    AxisParameter{155, "target current", "mA", RW, -20000, 20000},
    AxisParameter{156, "error and status flags", "bits", R, 0, 0},
    AxisParameter{157, "module supply current", "mA", R, 0, 0},
    AxisParameter{158, "clear EtherCAT timeout flag", "flag", W, 1, 1},
    AxisParameter{159, "commutation mode", "0..5", P, 0, 5},
    AxisParameter{160, "encoder re-initialisation", "flag", P, 0, 1},
    AxisParameter{161, "encoder zeroing mode", "1", P, 0, 0},
    AxisParameter{163, "encoder clear at next null", "flag", P, 0, 1},
    AxisParameter{164, "active stop switch", "bits", P, 0, 3},
    AxisParameter{165, "commutation offset", "ticks", P, 0, 0},
    AxisParameter{166, "stop switch polarity", "bits", P, 0, 3},
    AxisParameter{167, "block PWM scheme", "0..2", RW, 0, 2},
    AxisParameter{168, "current P, set 1", "1", RW, 0, 0},
    AxisParameter{169, "current I, set 1", "1", RW, 0, 0},
    AxisParameter{170, "current D, set 1", "1", RW, 0, 0},
    AxisParameter{171, "current I clipping, set 1", "1", RW, 0, 0},
    AxisParameter{172, "current P, set 2", "1", RW, 0, 0},
    AxisParameter{173, "current I, set 2", "1", RW, 0, 0},
    AxisParameter{174, "current D, set 2", "1", RW, 0, 0},
    AxisParameter{175, "current I clipping, set 2", "1", RW, 0, 0},
    AxisParameter{177, "commutation motor current", "mA", P, 0, 20000},
    AxisParameter{200, "current error", "mA", R, 0, 0},
    AxisParameter{201, "current error sum", "mA", R, 0, 0},
    AxisParameter{226, "position error", "ticks", R, 0, 0},
    AxisParameter{227, "position error sum", "ticks", R, 0, 0},
    AxisParameter{228, "velocity error", "rpm", R, 0, 0},
    AxisParameter{229, "velocity error sum", "rpm", R, 0, 0},
    AxisParameter{230, "position P, set 2", "1", RW, 0, 0},
    AxisParameter{231, "position I, set 2", "1", RW, 0, 0},
    AxisParameter{232, "position D, set 2", "1", RW, 0, 0},
    AxisParameter{233, "position I clipping, set 2", "1", RW, 0, 0},
    AxisParameter{234, "velocity P, set 2", "1", RW, 0, 0},
    AxisParameter{235, "velocity I, set 2", "1", RW, 0, 0},
    AxisParameter{236, "velocity D, set 2", "1", RW, 0, 0},
    AxisParameter{237, "velocity I clipping, set 2", "1", RW, 0, 0},
    AxisParameter{238, "mass inertia", "1", P, 0, 0},
    AxisParameter{239, "BEMF constant", "1", P, 0, 0},
    AxisParameter{240, "coil resistance", "mOhm", P, 0, 0},
    AxisParameter{241, "sine initialisation velocity", "rpm", P, -200000, 200000},
    AxisParameter{244, "sine initialisation delay", "ms", P, 0, 10000},
    AxisParameter{245, "over-voltage protection", "flag", P, 0, 1},
    AxisParameter{248, "password", "1", RW, 0, 0},
    AxisParameter{249, "initialisation mode", "0..2", RW, 0, 2},
    AxisParameter{250, "encoder steps a turn", "ticks", P, 0, 0},
    AxisParameter{251, "encoder direction", "flag", P, 0, 1},
    AxisParameter{253, "motor poles", "1", P, 2, 254},
    AxisParameter{254, "hall inversion", "flag", P, 0, 1},
};

}  // namespace

std::span<const AxisParameter> axis_parameters() noexcept { return kAxisTable; }

const AxisParameter* find_axis_parameter(int number) noexcept {
  const auto at =
      std::lower_bound(kAxisTable.begin(), kAxisTable.end(), number,
                       [](const AxisParameter& p, int wanted) { return p.number < wanted; });
  return at != kAxisTable.end() && at->number == number ? &*at : nullptr;
}

double driver_temperature_C(std::int32_t adc) noexcept {
  if (adc <= 0 || adc >= 4096) return std::numeric_limits<double>::quiet_NaN();
  const double kohm = 9011.2 / adc - 2.2;
  if (kohm <= 0) return std::numeric_limits<double>::quiet_NaN();
  constexpr double kB = 3434.0, kNominal_K = 298.16;
  return kB * kNominal_K / (kB + std::log(kohm / 10.0) * kNominal_K) - 273.16;
}

}  // namespace drivers::tmcl
