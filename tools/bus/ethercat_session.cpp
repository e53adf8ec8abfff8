#include "tools/bus/ethercat_session.hpp"

#include <stdexcept>

#include "drivers/ethercat/raw_port.hpp"
#include "drivers/ethercat/registers.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

yb::MotorEffects motor_effects(const std::string& file) {
  if (file.empty()) return {};
  const auto read = yb::load_motor_effects(file);
  if (!read) throw std::runtime_error("--effects " + read.error());
  return read.value();
}

void check_choice(const EtherCatChoice& o) {
  if (o.iface.empty() == o.twin.empty())
    throw std::runtime_error("exactly one of --iface IF and --twin KIND");
  if (!o.twin.empty()) return;
  for (const auto& [option, value] :
       {std::pair{"--effects", o.effects}, {"--generation", o.generation}})
    if (!value.empty())
      throw std::runtime_error(std::string(option) + " is of a twin: it needs --twin KIND");
}

EtherCatSession::EtherCatSession(const EtherCatChoice& o) {
  check_choice(o);
  if (!o.twin.empty()) {
    kind_ = yb::chain_kind_of(o.twin);
    if (!kind_)
      throw std::runtime_error("--twin " + o.twin + ": not one of base, base+arm, base+2arms, arm");
    yb::YoubotChainConfig c;
    c.kind = *kind_;
    c.generation = o.generation == "old" ? yb::Generation::kOld : yb::Generation::kNew;
    c.end_stops = o.end_stops;
    c.effects = motor_effects(o.effects);
    chain_ = std::make_unique<yb::YoubotChain>(token(), c);
    wire_ = std::make_unique<ec::TwinPort>(chain_->wire());
  } else {
    auto port = ec::RawPort::open(token(), o.iface);
    if (!port) throw std::runtime_error(port.error());
    wire_ = std::move(port.value());
    // Behind the port, whose errors are about the card itself.
    if (!o.looks) {
      auto claim = ec::claim_silent_card(token(), o.iface);
      if (!claim) throw CouldNotDo(claim.error());
      claim_ = std::move(claim.value());
    }
  }
  port_ = wire_.get();
  if (!o.capture.empty()) {
    auto capture = ec::CapturePort::open(token(), *wire_, o.capture);
    if (!capture) throw std::runtime_error("--capture " + capture.error());
    capture_ = std::move(capture.value());
    port_ = capture_.get();
  }
  master_ = std::make_unique<ec::Master>(token(), *port_);
}

EtherCatSession::~EtherCatSession() { master_->stop(startup_.token()); }

void EtherCatSession::find() {
  const auto found = master_->find(token());
  if (!found) throw CouldNotDo(found.error());
}

std::size_t EtherCatSession::slave(int number) const {
  const auto n = static_cast<int>(master_->slaves().size());
  if (number < 1 || number > n)
    throw std::runtime_error("--slave " + std::to_string(number) + ": the chain has " +
                             std::to_string(n) + " slaves");
  return static_cast<std::size_t>(number - 1);
}

int EtherCatSession::count() {
  const auto n = registers().count_slaves();
  if (!n)
    throw CouldNotDo(port().link_up()
                         ? "EtherCAT: no frame came back: no slave, or no cable to the first one"
                         : "EtherCAT: no frame came back, the card has no link: look at the cable "
                           "to the first slave, "
                           "and whether the robot has power");
  return *n;
}

bool EtherCatSession::look(int position, std::uint16_t reg, std::span<std::uint8_t> into) {
  return registers().read_at(position, reg, into);
}

void EtherCatSession::finish() {
  master_->stop(token());
  if (capture_ && !capture_->close())
    throw std::runtime_error("--capture: the file could not be written to its end");
}

}  // namespace teletact
