#include "drivers/ethercat/scan.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdio>

#include "drivers/ethercat/registers.hpp"

namespace drivers::ethercat {

namespace {

std::string problem_of(int position, const std::string& what) {
  return "slave " + std::to_string(position + 1) + ": " + what;
}

void clear_blocks(RegisterAccess& r, std::uint16_t first, std::size_t bytes) {
  constexpr std::size_t kPiece = 64;  // of one clear_all()
  for (std::size_t at = 0; at < bytes; at += kPiece)
    (void)r.clear_all(static_cast<std::uint16_t>(first + at), std::min(kPiece, bytes - at));
}

// FMMUs and sync managers, as many as there are (0x0004, 0x0005; both at most 16, ETG.1000.4, 6.6).
// Of a broadcast read the counts come ORed: the slave with the most has no more than that.
void clear_units(RegisterAccess& r) {
  std::array<std::uint8_t, 2> counts{};
  if (r.run(Command::kBrd, broadcast_address(reg::kFmmuCount), counts).value_or(0) == 0) return;
  constexpr std::size_t kMost = 16;
  clear_blocks(r, reg::kFmmu, std::min<std::size_t>(counts[0], kMost) * reg::kFmmuBytes);
  // Twice: one that is on takes nothing but being switched off.
  for (int i = 0; i < 2; ++i)
    clear_blocks(r, reg::kSm, std::min<std::size_t>(counts[1], kMost) * reg::kSmBytes);
}

// All slaves to INIT and their set-up gone; the number of slaves, nullopt: no frame came back.
std::optional<int> reset_all(RegisterAccess& r) {
  const std::array<std::uint8_t, 1> zero{0};
  const std::array<std::uint8_t, 2> init{static_cast<std::uint8_t>(AlState::kInit) | kAlAcknowledge,
                                         0};
  (void)r.write_all(reg::kDlAlias, zero);  // no aliases
  (void)r.write_all(reg::kAlControl, init);
  const auto count = r.count_slaves();
  if (!count) return std::nullopt;
  if (*count == 0) return 0;
  // 0x0010: of an earlier chain, or another master.
  (void)r.clear_all(reg::kStation, 2);
  (void)r.write_all(reg::kDlLoopControl, zero);  // ports open and close by themselves
  (void)r.clear_all(reg::kRxErrors, 8);
  (void)r.clear_all(reg::kEventMask, 2);  // 0x0200: nobody reads the events in the datagrams
  clear_units(r);
  (void)r.clear_all(reg::kDcActivate, 1);  // 0x0981: no sync signals of a master before
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
  return r.write_at(position, reg::kStation, b);
}

void look_at(RegisterAccess& r, SlaveInfo& s) {
  const auto odd = [&](const std::string& what) { s.problem = problem_of(s.position, what); };
  std::array<std::uint8_t, 10> info{};
  if (!r.read(s.station, reg::kType, info)) return odd(r.why());
  s.type = info[0];
  s.fmmus = info[reg::kFmmuCount];
  s.sync_managers = info[reg::kSyncManagers];
  s.features = load_u16(info, reg::kFeatures);
  s.dl_status = r.read_u16(s.station, reg::kDlStatus).value_or(0);
  s.al = read_al_status(r, s.station);
}

// As it leaves the chip's factory, or with a bus that always gives the same.
bool is_blank(std::span<const std::uint8_t> image) {
  const auto head = image.first(std::min(image.size(), 2 * sii_word::kCategories));
  return std::all_of(head.begin(), head.end(),
                     [&](std::uint8_t b) { return b == head[0] && (b == 0 || b == 0xFF); });
}

void read_names(RegisterAccess& r, std::vector<SlaveInfo>& slaves) {
  std::vector<std::uint16_t> stations;
  for (const SlaveInfo& s : slaves)
    if (s.problem.empty()) stations.push_back(s.station);
  const auto images = read_sii_images(r, stations);
  std::size_t next = 0;
  for (SlaveInfo& s : slaves) {
    if (!s.problem.empty()) continue;
    const auto& image = images[next++];
    if (image && is_blank(image.value())) {
      s.problem = problem_of(s.position, "SII: its EEPROM is empty");
      continue;
    }
    auto sii = image ? parse_sii(image.value()) : rt::Result<SiiContent>(rt::Error{image.error()});
    if (sii)
      s.sii = std::move(sii.value());
    else
      s.problem = problem_of(s.position, sii.error());
  }
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
  if (!count)
    return rt::Error{r.port().link_up()
                         ? "EtherCAT: no frame came back: no slave, or no cable to the first one"
                         : "EtherCAT: no frame came back, the card has no link: look at the cable "
                           "to the first slave, "
                           "and whether the robot has power"};
  if (*count > kMostSlaves)
    return rt::Error{"EtherCAT: " + std::to_string(*count) + " slaves, at most " +
                     std::to_string(kMostSlaves) + " are served"};
  // All of them before any is read: one that stood elsewhere in the chain may have the address of
  // another, and two would answer.
  std::vector<SlaveInfo> out(static_cast<std::size_t>(*count));
  for (int i = 0; i < *count; ++i) {
    SlaveInfo& s = out[static_cast<std::size_t>(i)];
    s.position = i;
    s.station = station_of(i);
    if (!give_address(r, i)) s.problem = problem_of(i, std::string("takes no address: ") + r.why());
  }
  for (SlaveInfo& s : out)
    if (s.problem.empty()) look_at(r, s);
  read_names(r, out);
  return out;
}

}  // namespace drivers::ethercat
