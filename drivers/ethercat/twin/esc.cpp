#include "drivers/ethercat/twin/esc.hpp"

#include <algorithm>

#include "drivers/ethercat/sii.hpp"

namespace drivers::ethercat {

namespace {

// Registers that the master may write, first and last byte.
struct Range {
  std::uint16_t first, last;
};
constexpr std::array kWritable{Range{0x0010, 0x0011}, Range{0x0100, 0x0103}, Range{0x0120, 0x0121},
                               Range{0x0200, 0x0201}, Range{0x0204, 0x0207}, Range{0x0400, 0x0401},
                               Range{0x0410, 0x0411}, Range{0x0420, 0x0421}, Range{0x0500, 0x0500},
                               Range{0x0502, 0x050F}, Range{0x0600, 0x06FF}, Range{0x0800, 0x083F},
                               Range{0x0920, 0x092B}, Range{0x0930, 0x0935}, Range{0x0980, 0x09AF}};

bool touches(std::size_t at, std::size_t size, std::size_t reg, std::size_t bytes) noexcept {
  return at < reg + bytes && reg < at + size;
}

void store_u64(std::span<std::uint8_t> b, std::size_t at, std::uint64_t v) noexcept {
  store_u32(b, at, static_cast<std::uint32_t>(v));
  store_u32(b, at + 4, static_cast<std::uint32_t>(v >> 32U));
}

}  // namespace

Esc::Esc(rt::NonRealtime&, const EscConfig& config, std::vector<std::uint8_t> sii,
         std::unique_ptr<EscApplication> application)
    : config_(config), sii_(std::move(sii)), application_(std::move(application)) {
  config_.fmmus = std::min(config_.fmmus, std::uint8_t{16});
  config_.sync_managers = std::min(config_.sync_managers, std::uint8_t{kManagers});
  if (const auto content = parse_sii(sii_)) {
    const SiiContent& c = content.value();
    mailbox_needed_ = c.protocols != 0;
    for (std::size_t i = 0; i < c.sync_managers.size() && i < wanted_.size(); ++i) {
      const SiiSyncManager& m = c.sync_managers[i];
      wanted_[i] = {m.start, m.length, m.control, m.length > 0};
    }
  }
  power_cycle(rt::Time{});
}

void Esc::power_cycle(rt::Time now) noexcept {
  memory_.fill(0);
  managers_.fill({});
  al_ = shown_ = {static_cast<std::uint8_t>(AlState::kInit), al_code::kNone};
  looks_left_ = sii_busy_ = 0;
  events_ = event::kDlStatus;  // the link came up
  outputs_came_ = request_waits_ = false;
  watchdog_good_ = true;
  fed_ = now;
  reset_registers();
  application_->on_state(AlState::kNone, now);
}

void Esc::reset_registers() noexcept {
  memory_[reg::kType] = config_.type;
  memory_[reg::kRevision] = config_.revision;
  store_u16(memory_, reg::kBuild, config_.build);
  memory_[reg::kFmmuCount] = config_.fmmus;
  memory_[reg::kSyncManagers] = config_.sync_managers;
  memory_[reg::kRamKiB] = config_.ram_kib;
  memory_[reg::kPortDescriptor] = 0x0F;  // ports 0 and 1 are MII, 2 and 3 not there
  store_u16(memory_, reg::kFeatures, config_.features);
  load_configuration(true);
  store_u32(memory_, reg::kDlControl, 0x00070001);
  // The chip's own defaults: 100 us, 100 ms.
  store_u16(memory_, reg::kWatchdogDivider, 2498);
  store_u16(memory_, reg::kPdiWatchdog, 1000);
  store_u16(memory_, reg::kDataWatchdog, 1000);
}

// ESC data sheet I, "EEPROM": area A, whose checksum has to be right. Words 0, 1 and 3 are the
// application's interface, word 4 is the alias.
void Esc::load_configuration(bool at_power_on) noexcept {
  if (!sii_sealed()) return;
  store_u16(memory_, reg::kPdiControl, load_u16(sii_, 0));
  store_u16(memory_, reg::kPdiConfig, load_u16(sii_, 2));
  store_u16(memory_, reg::kPdiConfig + 2, load_u16(sii_, 6));
  if (at_power_on || config_.reload_takes_alias)
    store_u16(memory_, reg::kStationAlias, load_u16(sii_, 2 * sii_word::kAlias));
}

bool Esc::sii_sealed() const noexcept {
  return sii_.size() >= 16 &&
         sii_checksum(std::span<const std::uint8_t>(sii_).first<14>()) == sii_[14];
}

// Each stops at its largest value.
void Esc::count_up(std::size_t counter) noexcept {
  if (memory_[counter] < 0xFF) ++memory_[counter];
}

void Esc::count_bad_frame() noexcept { count_up(reg::kUnitErrors); }

void Esc::count_damaged(std::size_t port, bool first) noexcept {
  count_up(first ? reg::kRxErrors + 2 * port : reg::kForwarded + port);
}

void Esc::lose_link(std::size_t port) noexcept { count_up(reg::kLostLinks + port); }

// ESC data sheet II: a write of anything clears; ports' counters of frames are cleared together,
// and so are those of links.
void Esc::clear_counters(std::size_t at) noexcept {
  const auto clear = [&](std::size_t first, std::size_t bytes) {
    std::fill_n(memory_.begin() + static_cast<std::ptrdiff_t>(first), bytes, std::uint8_t{0});
  };
  if (at < reg::kUnitErrors) return clear(reg::kRxErrors, reg::kUnitErrors - reg::kRxErrors);
  if (at >= reg::kLostLinks) return clear(reg::kLostLinks, 4);
  clear(at, 1);
}

void Esc::pass(Passing& d, rt::Time now) noexcept {
  advance(now);
  d.irq =
      static_cast<std::uint16_t>(d.irq | (event_request() & load_u16(memory_, reg::kEventMask)));
  if (by_logical(d.command)) return pass_logical(d, now);
  const auto reg = static_cast<std::size_t>(d.address >> 16U);
  if (by_position(d.command)) return run_position(d, now);
  if (by_broadcast(d.command)) {
    (void)access(d, reg, now);
    d.address = (d.address & 0xFFFF0000U) | ((d.address + 1) & 0xFFFFU);
    return;
  }
  if (!by_station(d.command)) return;
  const auto wanted = static_cast<std::uint16_t>(d.address);
  const bool alias =
      (memory_[reg::kDlAlias] & 1U) != 0 && wanted == load_u16(memory_, reg::kStationAlias);
  const bool mine = wanted == station() || alias;
  if (mine) {
    Passing one = d;
    if (d.command == Command::kFrmw) one.command = Command::kFprd;
    (void)access(one, reg, now);
    d.counter = one.counter;
  } else if (d.command == Command::kFrmw) {
    d.counter = static_cast<std::uint16_t>(d.counter + (write(reg, d.data, now) ? 1 : 0));
  }
}

void Esc::run_position(Passing& d, rt::Time now) noexcept {
  const auto reg = static_cast<std::size_t>(d.address >> 16U);
  const bool mine = (d.address & 0xFFFFU) == 0;
  if (mine) {
    Passing one = d;
    if (d.command == Command::kArmw) one.command = Command::kAprd;
    (void)access(one, reg, now);
    d.counter = one.counter;
  } else if (d.command == Command::kArmw) {
    d.counter = static_cast<std::uint16_t>(d.counter + (write(reg, d.data, now) ? 1 : 0));
  }
  d.address = (d.address & 0xFFFF0000U) | ((d.address + 1) & 0xFFFFU);
}

// Read and write of a datagram that is for this slave. A broadcast read is ORed into the data.
bool Esc::access(Passing& d, std::size_t at, rt::Time now) noexcept {
  std::array<std::uint8_t, kMaxData> in{}, out{};
  const std::size_t n = d.data.size();
  std::copy(d.data.begin(), d.data.end(), in.begin());
  unsigned counted = 0;
  if (reads(d.command) && read(at, std::span(out).first(n), now)) {
    counted = 1;
    const bool ored = by_broadcast(d.command);
    for (std::size_t i = 0; i < n; ++i)
      d.data[i] = ored ? static_cast<std::uint8_t>(d.data[i] | out[i]) : out[i];
  }
  if (writes(d.command) && write(at, std::span(in).first(n), now))
    counted += reads(d.command) ? 2 : 1;
  d.counter = static_cast<std::uint16_t>(d.counter + counted);
  return counted > 0;
}

// ETG.1000.4, 6.6: every active FMMU that the datagram meets maps its part.
void Esc::pass_logical(Passing& d, rt::Time now) noexcept {
  bool did_read = false, did_write = false;
  std::array<std::uint8_t, kMaxData> in{};
  std::copy(d.data.begin(), d.data.end(), in.begin());
  for (int i = 0; i < config_.fmmus; ++i) {
    const auto f = std::span(memory_).subspan(reg::fmmu(i), reg::kFmmuBytes);
    if ((f[12] & 1U) == 0) continue;
    const std::uint64_t from = load_u32(f), to = from + load_u16(f, 4);
    const std::uint64_t low = std::max<std::uint64_t>(from, d.address),
                        high =
                            std::min<std::uint64_t>(to, d.address + std::uint64_t{d.data.size()});
    if (low >= high) continue;
    const auto at = static_cast<std::size_t>(low - d.address);
    const auto size = static_cast<std::size_t>(high - low);
    const std::size_t physical = load_u16(f, 8) + static_cast<std::size_t>(low - from);
    if (reads(d.command) && (f[11] & fmmu_type::kRead) != 0)
      did_read |= read(physical, d.data.subspan(at, size), now);
    if (writes(d.command) && (f[11] & fmmu_type::kWrite) != 0)
      did_write |= write(physical, std::span(in).subspan(at, size), now);
  }
  const unsigned add = (did_read ? 1U : 0U) + (did_write ? (reads(d.command) ? 2U : 1U) : 0U);
  d.counter = static_cast<std::uint16_t>(d.counter + add);
}

bool Esc::read(std::size_t at, std::span<std::uint8_t> out, rt::Time now) noexcept {
  if (at >= reg::kRam) return read_ram(at, out, now);
  if (touches(at, out.size(), reg::kAlStatus, 2)) {
    if (looks_left_ > 0) --looks_left_;
    if (looks_left_ == 0) show_state();
  }
  show(now);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = at + i < memory_.size() ? memory_[at + i] : std::uint8_t{0};
  if (touches(at, out.size(), reg::kSiiControl, 2) && sii_busy_ > 0) --sii_busy_;
  if (touches(at, out.size(), reg::kDlStatus, 2)) events_ &= ~unsigned{event::kDlStatus};
  if (touches(at, out.size(), reg::kAlStatus, 2)) events_ &= ~unsigned{event::kAlStatus};
  return true;
}

void Esc::set_place(std::size_t before, std::size_t behind) noexcept {
  if ((behind == 0) != (behind_ == 0)) events_ |= event::kDlStatus;
  before_ = before;
  behind_ = behind;
}

void Esc::show_state() noexcept {
  if (!(shown_ == al_)) events_ |= event::kAlStatus;
  shown_ = al_;
}

// ESC data sheet II, 0x0805: an event ends with the first byte that the other side touches.
unsigned Esc::manager_status(int i) const noexcept {
  const Manager& m = managers_[static_cast<std::size_t>(i)];
  unsigned status = m.full ? sm::kFull : 0U;
  if (m.full && !m.open) status |= sm::kWritten;
  if (m.emptied && !m.open) status |= sm::kRead;
  return status;
}

// The side that writes hears of reads, the side that reads of writes.
unsigned Esc::event_request() const noexcept {
  unsigned out = events_;
  for (int i = 0; i < kManagers; ++i) {
    const Area a = area(i);
    if (!a.enabled || (a.control & sm::kMasterEvent) == 0) continue;
    const unsigned told = a.written_by_master() ? sm::kRead : sm::kWritten;
    if ((manager_status(i) & told) != 0)
      out |= unsigned{event::kManager0} << static_cast<unsigned>(i);
  }
  return out;
}

// Registers whose value follows from something else.
void Esc::show(rt::Time now) noexcept {
  memory_[reg::kAlStatus] = shown_.state;
  store_u16(memory_, reg::kAlStatusCode, shown_.code);
  // The application works, and feeds its watchdog (bits 0 and 1). Link and communication of port 0,
  // and of port 1 unless this is the last slave; loops of ports that lead nowhere are closed.
  store_u16(memory_, reg::kDlStatus, behind_ == 0 ? 0x5613U : 0x5A33U);
  memory_[reg::kWatchdogStatus] = watchdog_good_ ? 1 : 0;
  unsigned control = load_u16(memory_, reg::kSiiControl) & sii_control::kErrors;
  if (sii_busy_ > 0) control |= sii_control::kBusy;
  if (config_.sii_reads_eight) control |= sii_control::kReadsEight;
  if (sii_.size() >= 16 && !sii_sealed()) control |= sii_control::kChecksumError;
  store_u16(memory_, reg::kSiiControl, control);
  for (int i = 0; i < kManagers; ++i) {
    memory_[reg::sm_status(i)] = static_cast<std::uint8_t>(manager_status(i));
    const auto& m = managers_[static_cast<std::size_t>(i)];
    memory_[reg::sm_pdi(i)] = m.repeat ? sm::kRepeatAck : 0;
  }
  store_u16(memory_, reg::kEventRequest, event_request());
  const std::uint64_t offset = load_u32(memory_, reg::kDcOffset) |
                               std::uint64_t{load_u32(memory_, reg::kDcOffset + 4)} << 32U;
  store_u64(memory_, reg::kDcSystem, static_cast<std::uint64_t>(passing_ns(now)) + offset);
}

bool Esc::write(std::size_t at, std::span<const std::uint8_t> in, rt::Time now) noexcept {
  if (at >= reg::kRam) return write_ram(at, in, now);
  for (std::size_t i = 0; i < in.size(); ++i) write_register(at + i, in[i]);
  act_on_write(at, in.size(), now);
  return true;
}

// Not an FMMU or sync manager beyond those that 0x0004 and 0x0005 count: these read 0.
bool Esc::is_built(std::size_t at) const noexcept {
  if (at >= reg::kFmmu && at < reg::fmmu(16)) return at < reg::fmmu(config_.fmmus);
  if (at >= reg::kSm && at < reg::sync_manager(kManagers))
    return at < reg::sync_manager(config_.sync_managers);
  return true;
}

void Esc::write_register(std::size_t at, std::uint8_t value) noexcept {
  const auto in = [&](const Range& r) { return at >= r.first && at <= r.last; };
  if (at >= reg::kRxErrors && at < reg::kLostLinks + 4) return clear_counters(at);
  if (std::none_of(kWritable.begin(), kWritable.end(), in) || !is_built(at)) return;
  if (at >= reg::kSm && at < reg::kSm + reg::kSmBytes * kManagers) {
    const std::size_t place = (at - reg::kSm) % reg::kSmBytes;
    const std::size_t base = at - place;
    const bool enabled = (memory_[base + 6] & sm::kEnable) != 0;
    if (place == 5 || place == 7) return;  // status and application's side
    if (place < 5 && enabled) return;      // only while it is off
  }
  memory_[at] = value;
}

void Esc::act_on_write(std::size_t at, std::size_t size, rt::Time now) noexcept {
  if (touches(at, size, reg::kAlControl, 1)) request_state(memory_[reg::kAlControl], now);
  if (touches(at, size, reg::kSiiControl, 2)) run_sii_command();
  if (touches(at, size, reg::kDcReceive, 4)) latch_clocks(now);
  for (int i = 0; i < kManagers; ++i)
    if (touches(at, size, reg::sync_manager(i), reg::kSmBytes)) activate(i, now);
}

// ESC data sheet II, registers 0x0500 to 0x050F.
void Esc::run_sii_command() noexcept {
  const unsigned control = load_u16(memory_, reg::kSiiControl);
  store_u16(memory_, reg::kSiiControl, 0);           // a command clears the errors
  if ((memory_[reg::kSiiAccess] & 1U) != 0) return;  // the application's
  const std::size_t at = 2 * static_cast<std::size_t>(load_u32(memory_, reg::kSiiAddress));
  const unsigned command =
      control & (sii_control::kRead | sii_control::kWrite | sii_control::kReload);
  if (command == 0) return;
  sii_busy_ = config_.sii_busy_looks;
  if (command == sii_control::kRead) {
    const std::size_t width = config_.sii_reads_eight ? 8 : 4;
    for (std::size_t i = 0; i < width; ++i)
      memory_[reg::kSiiData + i] = at + i < sii_.size() ? sii_[at + i] : std::uint8_t{0xFF};
  } else if (command == sii_control::kWrite && (control & sii_control::kWriteEnable) != 0) {
    for (std::size_t i = 0; i < 2 && at + i < sii_.size(); ++i)
      sii_[at + i] = memory_[reg::kSiiData + i];
  } else if (command == sii_control::kReload) {
    load_configuration(false);
  } else {
    store_u16(memory_, reg::kSiiControl,
              command == sii_control::kWrite ? sii_control::kWriteError : sii_control::kNoAnswer);
  }
}

void Esc::latch_clocks(rt::Time now) noexcept {
  const auto ns = static_cast<std::uint64_t>(passing_ns(now));
  store_u32(memory_, reg::kDcReceive, static_cast<std::uint32_t>(ns));
  // Port 1: back from the slaves behind. The others have no link, and latch nothing.
  const std::uint64_t around = 2 * behind_ * static_cast<std::uint64_t>(kHop.count());
  if (behind_ > 0) store_u32(memory_, reg::kDcReceive + 4, static_cast<std::uint32_t>(ns + around));
  store_u64(memory_, reg::kDcUnit, ns);
}

}  // namespace drivers::ethercat
