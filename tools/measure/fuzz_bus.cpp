// The readers of what comes over the robot's bus: EtherCAT frames, EEPROM content, CoE replies,
// TMCL, CAN frames; and the file of what homing measured.
#include <cstring>
#include <stdexcept>

#include "drivers/can/can_motor_bus.hpp"
#include "drivers/can/socket_frames.hpp"
#include "drivers/ethercat/coe.hpp"
#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/sii.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/youbot_bus/calibration_file.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

namespace ec = drivers::ethercat;
namespace tmcl = drivers::tmcl;
namespace yb = drivers::youbot_bus;

std::span<const std::uint8_t> bus_bytes(const std::string& b) {
  return {reinterpret_cast<const std::uint8_t*>(b.data()), b.size()};
}

template <class Range>
std::string bus_text(const Range& r) {
  return {r.begin(), r.end()};
}

// Read, and passed through a virtual chain as it is.
rt::Result<bool> read_bus_frame(const std::string& b) {
  static rt::Startup startup;
  static yb::YoubotChain chain(startup.token(), {});
  static std::int64_t ns = 0;
  ec::FrameView v;
  ec::parse_frame(bus_bytes(b), v);
  std::string copy = b;
  chain.wire().pass({reinterpret_cast<std::uint8_t*>(copy.data()), copy.size()},
                    rt::time_from_ns(ns += 100'000));
  if (!v.good()) return rt::Error{to_text(v.fault)};
  return true;
}

rt::Result<bool> read_eeprom(const std::string& b) {
  const auto content = ec::parse_sii(bus_bytes(b));
  if (!content) return rt::Error{content.error()};
  ec::SlaveInfo slave;
  slave.fmmus = slave.sync_managers = 8;
  slave.sii = content.value();
  const auto mapping = ec::map_process_data({slave});
  if (!mapping) return rt::Error{mapping.error()};
  return true;
}

rt::Result<bool> read_sdo(const std::string& b) {
  const auto reply = ec::decode_sdo_reply(bus_bytes(b), {0x1018, 1}, true);
  if (!reply) return rt::Error{reply.error()};
  if (reply.value().other) return rt::Error{"another message"};
  return true;
}

rt::Result<bool> read_tmcl(const std::string& b) {
  tmcl::MailboxFrame frame{};
  tmcl::Reply reply;
  if (!tmcl::from_serial(bus_bytes(b), frame) || !tmcl::decode(frame, reply))
    return rt::Error{"no TMCL of nine bytes"};
  (void)tmcl::firmware_of(frame);
  return true;
}

// What the bytes say has arrived: frames of the kernel, one after the other.
class FedCanPort final : public drivers::can::CanPort {
 public:
  [[nodiscard]] int send(rt::Time, std::span<const drivers::can::CanFrame> f) noexcept override {
    return static_cast<int>(f.size());
  }
  [[nodiscard]] int receive(rt::Time now, std::span<drivers::can::Received> out) noexcept override {
    int n = 0;
    for (; at + sizeof(can_frame) <= bytes.size() && n < static_cast<int>(out.size());
         at += sizeof(can_frame)) {
      can_frame k{};
      std::memcpy(&k, bytes.data() + at, sizeof k);
      auto& r = out[static_cast<std::size_t>(n)];
      switch (drivers::can::from_kernel(k, sizeof k, r.frame)) {
        case drivers::can::FrameKind::kData:
          r.at = now;
          ++n;
          break;
        case drivers::can::FrameKind::kError:
          watch.take_error(k.can_id, std::span<const std::uint8_t, 8>(k.data));
          break;
        case drivers::can::FrameKind::kOther:
          break;
      }
    }
    return n;
  }
  void send_at_once(std::span<const drivers::can::CanFrame>) noexcept override {}
  [[nodiscard]] drivers::can::PortState state() const noexcept override { return watch.port; }
  [[nodiscard]] drivers::can::BusState bus_state() const noexcept override { return watch.bus; }
  [[nodiscard]] const drivers::can::PortCounters& counters() const noexcept override {
    return watch.counters;
  }
  std::span<const std::uint8_t> bytes;
  std::size_t at = 0;
  drivers::can::BusWatch watch;
};

// Through the motor bus that has asked for them, a millisecond a call.
rt::Result<bool> read_can(const std::string& b) {
  rt::Startup startup;
  FedCanPort port;
  drivers::can::CanMotorBus bus(startup.token(), port);
  drivers::MotorStates states;
  rt::Time now = rt::time_from_ns(1'000'000'000);
  for (int i = 0; i < 6; ++i, now += std::chrono::milliseconds{1}) {
    (void)bus.exchange(now, {}, states);
    if (i == 0) port.bytes = bus_bytes(b);
  }
  if (bus.counters().replies == 0) return rt::Error{"no reply of a module"};
  return true;
}

std::string can_seed() {
  std::string out;
  for (const unsigned module : {1U, 3U, 5U, 7U}) {
    drivers::can::CanFrame f;
    (void)drivers::can::fill(
        f, 2, tmcl::to_can(tmcl::Reply{0, static_cast<std::uint8_t>(module), 100, 3, 0}));
    const can_frame k = drivers::can::to_kernel(f);
    out.append(reinterpret_cast<const char*>(&k), sizeof k);
  }
  return out;
}

void seal_tmcl(std::string& b) {
  if (b.size() != tmcl::kSerialBytes) return;
  b.back() = static_cast<char>(tmcl::checksum(bus_bytes(b).first<tmcl::kMailboxBytes>()));
}

rt::Result<bool> read_homing(const std::string& b) {
  const auto read = yb::read_calibration(b, "calibration");
  if (!read) return rt::Error{read.error()};
  return true;
}

std::string homing_seed() {
  yb::Calibration c;
  c.date = "2026-11-25";
  c.chain = yb::ChainKind::kArm;
  for (const auto& b : yb::boards_of(c.chain)) {
    const bool drive = b.is_drive();
    c.boards.push_back({drive ? "TMCM-1610" : "KR-845", 0x286, 0x100, 2, 7});
    if (drive) c.joints.push_back({b.arm, b.number, 1000 * b.number, 1, 700});
  }
  return yb::calibration_text(c);
}

void seal_homing(std::string& b) {
  const auto last = b.rfind("# check");
  b = yb::with_check(last == std::string::npos ? b : b.substr(0, last));
}

}  // namespace

void FuzzReaders::add_bus() {
  ec::FrameWriter frame;
  if (!frame.add(ec::Command::kBrd, 1, ec::broadcast_address(0x0130), 2) ||
      !frame.add(ec::Command::kFpwr, 1, ec::station_address(0x1001, 0x0800), 8) ||
      !frame.add(ec::Command::kLrw, 1, 0, 64))
    throw std::runtime_error("a frame could not be written");
  ec::FrameWriter many;  // as SOEM asks 64 slaves for their state
  for (std::uint16_t i = 0; i < 64; ++i)
    if (!many.add(ec::Command::kFprd, 1,
                  ec::station_address(static_cast<std::uint16_t>(0x1001 + i), 0x0130), 6))
      throw std::runtime_error("a frame could not be written");
  readers_.push_back({"ethercat_frame",
                      {bus_text(frame.finish()), bus_text(many.finish())},
                      read_bus_frame,
                      {},
                      false});
  std::vector<std::string> eeproms;
  for (const auto& board : yb::boards_of(yb::ChainKind::kBaseArm))
    if (board.number <= 1) eeproms.push_back(bus_text(yb::youbot_eeprom(board, {}, 1)));
  readers_.push_back({"ethercat_eeprom", std::move(eeproms), read_eeprom, {}, false});
  const std::string sdo{'\x0a', 0,      0,      0,      0,      '\x13', 0,      '\x30',
                        '\x43', '\x18', '\x10', '\x01', '\x01', '\x02', '\x03', '\x04'};
  readers_.push_back({"coe_reply", {sdo}, read_sdo, {}, false});
  const auto serial = tmcl::to_serial(tmcl::encode(tmcl::Reply{2, 1, 100, 6, 711}));
  readers_.push_back({"can_replies", {can_seed()}, read_can, {}, false});
  readers_.push_back({"youbot_calibration", {homing_seed()}, read_homing, seal_homing, true});
  readers_.push_back({"tmcl_frame", {bus_text(serial)}, read_tmcl, seal_tmcl, false});
}

}  // namespace teletact
