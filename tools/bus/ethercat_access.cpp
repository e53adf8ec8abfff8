#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "drivers/ethercat/mailbox_client.hpp"
#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "tools/bus/ethercat_parts.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
namespace tmcl = drivers::tmcl;

namespace {

void one_of(const EtherCatOptions& o, bool writing) {
  const int asked = (o.reg >= 0) + (o.parameter >= 0) + (o.sii >= 0) + !o.sdo.empty();
  if (asked != 1)
    throw std::runtime_error(writing ? "exactly one of --register, --parameter and --sdo"
                                     : "exactly one of --register, --parameter, --sii and --sdo");
  // What would have no effect is a mistake.
  if (o.parameter < 0 && (o.motor >= 0 || o.module >= 0))
    throw std::runtime_error(std::string(o.motor >= 0 ? "--motor" : "--module") +
                             " is of --parameter");
  if (o.bytes >= 0 && o.parameter >= 0)
    throw std::runtime_error("--bytes: a parameter has a value of its own size");
  if (o.bytes >= 0 && !o.sdo.empty() && !writing)
    throw std::runtime_error("--bytes: an object is read whole");
}

int bytes_of(const EtherCatOptions& o) { return o.bytes < 0 ? 2 : o.bytes; }

ec::SdoAddress sdo_address(const std::string& text) {
  unsigned index = 0, sub = 0;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%x:%x%c", &index, &sub, &rest) != 2 || index > 0xFFFF ||
      sub > 0xFF)
    throw std::runtime_error("--sdo " + text + ": not INDEX:SUBINDEX, both hexadecimal");
  return {static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub)};
}

// The slave in PREOP, where it has a mailbox.
const ec::SlaveInfo& with_mailbox(const EtherCatOptions& o, EtherCatSession& bus) {
  bring_to(bus, ec::AlState::kPreOp);
  return bus.master().slaves()[bus.slave(o.slave)];
}

tmcl::Reply ask_parameter(const EtherCatOptions& o, EtherCatSession& bus, bool writing) {
  if (writing && (o.value < INT32_MIN || o.value > INT32_MAX))
    throw std::runtime_error("--value " + std::to_string(o.value) + ": not a 32-bit number");
  const ec::SlaveInfo& s = with_mailbox(o, bus);
  const auto command =
      writing ? tmcl::Command::kSetAxisParameter : tmcl::Command::kGetAxisParameter;
  const tmcl::Request q{static_cast<std::uint8_t>(std::max(o.module, 0)),
                        static_cast<std::uint8_t>(command), static_cast<std::uint8_t>(o.parameter),
                        static_cast<std::uint8_t>(std::max(o.motor, 0)),
                        static_cast<std::int32_t>(writing ? o.value : 0)};
  ec::MailboxClient client(bus.port());
  // As DriveSession asks: a reading again whatever came, a value only where nothing did.
  constexpr int kMostAsks = 50;
  constexpr rt::Nanos kSilence = std::chrono::seconds{5};
  const rt::Time begun = bus.port().now();
  for (int asks = 1;; ++asks) {
    const auto bytes = client.raw(s, tmcl::encode(q));
    tmcl::Reply reply;
    std::string why;
    if (!bytes)
      why = bytes.error();
    else if (!tmcl::decode(bytes.value(), reply))
      why = s.label() + ": reply too short";
    else if (tmcl::answers(reply, q))
      return reply;
    else
      why = s.label() + ": parameter " + std::to_string(o.parameter) + ": status " +
            std::to_string(reply.status) + ", " + tmcl::status_text(reply.status);
    const bool again = asks < kMostAsks && bus.port().now() - begun < kSilence;
    if (!again || (writing && bytes)) throw CouldNotDo(why);
  }
}

std::string bytes_text(std::span<const std::uint8_t> b) {
  std::string out;
  for (const auto x : b) out += (out.empty() ? "" : " ") + hex(x, 2).substr(2);
  return out;
}

void show_bytes(const EtherCatOptions& o, const char* what, std::span<const std::uint8_t> b) {
  std::printf("slave %d: %s\n", o.slave, bytes_text(b).c_str());
  write_json(o, what, {{"slave", o.slave}, {"bytes", bytes_text(b)}});
}

void show_parameter(const EtherCatOptions& o, const char* what, std::int32_t value) {
  const auto* p = o.module <= 0 ? tmcl::find_axis_parameter(o.parameter) : nullptr;
  const std::string name = p == nullptr ? "" : p->name, unit = p == nullptr ? "" : p->unit;
  std::printf("slave %d: parameter %d %s = %d %s\n", o.slave, o.parameter, name.c_str(), value,
              unit.c_str());
  write_json(o, what,
             {{"slave", o.slave},
              {"parameter", o.parameter},
              {"name", name},
              {"value", value},
              {"unit", unit}});
}

}  // namespace

int run_read(const EtherCatOptions& o) {
  one_of(o, false);
  EtherCatChoice choice = o.bus;
  // From the memory on a read may empty a mailbox that is another program's.
  choice.looks = o.reg >= 0 && o.reg + bytes_of(o) <= ec::reg::kRam;
  EtherCatSession bus(choice);
  if (o.reg >= 0) {
    const int n = bus.count();
    std::vector<std::uint8_t> b(static_cast<std::size_t>(bytes_of(o)));
    if (o.slave > n)
      throw std::runtime_error("--slave " + std::to_string(o.slave) + ": the chain has " +
                               std::to_string(n) + " slaves");
    if (!bus.look(o.slave - 1, static_cast<std::uint16_t>(o.reg), b))
      throw CouldNotDo("slave " + std::to_string(o.slave) + ": does not answer");
    show_bytes(o, "read", b);
  } else if (o.sii >= 0) {
    bus.find();
    const auto& s = bus.master().slaves()[bus.slave(o.slave)];
    const auto words = static_cast<std::size_t>(bytes_of(o) + 1) / 2;
    const auto b =
        ec::read_sii_words(bus.registers(), s.station, static_cast<std::size_t>(o.sii), words);
    if (!b) throw CouldNotDo(b.error());
    show_bytes(o, "read", b.value());
  } else if (o.parameter >= 0) {
    show_parameter(o, "read", ask_parameter(o, bus, false).value);
  } else {
    const auto address = sdo_address(o.sdo);
    const ec::SlaveInfo& s = with_mailbox(o, bus);
    const auto b = ec::MailboxClient(bus.port()).sdo_upload(s, address);
    if (!b) throw CouldNotDo(b.error());
    show_bytes(o, "read", b.value());
  }
  bus.finish();
  return 0;
}

int run_write(const EtherCatOptions& o) {
  one_of(o, true);
  const int bytes = bytes_of(o);
  const std::int64_t limit = bytes >= 8 ? INT64_MAX : (std::int64_t{1} << 8 * bytes) - 1;
  if (o.parameter < 0 && (bytes > 8 || o.value > limit || o.value < 0))
    throw std::runtime_error("--value " + std::to_string(o.value) + ": not in --bytes " +
                             std::to_string(bytes) + " (at most 8)");
  std::vector<std::uint8_t> b;
  for (int i = 0; i < bytes && i < 8; ++i) b.push_back(static_cast<std::uint8_t>(o.value >> 8 * i));
  EtherCatSession bus(o.bus);
  if (o.reg >= 0) {
    const int n = bus.count();
    if (o.slave > n)
      throw std::runtime_error("--slave " + std::to_string(o.slave) + ": the chain has " +
                               std::to_string(n) + " slaves");
    const auto address = ec::position_address(o.slave - 1, static_cast<std::uint16_t>(o.reg));
    auto copy = b;
    if (bus.registers().run(ec::Command::kApwr, address, copy) != 1)
      throw CouldNotDo("slave " + std::to_string(o.slave) + ": does not take it");
    show_bytes(o, "write", b);
  } else if (o.parameter >= 0) {
    show_parameter(o, "write", ask_parameter(o, bus, true).value);
  } else {
    const auto address = sdo_address(o.sdo);
    const ec::SlaveInfo& s = with_mailbox(o, bus);
    must(ec::MailboxClient(bus.port()).sdo_download(s, address, b));
    show_bytes(o, "write", b);
  }
  bus.finish();
  return 0;
}

}  // namespace teletact
