// The readers of what comes over the robot's bus: EtherCAT frames, EEPROM content, CoE replies,
// TMCL.
#include <stdexcept>

#include "drivers/ethercat/coe.hpp"
#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/sii.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
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

void seal_tmcl(std::string& b) {
  if (b.size() != tmcl::kSerialBytes) return;
  b.back() = static_cast<char>(tmcl::checksum(bus_bytes(b).first<tmcl::kMailboxBytes>()));
}

}  // namespace

void FuzzReaders::add_bus() {
  ec::FrameWriter frame;
  if (!frame.add(ec::Command::kBrd, 1, ec::broadcast_address(0x0130), 2) ||
      !frame.add(ec::Command::kFpwr, 1, ec::station_address(0x1001, 0x0800), 8) ||
      !frame.add(ec::Command::kLrw, 1, 0, 64))
    throw std::runtime_error("a frame could not be written");
  readers_.push_back({"ethercat_frame", {bus_text(frame.finish())}, read_bus_frame, {}, false});
  std::vector<std::string> eeproms;
  for (const auto& board : yb::boards_of(yb::ChainKind::kBaseArm))
    if (board.number <= 1) eeproms.push_back(bus_text(yb::youbot_eeprom(board, {}, 1)));
  readers_.push_back({"ethercat_eeprom", std::move(eeproms), read_eeprom, {}, false});
  const std::string sdo{'\x0a', 0,      0,      0,      0,      '\x13', 0,      '\x30',
                        '\x43', '\x18', '\x10', '\x01', '\x01', '\x02', '\x03', '\x04'};
  readers_.push_back({"coe_reply", {sdo}, read_sdo, {}, false});
  const auto serial = tmcl::to_serial(tmcl::encode(tmcl::Reply{2, 1, 100, 6, 711}));
  readers_.push_back({"tmcl_frame", {bus_text(serial)}, read_tmcl, seal_tmcl, false});
}

}  // namespace teletact
