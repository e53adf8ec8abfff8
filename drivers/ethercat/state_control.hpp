// A slave from one state to the next, waiting for it: set-up and bench.
// Source: ETG.1000.6, 5.3 and 6.4 (state machine); registers 0x0120, 0x0130, 0x0134.
#pragma once

#include "drivers/ethercat/mapping.hpp"
#include "drivers/ethercat/register_access.hpp"

namespace drivers::ethercat {

// One step. An error that stands is acknowledged first (ETG.1000.6, 5.3), and the step is asked for
// once the slave shows none; all of it within the timeout. The error: the slave's label, the state
// that it refuses, its AL status code as text; or that nothing changed in time.
[[nodiscard]] rt::Result<bool> request_state(RegisterAccess&, const SlaveInfo&, AlState,
                                             rt::Nanos timeout);

// INIT to PREOP: mailbox sync managers first; the EEPROM goes to the application.
[[nodiscard]] rt::Result<bool> to_preop(RegisterAccess&, const SlaveInfo&, const SlaveMapping&,
                                        rt::Nanos timeout);
// PREOP to SAFEOP: sync managers and FMMUs of process data first.
[[nodiscard]] rt::Result<bool> to_safeop(RegisterAccess&, const SlaveInfo&, const SlaveMapping&,
                                         rt::Nanos timeout);

}  // namespace drivers::ethercat
