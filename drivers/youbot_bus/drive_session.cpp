#include "drivers/youbot_bus/drive_session.hpp"

#include <algorithm>

#include "drivers/tmcl/tmcl_status.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr rt::Nanos kBenchPeriod = std::chrono::milliseconds{1};
// A board's own driver waits 100 ms for a joint's reply, 200 for the gripper's. A transfer that is
// lost on the way in each of its phases ends by itself before kMostCycles.
constexpr int kReplyCycles = 200, kMostCycles = 2000, kLateCycles = 20;

bool is_reading(const tmcl::Request& r) {
  return r.command == static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter) ||
         r.command == static_cast<std::uint8_t>(tmcl::Command::kGetGlobal) ||
         r.command == static_cast<std::uint8_t>(tmcl::Command::kFirmwareVersion);
}

// A value that is set may be set twice, and a refusal of it stands.
bool may_repeat(const tmcl::Request& r, bool replied) {
  if (is_reading(r)) return true;
  return !replied && r.command != static_cast<std::uint8_t>(tmcl::Command::kMoveToPosition);
}

}  // namespace

DriveSession::DriveSession(rt::NonRealtime& nrt, ethercat::Master& master, ethercat::Port& port,
                           ChainKind kind)
    : nrt_(nrt),
      master_(master),
      port_(port),
      boards_(boards_of(kind)),
      silent_(boards_.size()),
      next_(port.now()) {}

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

bool DriveSession::transfer(std::size_t position, const tmcl::Request& request) {
  if (!master_.post(position, tmcl::encode(request), kReplyCycles)) return false;
  (void)cycle_until(kMostCycles, [&] { return !master_.mailbox().busy(); });
  return master_.mailbox().state() == ethercat::TransferState::kDone;
}

// A board that was only slow answers each of the questions: none of these is the next one's answer.
void DriveSession::throw_late_replies_away(std::size_t position) {
  while (master_.post_read(position, kLateCycles)) {
    (void)cycle_until(kMostCycles, [&] { return !master_.mailbox().busy(); });
    if (master_.mailbox().state() != ethercat::TransferState::kDone) return;
  }
}

rt::Result<bool> DriveSession::ask_until(std::size_t position, const tmcl::Request& request,
                                         int most_asks, const Judge& wrong) {
  if (silent_[position]) return rt::Error{name(position) + ": its mailbox is silent"};
  std::string why;
  const rt::Time begun = now();
  bool was_silent = false;
  for (int asks = 1;; ++asks) {
    const bool replied = transfer(position, request);
    if (master_.stopped()) return rt::Error{failed()};
    why = replied ? wrong(master_.mailbox().reply()) : "no reply from its mailbox";
    if (why.empty()) break;
    was_silent = was_silent || !replied;
    if (!replied && now() - begun >= kSilence && request.module == 0) {
      silent_[position] = true;
      why = "its mailbox has been silent for 5 s";
      asks = most_asks;
    }
    if (asks >= most_asks || !may_repeat(request, replied)) {
      if (asks > 1 && replied) why += " (asked " + std::to_string(asks) + " times)";
      return rt::Error{name(position) + ": " + why};
    }
  }
  if (was_silent) throw_late_replies_away(position);
  return true;
}

rt::Result<std::int32_t> DriveSession::ask(std::size_t position, const tmcl::Request& request,
                                           int most_asks) {
  tmcl::Reply reply;
  const auto done = ask_until(position, request, most_asks, [&](Bytes bytes) -> std::string {
    if (!tmcl::decode(bytes, reply) || reply.command != request.command)
      return "its reply is to something else";
    if (reply.status == tmcl::status::kOk) return {};
    return "command " + std::to_string(request.command) + ", number " +
           std::to_string(request.type) + ": " + tmcl::status_text(reply.status);
  });
  if (!done) return rt::Error{done.error()};
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

rt::Result<tmcl::Firmware> DriveSession::version(std::size_t position, std::uint8_t module) {
  tmcl::Firmware out;
  const tmcl::Request request{module, static_cast<std::uint8_t>(tmcl::Command::kFirmwareVersion), 0,
                              0, 0};
  const auto done = ask_until(position, request, kMostAsks, [&](Bytes bytes) -> std::string {
    tmcl::MailboxFrame text{};
    const std::size_t from = module == 0 ? 0 : 1;
    const auto reply = bytes.first(std::min(bytes.size(), tmcl::kMailboxBytes));
    if (reply.size() > from)
      std::copy(reply.begin() + static_cast<std::ptrdiff_t>(from), reply.end(), text.begin());
    const auto version = tmcl::firmware_of(text);
    if (!version)
      return module == 0 ? "its firmware's version is no text" : "its gripper's version is no text";
    out = *version;
    return {};
  });
  if (!done) return rt::Error{done.error()};
  return out;
}

rt::Result<tmcl::Firmware> DriveSession::firmware(std::size_t position) {
  return version(position, 0);
}

// Its text begins at byte 1 (youbot_driver, YouBotGripper.cpp).
rt::Result<tmcl::Firmware> DriveSession::gripper_firmware(std::size_t position) {
  return version(position, 1);
}

std::string DriveSession::failed() const {
  return master_.stopped() ? "the bus has failed: " + master_.describe(nrt_, master_.health())
                           : std::string{};
}

}  // namespace drivers::youbot_bus
