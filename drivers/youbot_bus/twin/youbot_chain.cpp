#include "drivers/youbot_bus/twin/youbot_chain.hpp"

#include <array>
#include <cmath>
#include <string>

#include "drivers/ethercat/twin/sii_builder.hpp"

namespace drivers::youbot_bus {

namespace {

// Trinamic (youbot_driver, its SOEM patch). Product codes are not published: ours.
constexpr std::uint32_t kTrinamic = 0x0286;

std::string board_name(const BoardPlace& b, Generation g) {
  const bool old = g == Generation::kOld;
  switch (b.kind) {
    case BoardKind::kBaseMaster:
      return "KR-845";
    case BoardKind::kWheel:
      return old ? "TMCM-174" : "TMCM-1632";
    case BoardKind::kArmMaster:
      return old ? "KR-843" : "KR-845";
    case BoardKind::kJoint:
      return old ? "TMCM-KR-841" : "TMCM-1610";
  }
  return {};
}

std::size_t input_bytes_of(const YoubotChainConfig& c) {
  if (c.input_bytes != 0) return c.input_bytes;
  return c.generation == Generation::kOld ? 20 : 32;
}

std::int32_t milli(double value) { return static_cast<std::int32_t>(std::lround(1e3 * value)); }

DriveBoardConfig board_config(const BoardPlace& b, const YoubotChainConfig& c) {
  const bool old = c.generation == Generation::kOld;
  const bool wheel = b.kind == BoardKind::kWheel;
  DriveBoardConfig out;
  out.controller = wheel ? (old ? 174 : 1632) : (old ? 841 : 1610);
  out.firmware = old ? 148 : 200;
  out.has_gripper = b.kind == BoardKind::kJoint && b.number == 5;
  out.initialised = c.initialised;
  const MotorEffects& e = c.effects;
  if (e.current_limit) out.max_current_mA = milli(e.current_limit->limit_A.of(b));
  if (e.i2t) {
    out.thermal_ms = milli(e.i2t->winding_s);
    out.rated_mA = milli(e.i2t->rated_A.of(b));
  }
  return out;
}

// Travel of each joint in ticks of its motor (arm 1: 4000 * 156 * 338 / 360), from its stop, where
// homing ends, downwards.
constexpr std::array<double, 5> kTravel_ticks{585867, 268667, 330000, 161733, 264278};

IdealMotorConfig own_config(const BoardPlace& b, const YoubotChainConfig& c) {
  IdealMotorConfig m;
  if (c.end_stops && b.kind == BoardKind::kJoint) {
    // A homing stop that is not where the encoder happened to begin.
    m.high_stop_ticks = 1234.0 * b.number;
    m.low_stop_ticks = m.high_stop_ticks - kTravel_ticks[static_cast<std::size_t>(b.number - 1)];
    m.start_ticks = m.high_stop_ticks - 0.1 * b.number * kTravel_ticks[0] / 5;
  }
  return m;
}

// The motors of a chain that brings its own: ideal ones, or under effects an arm's as one.
class OwnMotors {
 public:
  OwnMotors(rt::NonRealtime& nrt, const YoubotChainConfig& c) : nrt_(nrt), c_(c) {}
  std::unique_ptr<DriveMotor> motor(const BoardPlace& b) {
    if (!c_.effects.any()) return std::make_unique<IdealMotor>(own_config(b, c_));
    if (b.kind == BoardKind::kWheel) {
      const auto config = loaded_config(b, c_.effects, own_config(b, c_));
      return std::make_unique<LoadedMotor>(
          std::make_shared<LoadedMotors>(nrt_, std::vector{config}, std::nullopt), 0);
    }
    if (b.arm != arm_) joints_ = arm(b.arm);
    arm_ = b.arm;
    return std::make_unique<LoadedMotor>(joints_, static_cast<std::size_t>(b.number - 1));
  }

 private:
  std::shared_ptr<LoadedMotors> arm(int number) {
    std::vector<LoadedDriveConfig> configs;
    for (int j = 1; j <= kArmJoints; ++j) {
      const BoardPlace b{BoardKind::kJoint, j, number};
      configs.push_back(loaded_config(b, c_.effects, own_config(b, c_)));
    }
    return std::make_shared<LoadedMotors>(nrt_, configs, arm_weight(c_.effects, configs));
  }
  rt::NonRealtime& nrt_;
  const YoubotChainConfig& c_;
  int arm_ = 0;
  std::shared_ptr<LoadedMotors> joints_;
};

void add_drive_content(ethercat::SiiBuilder& sii, const YoubotChainConfig& c) {
  const auto size = c.mailbox_bytes;
  const auto in_start = static_cast<std::uint16_t>(c.mailbox_start + size);
  const std::size_t inputs = input_bytes_of(c);
  const std::uint8_t outputs_control = c.data_watchdog ? 0x64 : 0x24;
  // No protocol of the standard: raw TMCL. A master that goes by this word alone leaves the mailbox
  // off; the board reaches OP without it.
  sii.mailbox(c.mailbox_start, size, in_start, size, 0);
  sii.fmmus({1, 2});
  sii.managers({{c.mailbox_start, size, 0x26, 1, 1},
                {in_start, size, 0x22, 1, 2},
                {c.outputs_start, static_cast<std::uint16_t>(kOutputBytes), outputs_control, 1, 3},
                {c.inputs_start, static_cast<std::uint16_t>(inputs), 0x20, 1, 4}});
  if (inputs == 16) sii.pdo(true, 0x1A00, 3, {32, 32, 32, 16, 16});
  if (inputs == 18) sii.pdo(true, 0x1A00, 3, {32, 32, 32, 32, 16});
  if (inputs == 20) sii.pdo(true, 0x1A00, 3, {32, 32, 32, 32, 32});
  if (inputs == 32) sii.pdo(true, 0x1A00, 3, {32, 32, 32, 32, 32, 32, 32, 32});
  sii.pdo(false, 0x1600, 2, {32, 8});
}

}  // namespace

std::vector<std::uint8_t> youbot_eeprom(const BoardPlace& b, const YoubotChainConfig& c,
                                        std::uint32_t serial) {
  ethercat::SiiBuilder sii;
  const std::uint32_t product = 0x100 + static_cast<std::uint32_t>(b.kind);
  sii.identity(kTrinamic, product, c.generation == Generation::kOld ? 1 : 2, serial);
  const std::string name = board_name(b, c.generation);
  sii.strings({name, "youBot"});
  sii.general(2, 1, 1, c.forbids_lrw && b.is_drive() ? 0x02 : 0);
  if (b.is_drive()) add_drive_content(sii, c);
  return sii.image();
}

YoubotChain::YoubotChain(rt::NonRealtime& nrt, const YoubotChainConfig& c, const MotorMaker& motor)
    : boards_(boards_of(c.kind)) {
  std::uint32_t serial = c.first_serial;
  OwnMotors own(nrt, c);
  for (const BoardPlace& b : boards_) {
    std::unique_ptr<ethercat::EscApplication> application;
    DriveBoard* drive = nullptr;
    if (b.is_drive()) {
      auto m = motor ? motor(b) : own.motor(b);
      auto made = std::make_unique<DriveBoard>(nrt, board_config(b, c), std::move(m));
      drive = made.get();
      application = std::move(made);
    } else {
      application = std::make_unique<ethercat::EscApplication>();
    }
    drives_.push_back(drive);
    chain_.add(std::make_unique<ethercat::Esc>(nrt, c.esc, youbot_eeprom(b, c, serial++),
                                               std::move(application)));
  }
}

// The master board of the platform (or of an arm alone) has the computer's supply.
void YoubotChain::emergency_stop() noexcept { chain_.cut_behind(1); }

void YoubotChain::release_emergency_stop(rt::Time now) noexcept {
  for (std::size_t i = 1; i < chain_.size(); ++i) chain_.slave(i).power_cycle(now);
  chain_.cut_behind(chain_.size());
}

}  // namespace drivers::youbot_bus
