#include "drivers/ethercat/mapping.hpp"

#include <optional>

#include "drivers/ethercat/bytes.hpp"

namespace drivers::ethercat {

namespace {

enum class Use : std::uint8_t { kNone, kMailboxOut, kMailboxIn, kOutputs, kInputs };

Use use_of(const SiiContent& sii, std::size_t i) {
  const SiiSyncManager& m = sii.sync_managers[i];
  if (m.type >= 1 && m.type <= 4) return static_cast<Use>(m.type);
  // Older content leaves the type out: the control byte tells mode and direction.
  const bool out = (m.control & sm::kDirectionMask) == sm::kMasterWrites;
  if ((m.control & sm::kModeMask) == sm::kMailbox) return out ? Use::kMailboxOut : Use::kMailboxIn;
  if (m.length == 0 && m.control == 0) return Use::kNone;
  return out ? Use::kOutputs : Use::kInputs;
}

// Bytes of process data behind sync manager `i`.
std::size_t data_bytes(const SiiContent& sii, std::size_t i, Use use) {
  const auto& pdos = use == Use::kOutputs ? sii.rx_pdos : sii.tx_pdos;
  std::size_t bits = 0;
  for (const SiiPdo& p : pdos) bits += p.sync_manager == i ? p.bits : 0;
  if (pdos.empty()) return sii.sync_managers[i].length;
  return (bits + 7) / 8;
}

RegisterBlock sm_block(int i, std::uint16_t start, std::size_t length, std::uint8_t control) {
  RegisterBlock b{reg::sync_manager(i), reg::kSmBytes, {}};
  store_u16(b.bytes, 0, start);
  store_u16(b.bytes, 2, static_cast<unsigned>(length));
  b.bytes[4] = control;
  b.bytes[6] = length > 0 ? sm::kEnable : 0;
  return b;
}

RegisterBlock fmmu_block(int i, std::size_t logical, std::size_t length, std::uint16_t physical,
                         std::uint8_t type) {
  RegisterBlock b{reg::fmmu(i), reg::kFmmuBytes, {}};
  store_u32(b.bytes, 0, static_cast<std::uint32_t>(logical));
  store_u16(b.bytes, 4, static_cast<unsigned>(length));
  b.bytes[6] = 0;  // from bit 0
  b.bytes[7] = 7;  // to bit 7: whole bytes
  store_u16(b.bytes, 8, physical);
  b.bytes[10] = 0;
  b.bytes[11] = type;
  b.bytes[12] = 1;  // active
  return b;
}

void map_mailbox(const SiiContent& sii, SlaveMapping& m) {
  if (!sii.has_mailbox()) return;
  m.mailbox = {sii.mailbox_out_start, sii.mailbox_out_length, sii.mailbox_in_start,
               sii.mailbox_in_length};
  std::uint8_t out = 0x26, in = 0x22;  // mailbox, event to the application
  for (std::size_t i = 0; i < sii.sync_managers.size(); ++i) {
    if (use_of(sii, i) == Use::kMailboxOut) out = sii.sync_managers[i].control;
    if (use_of(sii, i) == Use::kMailboxIn) in = sii.sync_managers[i].control;
  }
  m.mailbox_setup = {sm_block(0, m.mailbox.out_start, m.mailbox.out_length, out),
                     sm_block(1, m.mailbox.in_start, m.mailbox.in_length, in)};
  m.mailbox_blocks = 2;
}

struct DataManagers {
  std::optional<std::size_t> outputs, inputs;  // number of the sync manager
};

// Empty: fine.
std::string find_data_managers(const SlaveInfo& s, DataManagers& found) {
  for (std::size_t i = 0; i < s.sii.sync_managers.size(); ++i) {
    const Use use = use_of(s.sii, i);
    if (use != Use::kOutputs && use != Use::kInputs) continue;
    if (data_bytes(s.sii, i, use) == 0) continue;
    auto& place = use == Use::kOutputs ? found.outputs : found.inputs;
    if (place) return s.label() + ": more than one sync manager with process data a direction";
    if (static_cast<int>(i) >= s.sync_managers)
      return s.label() + ": its SII names a sync manager that it does not have";
    place = i;
  }
  if ((found.outputs ? 1 : 0) + (found.inputs ? 1 : 0) > s.fmmus)
    return s.label() + ": has fewer FMMUs than directions of process data";
  return {};
}

// The FMMU that category 40 names for that direction, of those that the slave has; -1: none.
int named_fmmu(const SlaveInfo& s, std::uint8_t use) {
  for (std::size_t i = 0; i < s.sii.fmmus.size() && i < s.fmmus; ++i)
    if (s.sii.fmmus[i] == use) return static_cast<int>(i);
  return -1;
}

struct DataFmmus {
  int outputs = 0, inputs = 0;
};

// A direction that is not named has the lowest one that the other leaves, outputs first.
DataFmmus fmmus_of(const SlaveInfo& s, const DataManagers& data) {
  const int outputs = data.outputs ? named_fmmu(s, 1) : -1;
  const int inputs = data.inputs ? named_fmmu(s, 2) : -1;
  DataFmmus out{outputs, inputs};
  if (data.outputs && outputs < 0) out.outputs = inputs == 0 ? 1 : 0;
  if (data.inputs && inputs < 0) out.inputs = out.outputs == 0 ? 1 : 0;
  return out;
}

void map_direction(const SlaveInfo& s, const DataManagers& data, Use use, std::size_t& logical,
                   SlaveMapping& m) {
  const bool out = use == Use::kOutputs;
  const std::size_t manager = out ? *data.outputs : *data.inputs;
  const SiiSyncManager& from = s.sii.sync_managers[manager];
  const std::size_t bytes = data_bytes(s.sii, manager, use);
  (out ? m.output_at : m.input_at) = logical;
  (out ? m.output_bytes : m.input_bytes) = bytes;
  if (out) m.watchdog = (from.control & sm::kWatchdog) != 0;
  const DataFmmus fmmus = fmmus_of(s, data);
  const int unit = out ? fmmus.outputs : fmmus.inputs;
  m.data_setup[static_cast<std::size_t>(m.data_blocks++)] =
      sm_block(static_cast<int>(manager), from.start, bytes, from.control);
  m.data_setup[static_cast<std::size_t>(m.data_blocks++)] =
      fmmu_block(unit, logical, bytes, from.start, out ? fmmu_type::kWrite : fmmu_type::kRead);
  logical += bytes;
}

}  // namespace

rt::Result<ProcessMapping> map_process_data(const std::vector<SlaveInfo>& slaves) {
  ProcessMapping out;
  std::vector<DataManagers> managers(slaves.size());
  std::size_t logical = 0;
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    const SlaveInfo& s = slaves[i];
    SlaveMapping& m = out.slaves.emplace_back();
    m.station = s.station;
    if (s.forbids_lrw()) out.lrw = false;
    if (s.sii.mailbox_out_length > kMostMailbox || s.sii.mailbox_in_length > kMostMailbox)
      return rt::Error{s.label() + ": a mailbox of more than " + std::to_string(kMostMailbox) +
                       " bytes is not served"};
    map_mailbox(s.sii, m);
    if (auto wrong = find_data_managers(s, managers[i]); !wrong.empty())
      return rt::Error{std::move(wrong)};
    if (!managers[i].outputs) continue;
    map_direction(s, managers[i], Use::kOutputs, logical, m);
    ++out.with_outputs;
  }
  out.output_bytes = logical;
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    if (!managers[i].inputs) continue;
    map_direction(slaves[i], managers[i], Use::kInputs, logical, out.slaves[i]);
    ++out.with_inputs;
  }
  out.input_bytes = logical - out.output_bytes;
  if (logical > kMostImage)
    return rt::Error{"EtherCAT: " + std::to_string(logical) + " bytes of process data, at most " +
                     std::to_string(kMostImage) + " are served"};
  return out;
}

}  // namespace drivers::ethercat
