#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"

#include <numbers>
#include <stdexcept>

namespace drivers::youbot_bus {

namespace {

constexpr rt::Nanos kPeriod = std::chrono::milliseconds{1};

void require(const rt::Result<bool>& r) {
  if (!r) throw std::runtime_error(r.error());
}

}  // namespace

// The four motors as one: what they are told is handed to the robot's bus once a cycle, what it
// says is what each encoder shows until the next cycle.
class EtherCatTwinBus::Wheels {
 public:
  Wheels(MotorBus& robot, const MotorBusConfig& c)
      : robot_(robot),
        ticks_per_rad_(c.ticks_per_motor_turn * c.gear_ratio / (2 * std::numbers::pi)),
        rad_per_s_per_rpm_(2 * std::numbers::pi / 60 / c.gear_ratio) {}

  void rearm() noexcept { robot_.rearm(); }
  void make_safe() noexcept { robot_.make_safe(); }
  void command(std::size_t w, const MotorCommand& c) noexcept {
    const bool turns = c.mode == ControllerMode::kVelocity;
    told_.wheel_rad_per_s[w] = turns ? c.value * rad_per_s_per_rpm_ : 0;
    turning_ = turns ? turning_ | 1U << w : turning_ & ~(1U << w);
    told_.mode = turning_ != 0 ? MotorMode::kVelocity : MotorMode::kStop;
  }
  [[nodiscard]] BusStatus sense(rt::Time now) noexcept { return robot_.sense(now, states_); }
  [[nodiscard]] BusStatus act(rt::Time now) noexcept { return robot_.act(now, told_); }
  [[nodiscard]] MotorMotion motion(std::size_t w) const noexcept {
    return {states_.wheel_rad[w] * ticks_per_rad_, states_.wheel_rad_per_s[w] / rad_per_s_per_rpm_,
            1e3 * states_.current_A[w]};
  }

 private:
  MotorBus& robot_;
  double ticks_per_rad_, rad_per_s_per_rpm_;
  unsigned turning_ = 0;
  MotorSetpoints told_;
  MotorStates states_;
};

class EtherCatTwinBus::Wheel final : public DriveMotor {
 public:
  Wheel(Wheels& all, std::size_t w) noexcept : all_(all), w_(w) {}
  void command(const MotorCommand& c, rt::Time) noexcept override { all_.command(w_, c); }
  [[nodiscard]] MotorMotion motion(rt::Time) noexcept override { return all_.motion(w_); }

 private:
  Wheels& all_;
  std::size_t w_;
};

YoubotChainConfig EtherCatTwinBus::base_alone() {
  YoubotChainConfig c;
  c.kind = ChainKind::kBase;
  c.initialised = true;
  return c;
}

EtherCatTwinBus::EtherCatTwinBus(rt::NonRealtime& nrt, MotorBus& robot,
                                 const YoubotChainConfig& chain, const MotorBusConfig& motors)
    : wheels_(std::make_unique<Wheels>(robot, motors)) {
  if (chain.kind == ChainKind::kArm)
    throw std::runtime_error("the bus of an arm alone has no wheels");
  chain_ = std::make_unique<YoubotChain>(
      nrt, chain, [&](const BoardPlace& b) -> std::unique_ptr<DriveMotor> {
        if (b.kind != BoardKind::kWheel) return std::make_unique<IdealMotor>();
        return std::make_unique<Wheel>(*wheels_, static_cast<std::size_t>(b.number));
      });
  port_ = std::make_unique<ethercat::TwinPort>(chain_->wire());
  master_ = std::make_unique<ethercat::Master>(nrt, *port_);
  require(master_->find(nrt));
  require(master_->configure(nrt));
  require(master_->start(nrt));
  bus_ = std::make_unique<EtherCatMotorBus>(nrt, *master_, motors);
  bus_->rearm();
  MotorStates ignored;
  for (int i = 0; i < 1000 && bus_->rearming(); ++i) {
    port_->set_now(port_->now() + kPeriod);
    (void)bus_->exchange(port_->now(), {}, ignored);
  }
  if (bus_->rearming()) throw std::runtime_error("the virtual motors' timeout flags do not clear");
}

EtherCatTwinBus::~EtherCatTwinBus() = default;

void EtherCatTwinBus::set_clock(rt::Time now) noexcept {
  if (!begun_) ahead_ = now - (port_->now() + kPeriod);
  begun_ = true;
  port_->set_now(now - ahead_);
}

// First the robot up to now under what it was told last, so the encoders show this instant.
BusStatus EtherCatTwinBus::sense(rt::Time now, MotorStates& states) noexcept {
  set_clock(now);
  const BusStatus robot = wheels_->sense(now);
  const BusStatus frame = bus_->sense(now, states);
  robot_ok_ = robot == BusStatus::kOk;
  return robot != BusStatus::kOk ? robot : frame;
}

// Behind the frame the robot is told what the frame brought.
BusStatus EtherCatTwinBus::act(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  set_clock(now);
  const BusStatus frame = bus_->act(now, setpoints);
  if (frame != BusStatus::kOk) let_boards_run();
  const BusStatus robot = wheels_->act(now);
  robot_ok_ = robot == BusStatus::kOk;
  return robot != BusStatus::kOk ? robot : frame;
}

// A board does what is due when it is asked for something, and behind a cut nobody asks.
void EtherCatTwinBus::let_boards_run() noexcept {
  for (std::size_t i = 0; i < chain_->boards().size(); ++i)
    if (DriveBoard* board = chain_->drive(i); board != nullptr) (void)board->flags(port_->now());
}

BusDetail EtherCatTwinBus::detail() const noexcept {
  return robot_ok_ ? bus_->detail() : BusDetail{};
}

void EtherCatTwinBus::rearm() noexcept {
  wheels_->rearm();
  bus_->rearm();
}

void EtherCatTwinBus::make_safe() noexcept {
  bus_->make_safe();
  wheels_->make_safe();
}

}  // namespace drivers::youbot_bus
