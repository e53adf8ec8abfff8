#include "drivers/youbot_bus/drive_session.hpp"

#include <algorithm>

#include "drivers/tmcl/tmcl_status.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr rt::Nanos kBenchPeriod = std::chrono::milliseconds{1};
constexpr int kReplyCycles = 400;

}  // namespace

DriveSession::DriveSession(rt::NonRealtime& nrt, ethercat::Master& master, ethercat::Port& port,
                           ChainKind kind)
    : nrt_(nrt), master_(master), port_(port), boards_(boards_of(kind)), next_(port.now()) {}

std::vector<std::size_t> DriveSession::drives() const {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < boards_.size(); ++i)
    if (boards_[i].is_drive()) out.push_back(i);
  return out;
}

std::vector<std::size_t> DriveSession::joints(int arm) const {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < boards_.size(); ++i)
    if (boards_[i].kind == BoardKind::kJoint && boards_[i].arm == arm) out.push_back(i);
  return out;
}

bool DriveSession::cycle() {
  // A cycle that comes late is no reason to send the next ones in a burst.
  next_ = std::max(next_ + kBenchPeriod, port_.now());
  port_.sleep_until(next_);
  (void)master_.exchange();
  return !master_.stopped();
}

bool DriveSession::cycle_until(int most, const std::function<bool()>& done) {
  for (int i = 0; i < most; ++i) {
    if (!cycle()) return false;
    if (done()) return true;
  }
  return false;
}

void DriveSession::set(std::size_t position, const DriveOutputs& o) {
  (void)encode(o, master_.outputs(position));
}

DriveOutputs DriveSession::command(std::size_t position) const {
  DriveOutputs o;
  (void)decode(std::span<const std::uint8_t>(master_.outputs(position)), o);
  return o;
}

void DriveSession::stop_all() { master_.clear_outputs(); }

DriveInputs DriveSession::inputs(std::size_t position) const {
  DriveInputs in;
  (void)decode(master_.inputs(position), in);
  return in;
}

rt::Result<std::vector<std::uint8_t>> DriveSession::transfer(std::size_t position,
                                                             const tmcl::Request& request) {
  const auto bytes = tmcl::encode(request);
  if (!master_.post(position, bytes)) return rt::Error{name(position) + ": its mailbox is busy"};
  (void)cycle_until(kReplyCycles, [&] { return !master_.mailbox().busy(); });
  if (master_.stopped()) return rt::Error{failed()};
  if (master_.mailbox().state() != ethercat::TransferState::kDone)
    return rt::Error{name(position) + ": no reply from its mailbox"};
  const auto reply = master_.mailbox().reply();
  return std::vector<std::uint8_t>(reply.begin(), reply.end());
}

rt::Result<std::int32_t> DriveSession::ask(std::size_t position, const tmcl::Request& request) {
  const auto bytes = transfer(position, request);
  if (!bytes) return rt::Error{bytes.error()};
  tmcl::Reply reply;
  if (!tmcl::decode(bytes.value(), reply) || reply.command != request.command)
    return rt::Error{name(position) + ": its reply is to something else"};
  if (reply.status != tmcl::status::kOk)
    return rt::Error{name(position) + ": command " + std::to_string(request.command) + ", number " +
                     std::to_string(request.type) + ": " + tmcl::status_text(reply.status)};
  return reply.value;
}

rt::Result<std::int32_t> DriveSession::get(std::size_t position, std::uint8_t parameter) {
  return ask(position,
             {0, static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter), parameter, 0, 0});
}

rt::Result<bool> DriveSession::put(std::size_t position, std::uint8_t parameter,
                                   std::int32_t value) {
  const auto done = ask(position, {0, static_cast<std::uint8_t>(tmcl::Command::kSetAxisParameter),
                                   parameter, 0, value});
  if (!done) return rt::Error{done.error()};
  if (done.value() != value) return rt::Error{name(position) + ": a value comes back as another"};
  return true;
}

rt::Result<tmcl::Firmware> DriveSession::firmware(std::size_t position) {
  const auto bytes =
      transfer(position, {0, static_cast<std::uint8_t>(tmcl::Command::kFirmwareVersion), 0, 0, 0});
  if (!bytes) return rt::Error{bytes.error()};
  const auto text = std::span(bytes.value()).first(tmcl::kMailboxBytes);
  const auto version = tmcl::firmware_of(text);
  if (!version) return rt::Error{name(position) + ": its firmware's version is no text"};
  return *version;
}

// Its text begins at byte 1 (youbot_driver, YouBotGripper.cpp).
rt::Result<tmcl::Firmware> DriveSession::gripper_firmware(std::size_t position) {
  const auto bytes =
      transfer(position, {1, static_cast<std::uint8_t>(tmcl::Command::kFirmwareVersion), 0, 0, 0});
  if (!bytes) return rt::Error{bytes.error()};
  tmcl::MailboxFrame text{};
  const auto reply = std::span(bytes.value()).first(tmcl::kMailboxBytes);
  std::copy(reply.begin() + 1, reply.end(), text.begin());
  const auto version = tmcl::firmware_of(text);
  if (!version) return rt::Error{name(position) + ": its gripper's version is no text"};
  return *version;
}

std::string DriveSession::failed() const {
  return master_.stopped() ? "the bus has failed: " + master_.describe(nrt_, master_.health())
                           : std::string{};
}

}  // namespace drivers::youbot_bus
