#include <array>
#include <cstdio>
#include <stdexcept>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"
#include "tools/bus/ethercat_parts.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;
using Json = nlohmann::ordered_json;

namespace {

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
          {"open_ports", s.open_ports()},
          {"problem", s.problem}};
}

// Behind its row; its whole reason stands below the table.
std::string remark(const ec::SlaveInfo& s) {
  if (!s.problem.empty()) return "  can not be driven";
  return s.sii.checksum_good ? "" : "  EEPROM checksum is wrong";
}

ec::AlState state_of(const std::string& text) {
  if (text == "init") return ec::AlState::kInit;
  if (text == "preop") return ec::AlState::kPreOp;
  if (text == "safeop") return ec::AlState::kSafeOp;
  return ec::AlState::kOp;
}

}  // namespace

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
                m.input_bytes, m.mailbox.out_length, s.open_ports(), remark(s).c_str());
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

int run_state(const EtherCatOptions& o) {
  EtherCatChoice choice = o.bus;
  choice.looks = o.to.empty();
  EtherCatSession bus(choice);
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

}  // namespace teletact
