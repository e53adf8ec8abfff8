// Registers of an EtherCAT slave controller that master and virtual slaves use.
// Source: Beckhoff ESC data sheet section II (register description), the number is the register's
// own there; meanings are those of ETG.1000.4, clauses 6.1 to 6.9, and of AL registers ETG.1000.6,
// 5.3. Sizes in bytes. Distributed clocks (0x0900 and on): the virtual chain answers them, the
// master does not use them.
#pragma once

#include <cstdint>

namespace drivers::ethercat {

namespace reg {
// ESC information
inline constexpr std::uint16_t kType = 0x0000;            // 1
inline constexpr std::uint16_t kRevision = 0x0001;        // 1
inline constexpr std::uint16_t kBuild = 0x0002;           // 2
inline constexpr std::uint16_t kFmmuCount = 0x0004;       // 1
inline constexpr std::uint16_t kSyncManagers = 0x0005;    // 1
inline constexpr std::uint16_t kRamKiB = 0x0006;          // 1
inline constexpr std::uint16_t kPortDescriptor = 0x0007;  // 1, two bits a port: 1 none, 3 MII
inline constexpr std::uint16_t kFeatures = 0x0008;        // 2
// Addresses
inline constexpr std::uint16_t kStation = 0x0010;       // 2
inline constexpr std::uint16_t kStationAlias = 0x0012;  // 2
// Data link layer
inline constexpr std::uint16_t kDlControl = 0x0100;      // 4
inline constexpr std::uint16_t kDlLoopControl = 0x0101;  // 1
inline constexpr std::uint16_t kDlAlias = 0x0103;        // 1, bit 0: use the alias
inline constexpr std::uint16_t kDlStatus = 0x0110;       // 2
// Application layer
inline constexpr std::uint16_t kAlControl = 0x0120;     // 2, bits 0-3 state, 4 acknowledge
inline constexpr std::uint16_t kAlStatus = 0x0130;      // 2, bits 0-3 state, 4 error
inline constexpr std::uint16_t kAlStatusCode = 0x0134;  // 2
inline constexpr std::uint16_t kPdiControl = 0x0140;    // 1, then 1 of the controller's own
inline constexpr std::uint16_t kPdiConfig = 0x0150;     // 2, then 2 more of it
// Events and error counters
inline constexpr std::uint16_t kEventMask = 0x0200;     // 2
inline constexpr std::uint16_t kEventRequest = 0x0210;  // 2
inline constexpr std::uint16_t kRxErrors = 0x0300;    // 8, a port: frames refused, symbols refused
inline constexpr std::uint16_t kForwarded = 0x0308;   // 4, a byte a port: refused before
inline constexpr std::uint16_t kUnitErrors = 0x030C;  // 1, frames the processing unit refused
inline constexpr std::uint16_t kPdiErrors = 0x030D;   // 1
inline constexpr std::uint16_t kLostLinks = 0x0310;   // 4, a byte a port
// Watchdogs
inline constexpr std::uint16_t kWatchdogDivider = 0x0400;  // 2, (n + 2) * 40 ns
inline constexpr std::uint16_t kPdiWatchdog = 0x0410;      // 2, in units of the divider
inline constexpr std::uint16_t kDataWatchdog = 0x0420;     // 2, in units of the divider, 0 off
inline constexpr std::uint16_t kWatchdogStatus = 0x0440;   // 2, bit 0: not expired
inline constexpr std::uint16_t kWatchdogCount = 0x0442;    // 1, expiries
// SII access
inline constexpr std::uint16_t kSiiAccess = 0x0500;   // 1, 0 master, 1 application, 2 take away
inline constexpr std::uint16_t kSiiState = 0x0501;    // 1
inline constexpr std::uint16_t kSiiControl = 0x0502;  // 2
inline constexpr std::uint16_t kSiiAddress = 0x0504;  // 4, in words
inline constexpr std::uint16_t kSiiData = 0x0508;     // 8
// FMMUs and sync managers
inline constexpr std::uint16_t kFmmu = 0x0600;  // 16 each
inline constexpr std::uint16_t kSm = 0x0800;    // 8 each
inline constexpr std::uint16_t kFmmuBytes = 16, kSmBytes = 8;
// Distributed clocks
inline constexpr std::uint16_t kDcReceive = 0x0900;   // 16, a write latches the ports' times
inline constexpr std::uint16_t kDcSystem = 0x0910;    // 8
inline constexpr std::uint16_t kDcUnit = 0x0918;      // 8, local time of the last latch
inline constexpr std::uint16_t kDcOffset = 0x0920;    // 8
inline constexpr std::uint16_t kDcDelay = 0x0928;     // 4
inline constexpr std::uint16_t kDcActivate = 0x0981;  // 1, cyclic unit and its sync signals
inline constexpr std::uint16_t kRam = 0x1000;

constexpr std::uint16_t fmmu(int i) { return static_cast<std::uint16_t>(kFmmu + kFmmuBytes * i); }
constexpr std::uint16_t sync_manager(int i) {
  return static_cast<std::uint16_t>(kSm + kSmBytes * i);
}
// Bytes of a sync manager: 0 start (2), 2 length (2), 4 control, 5 status, 6 activate, 7 PDI
// control.
constexpr std::uint16_t sm_status(int i) { return static_cast<std::uint16_t>(sync_manager(i) + 5); }
constexpr std::uint16_t sm_activate(int i) {
  return static_cast<std::uint16_t>(sync_manager(i) + 6);
}
constexpr std::uint16_t sm_pdi(int i) { return static_cast<std::uint16_t>(sync_manager(i) + 7); }
}  // namespace reg

// Bits of 0x0008, features.
namespace feature {
inline constexpr std::uint16_t kByteFmmu = 1U << 0U, kClocks = 1U << 2U, kNoLrw = 1U << 9U;
}

// Bits of 0x0200 and 0x0210 (ESC data sheet II, "ECAT event request"): a new DL or AL status until
// the master reads it; from bit 4 on sync manager 0 and on, while its status has an event.
namespace event {
inline constexpr std::uint16_t kDlStatus = 1U << 2U, kAlStatus = 1U << 3U, kManager0 = 1U << 4U;
}

// Bits of 0x0502 (ESC data sheet II, "EEPROM control/status").
namespace sii_control {
inline constexpr std::uint16_t kWriteEnable = 1U << 0U, kReadsEight = 1U << 6U, kRead = 1U << 8U,
                               kWrite = 1U << 9U, kReload = 1U << 10U, kChecksumError = 1U << 11U,
                               kLoadError = 1U << 12U, kNoAnswer = 1U << 13U,
                               kWriteError = 1U << 14U, kBusy = 1U << 15U;
inline constexpr std::uint16_t kErrors = kChecksumError | kLoadError | kNoAnswer | kWriteError;
}  // namespace sii_control

// Bits of a sync manager's bytes (ETG.1000.4, 6.7).
namespace sm {
inline constexpr std::uint8_t kModeMask = 0x03, kMailbox = 0x02;  // control
inline constexpr std::uint8_t kDirectionMask = 0x0C, kMasterWrites = 0x04;
inline constexpr std::uint8_t kMasterEvent = 0x10, kWatchdog = 0x40;
inline constexpr std::uint8_t kWritten = 0x01, kRead = 0x02, kFull = 0x08;  // status
inline constexpr std::uint8_t kEnable = 0x01, kRepeatRequest = 0x02;        // activate
inline constexpr std::uint8_t kPdiDisable = 0x01, kRepeatAck = 0x02;        // PDI control
}  // namespace sm

// Of an FMMU, ETG.1000.4, 6.6: type (byte 11).
namespace fmmu_type {
inline constexpr std::uint8_t kRead = 1, kWrite = 2;
}

}  // namespace drivers::ethercat
