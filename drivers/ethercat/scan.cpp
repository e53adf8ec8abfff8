#include "drivers/ethercat/scan.hpp"

#include <array>
#include <bit>
#include <cstdio>

#include "drivers/ethercat/registers.hpp"

namespace drivers::ethercat {

namespace {

rt::Error scan_error(int position, const char* what) {
  return {"slave " + std::to_string(position + 1) + ": " + what};
}

// All slaves to INIT and their set-up gone; the number of slaves, nullopt: no frame came back.
std::optional<int> reset_all(RegisterAccess& r) {
  const std::array<std::uint8_t, 1> zero{0};
  const std::array<std::uint8_t, 2> init{static_cast<std::uint8_t>(AlState::kInit) | kAlAcknowledge,
                                         0};
  (void)r.write_all(reg::kDlAlias, zero);  // no aliases
  (void)r.write_all(reg::kAlControl, init);
  std::array<std::uint8_t, 1> type{};
  const auto count = r.run(Command::kBrd, broadcast_address(reg::kType), type);
  if (!count) return std::nullopt;
  if (*count == 0) return 0;
  (void)r.clear_all(reg::kStation, 2);  // 0x0010: of an earlier chain, or another master
  (void)r.write_all(reg::kDlLoopControl, zero);  // ports open and close by themselves
  (void)r.clear_all(reg::kRxErrors, 8);
  (void)r.clear_all(reg::kFmmu, 3 * reg::kFmmuBytes);
  (void)r.clear_all(reg::kSm, 4 * reg::kSmBytes);
  const std::array<std::uint8_t, 1> take{2};
  (void)r.write_all(reg::kSiiAccess, take);
  (void)r.write_all(reg::kSiiAccess, zero);
  return *count;
}

std::uint16_t station_of(int position) {
  return static_cast<std::uint16_t>(kFirstStation + position);
}

bool give_address(RegisterAccess& r, int position) {
  std::array<std::uint8_t, 2> b{};
  store_u16(b, 0, station_of(position));
  return r.run(Command::kApwr, position_address(position, reg::kStation), b) == 1;
}

rt::Result<SlaveInfo> look_at(RegisterAccess& r, int position) {
  SlaveInfo s;
  s.position = position;
  s.station = station_of(position);
  std::array<std::uint8_t, 10> info{};
  if (!r.read(s.station, reg::kType, info)) return scan_error(position, "does not answer");
  s.type = info[0];
  s.fmmus = info[reg::kFmmuCount];
  s.sync_managers = info[reg::kSyncManagers];
  s.features = load_u16(info, reg::kFeatures);
  s.dl_status = r.read_u16(s.station, reg::kDlStatus).value_or(0);
  s.al = read_al_status(r, s.station);
  const auto image = read_sii_image(r, s.station);
  if (!image) return scan_error(position, image.error().c_str());
  auto sii = parse_sii(image.value());
  if (!sii) return scan_error(position, sii.error().c_str());
  s.sii = std::move(sii.value());
  return s;
}

}  // namespace

bool SlaveInfo::forbids_lrw() const noexcept {
  return (features & feature::kNoLrw) != 0 || sii.forbids_lrw();
}

int SlaveInfo::open_ports() const noexcept {
  // Communication established: bits 9, 11, 13, 15.
  return std::popcount(dl_status & 0xAA00U);
}

std::string SlaveInfo::label() const {
  return "slave " + std::to_string(position + 1) + " '" + sii.name + "'";
}

AlStatus read_al_status(RegisterAccess& r, std::uint16_t station) noexcept {
  std::array<std::uint8_t, 6> b{};
  if (!r.read(station, reg::kAlStatus, b)) return {};
  return {b[0], load_u16(b, 4)};
}

rt::Result<std::vector<SlaveInfo>> scan(rt::NonRealtime&, RegisterAccess& r) {
  const auto count = reset_all(r);
  if (!count) return rt::Error{"EtherCAT: no frame came back: no slave, no cable, or no link"};
  if (*count > kMostSlaves)
    return rt::Error{"EtherCAT: " + std::to_string(*count) + " slaves, at most " +
                     std::to_string(kMostSlaves) + " are served"};
  // All of them before any is read: one that stood elsewhere in the chain may have the address of
  // another, and two would answer.
  for (int i = 0; i < *count; ++i)
    if (!give_address(r, i)) return scan_error(i, "takes no address");
  std::vector<SlaveInfo> out;
  for (int i = 0; i < *count; ++i) {
    auto slave = look_at(r, i);
    if (!slave) return rt::Error{slave.error()};
    out.push_back(std::move(slave.value()));
  }
  return out;
}

}  // namespace drivers::ethercat
