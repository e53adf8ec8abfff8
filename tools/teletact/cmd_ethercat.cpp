// teletact ethercat: the EtherCAT bus of a youBot for a person at the bench.
//
//   scan     who is there, by EEPROM, and is it the chain that is expected; all slaves go to INIT
//   state    the state of each slave, changing none; --to STATE brings the chain there
//   read     a register, an EEPROM word, a motor parameter (TMCL), an object (CoE)
//   write    a register, a motor parameter, an object
//
//   --iface IF   a network card (CAP_NET_RAW)
//   --twin KIND  the virtual youBot in this process: base, base+arm, base+2arms, arm
//
// Exit code 0: fine; 1: a wrong chain, or a slave that does not do it; 2: bad input.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "drivers/ethercat/mailbox_client.hpp"
#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/ethercat_session.hpp"

namespace teletact {

namespace {

namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;
namespace tmcl = drivers::tmcl;
using Json = nlohmann::ordered_json;

struct EtherCatOptions {
  EtherCatChoice bus;
  std::string json, expect, to;
  int slave = 1, bytes = 2, motor = 0, module = 0;
  int reg = -1, parameter = -1, sii = -1;
  std::string sdo;
  std::int64_t value = 0;
};

void write_json(const EtherCatOptions& o, const char* what, Json content) {
  if (o.json.empty()) return;
  Json all{{"command", std::string("ethercat ") + what}};
  all.update(content);
  write_whole_file(o.json, all.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::string hex(std::uint64_t v, int digits) {
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "0x%0*llX", digits, static_cast<unsigned long long>(v));
  return text.data();
}

// ---- scan

// The kind that is expected: asked for, the twin's, or the one with the fewest differences.
yb::ChainKind expected_kind(const EtherCatOptions& o, EtherCatSession& bus) {
  if (!o.expect.empty()) {
    const auto kind = yb::chain_kind_of(o.expect);
    if (!kind)
      throw std::runtime_error("--expect " + o.expect +
                               ": not one of base, base+arm, base+2arms, arm");
    return *kind;
  }
  if (bus.twin_kind()) return *bus.twin_kind();
  yb::ChainKind best = yb::ChainKind::kBase;
  std::size_t fewest = SIZE_MAX;
  for (const yb::ChainKind k : yb::kChainKinds) {
    const std::size_t n = yb::check_chain(k, bus.master().slaves()).size();
    if (n < fewest) {
      fewest = n;
      best = k;
    }
  }
  return best;
}

Json slave_json(const ec::SlaveInfo& s, const ec::SlaveMapping& m) {
  return {{"slave", s.position + 1},
          {"station", hex(s.station, 4)},
          {"name", s.sii.name},
          {"vendor", hex(s.sii.vendor, 8)},
          {"product", hex(s.sii.product, 8)},
          {"revision", s.sii.revision},
          {"serial", s.sii.serial},
          {"eeprom_checksum_good", s.sii.checksum_good},
          {"output_bytes", m.output_bytes},
          {"input_bytes", m.input_bytes},
          {"mailbox_bytes", m.mailbox.out_length},
          {"coe", s.sii.has_coe()},
          {"lrw", !s.forbids_lrw()},
          {"open_ports", s.open_ports()}};
}

int run_scan(const EtherCatOptions& o) {
  EtherCatSession bus(o.bus);
  bus.find();
  const auto& slaves = bus.master().slaves();
  const auto kind = expected_kind(o, bus);
  const auto wrong = yb::check_chain(kind, slaves);
  Json list = Json::array();
  std::printf("slave station name             vendor     product    rev  out  in  mailbox ports\n");
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    const ec::SlaveInfo& s = slaves[i];
    const ec::SlaveMapping& m = bus.master().mapping().slaves[i];
    std::printf("%5zu 0x%04X  %-16s 0x%08X 0x%08X %3u %4zu %3zu %8d %5d%s\n", i + 1, s.station,
                s.sii.name.c_str(), s.sii.vendor, s.sii.product, s.sii.revision, m.output_bytes,
                m.input_bytes, m.mailbox.out_length, s.open_ports(),
                s.sii.checksum_good ? "" : "  EEPROM checksum is wrong");
    list.push_back(slave_json(s, m));
  }
  if (wrong.empty()) {
    std::printf("%zu slaves: %s\n", slaves.size(), to_text(kind));
  } else {
    std::printf("%zu slaves, not %s:\n", slaves.size(), to_text(kind));
    for (const auto& line : wrong) std::printf("  %s\n", line.c_str());
  }
  write_json(o, "scan", {{"slaves", list}, {"expected", to_text(kind)}, {"differences", wrong}});
  bus.finish();
  return wrong.empty() ? 0 : 1;
}

// ---- state

ec::AlState state_of(const std::string& text) {
  if (text == "init") return ec::AlState::kInit;
  if (text == "preop") return ec::AlState::kPreOp;
  if (text == "safeop") return ec::AlState::kSafeOp;
  return ec::AlState::kOp;
}

void must(const rt::Result<bool>& r) {
  if (!r) throw CouldNotDo(r.error());
}

// From INIT up to `wanted`.
void bring_to(EtherCatSession& bus, ec::AlState wanted) {
  bus.find();
  ec::Master& m = bus.master();
  if (wanted == ec::AlState::kOp) {
    must(m.configure(bus.token()));
    must(m.start(bus.token()));
    return;
  }
  constexpr rt::Nanos kStepTime = std::chrono::seconds{2};
  for (const ec::AlState step : {ec::AlState::kPreOp, ec::AlState::kSafeOp}) {
    if (static_cast<int>(step) > static_cast<int>(wanted)) return;
    for (std::size_t i = 0; i < m.slaves().size(); ++i) {
      const auto& mapping = m.mapping().slaves[i];
      must(step == ec::AlState::kPreOp
               ? ec::to_preop(bus.registers(), m.slaves()[i], mapping, kStepTime)
               : ec::to_safeop(bus.registers(), m.slaves()[i], mapping, kStepTime));
    }
  }
}

int run_state(const EtherCatOptions& o) {
  EtherCatSession bus(o.bus);
  std::string refused;
  if (!o.to.empty()) {
    try {
      bring_to(bus, state_of(o.to));
    } catch (const CouldNotDo& e) {  // the table tells where each one stands
      refused = e.what();
    }
  }
  Json list = Json::array();
  std::printf("slave state           code    meaning\n");
  const int n = bus.count();
  for (int i = 0; i < n; ++i) {
    std::array<std::uint8_t, 6> b{};
    std::array<std::uint8_t, 2> dl{};
    const bool answers = bus.look(i, ec::reg::kAlStatus, b) && bus.look(i, ec::reg::kDlStatus, dl);
    const ec::AlStatus al{b[0], ec::load_u16(b, 4)};
    const std::string state =
        answers ? std::string(state_text(al.is())) + (al.error() ? " + ERROR" : "") : "no answer";
    std::printf("%5d %-15s 0x%04X  %s\n", i + 1, state.c_str(), al.code, ec::code_text(al.code));
    list.push_back({{"slave", i + 1},
                    {"state", state},
                    {"al_status_code", hex(al.code, 4)},
                    {"meaning", ec::code_text(al.code)},
                    {"dl_status", hex(ec::load_u16(dl), 4)}});
  }
  if (!refused.empty()) std::printf("%s\n", refused.c_str());
  write_json(o, "state", {{"slaves", list}, {"refused", refused}});
  bus.finish();
  return refused.empty() ? 0 : 1;
}

// ---- read and write

void one_of(const EtherCatOptions& o, bool writing) {
  const int asked = (o.reg >= 0) + (o.parameter >= 0) + (o.sii >= 0) + !o.sdo.empty();
  if (asked != 1)
    throw std::runtime_error(writing ? "exactly one of --register, --parameter and --sdo"
                                     : "exactly one of --register, --parameter, --sii and --sdo");
}

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
  const tmcl::Request q{static_cast<std::uint8_t>(o.module), static_cast<std::uint8_t>(command),
                        static_cast<std::uint8_t>(o.parameter), static_cast<std::uint8_t>(o.motor),
                        static_cast<std::int32_t>(writing ? o.value : 0)};
  ec::MailboxClient client(bus.port());
  const auto bytes = client.raw(s, tmcl::encode(q));
  if (!bytes) throw CouldNotDo(bytes.error());
  tmcl::Reply reply;
  if (!tmcl::decode(bytes.value(), reply)) throw CouldNotDo(s.label() + ": reply too short");
  if (!tmcl::answers(reply, q))
    throw CouldNotDo(s.label() + ": parameter " + std::to_string(o.parameter) + ": status " +
                     std::to_string(reply.status) + ", " + tmcl::status_text(reply.status));
  return reply;
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
  const auto* p = o.module == 0 ? tmcl::find_axis_parameter(o.parameter) : nullptr;
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

int run_read(const EtherCatOptions& o) {
  one_of(o, false);
  EtherCatSession bus(o.bus);
  if (o.reg >= 0) {
    const int n = bus.count();
    std::vector<std::uint8_t> b(static_cast<std::size_t>(o.bytes));
    if (o.slave > n)
      throw std::runtime_error("--slave " + std::to_string(o.slave) + ": the chain has " +
                               std::to_string(n) + " slaves");
    if (!bus.look(o.slave - 1, static_cast<std::uint16_t>(o.reg), b))
      throw CouldNotDo("slave " + std::to_string(o.slave) + ": does not answer");
    show_bytes(o, "read", b);
  } else if (o.sii >= 0) {
    bus.find();
    const auto& s = bus.master().slaves()[bus.slave(o.slave)];
    const auto words = static_cast<std::size_t>(o.bytes + 1) / 2;
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
  const std::int64_t limit = o.bytes >= 8 ? INT64_MAX : (std::int64_t{1} << 8 * o.bytes) - 1;
  if (o.parameter < 0 && (o.bytes > 8 || o.value > limit || o.value < 0))
    throw std::runtime_error("--value " + std::to_string(o.value) + ": not in --bytes " +
                             std::to_string(o.bytes) + " (at most 8)");
  std::vector<std::uint8_t> b;
  for (int i = 0; i < o.bytes && i < 8; ++i)
    b.push_back(static_cast<std::uint8_t>(o.value >> 8 * i));
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

// ---- options

void add_bus_options(CLI::App& c, EtherCatOptions& o) {
  c.add_option("--iface", o.bus.iface, "network card; needs CAP_NET_RAW");
  c.add_option("--twin", o.bus.twin, "the virtual youBot: base, base+arm, base+2arms, arm");
  c.add_option("--generation", o.bus.generation, "of the twin's boards")
      ->check(CLI::IsMember({"old", "new"}))
      ->capture_default_str();
  c.add_option("--json", o.json, "write what was found to this file");
  c.add_option("--capture", o.bus.capture, "write every frame to this file, as pcap");
}

void add_place_options(CLI::App& c, EtherCatOptions& o, bool writing) {
  const auto nothing = CLI::Range(0, 0xFFFF);
  c.add_option("--slave", o.slave, "counted from 1")
      ->check(CLI::Range(1, ec::kMostSlaves))
      ->required();
  c.add_option("--register", o.reg, "of the slave controller, 0x0000 to 0xFFFF")->check(nothing);
  c.add_option("--parameter", o.parameter,
               "of the motor controller (TMCL), 0 to 255; slaves go to PREOP")
      ->check(CLI::Range(0, 255));
  c.add_option("--sdo", o.sdo, "CoE object, INDEX:SUBINDEX in hexadecimal; slaves go to PREOP");
  if (!writing)
    c.add_option("--sii", o.sii, "word of the EEPROM; slaves go to INIT")->check(nothing);
  if (writing) c.add_option("--value", o.value, "what to write")->required();
  c.add_option("--bytes", o.bytes, "how many")->check(CLI::Range(1, 512))->capture_default_str();
  c.add_option("--motor", o.motor, "of a parameter; the gripper's bars are 0 and 1")
      ->check(CLI::Range(0, 255));
  c.add_option("--module", o.module, "of a parameter: 0 the drive, 1 the gripper behind joint 5")
      ->check(CLI::Range(0, 255));
}

}  // namespace

int cmd_ethercat(int argc, char** argv) {
  EtherCatOptions o;
  CLI::App app("The EtherCAT bus of a youBot: who is there, in which state; reads and writes.",
               "teletact ethercat");
  app.require_subcommand(1);
  auto* scan = app.add_subcommand("scan", "who is there; all slaves go to INIT");
  auto* state = app.add_subcommand("state", "state of each slave, and bring the chain to one");
  auto* read = app.add_subcommand("read", "a register, an EEPROM word, a parameter, an object");
  auto* write = app.add_subcommand("write", "a register, a parameter, an object");
  for (CLI::App* c : {scan, state, read, write}) add_bus_options(*c, o);
  scan->add_option("--expect", o.expect, "the chain it should be: base, base+arm, base+2arms, arm");
  state->add_option("--to", o.to, "bring all slaves there")
      ->check(CLI::IsMember({"init", "preop", "safeop", "op"}));
  add_place_options(*read, o, false);
  add_place_options(*write, o, true);
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", o.json}, {"--capture", o.bus.capture}}, {});
  try {
    if (scan->parsed()) return run_scan(o);
    if (state->parsed()) return run_state(o);
    return read->parsed() ? run_read(o) : run_write(o);
  } catch (const CouldNotDo& e) {
    std::fprintf(stderr, "teletact ethercat: %s\n", e.what());
    return 1;
  }
}

}  // namespace teletact
