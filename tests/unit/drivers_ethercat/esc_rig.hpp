// Virtual slaves that echo, and a master's registers in front of them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>

#include "drivers/ethercat/register_access.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"

namespace tests {

namespace ec = drivers::ethercat;
using Bytes = std::vector<std::uint8_t>;

// Inputs are the outputs plus one; the mailbox turns bytes round.
struct Echo final : ec::EscApplication {
  Bytes last;
  void on_outputs(std::span<const std::uint8_t> b, rt::Time) noexcept override {
    last.assign(b.begin(), b.end());
  }
  void fill_inputs(std::span<std::uint8_t> b, rt::Time) noexcept override {
    for (std::size_t i = 0; i < b.size(); ++i)
      b[i] = static_cast<std::uint8_t>((i < last.size() ? last[i] : 0) + 1);
  }
  bool on_mailbox(std::span<const std::uint8_t> q, std::span<std::uint8_t> a,
                  rt::Time) noexcept override {
    std::reverse_copy(q.begin(), q.end(), a.begin());
    return true;
  }
};

struct WireRig {
  explicit WireRig(int count = 3, ec::EscConfig esc = {}, std::uint16_t protocols = 0) {
    for (int i = 0; i < count; ++i) {
      ec::SiiBuilder sii;
      sii.identity(7, 8, 9, static_cast<std::uint32_t>(i))
          .mailbox(0x1000, 32, 0x1020, 32, protocols);
      sii.strings({"echo"}).fmmus({1, 2});
      sii.managers({{0x1000, 32, 0x26, 1, 1},
                    {0x1020, 32, 0x22, 1, 2},
                    {0x1100, 4, 0x64, 1, 3},
                    {0x1180, 6, 0x20, 1, 4}});
      wire.add(
          std::make_unique<ec::Esc>(startup.token(), esc, sii.image(), std::make_unique<Echo>()));
    }
  }
  // One datagram; its counter.
  int run(ec::Command c, std::uint32_t address, Bytes& data) {
    return registers.run(c, address, data).value_or(0xFFFF);
  }
  void scan_all() {
    auto found = ec::scan(startup.token(), registers);
    ASSERT_TRUE(found) << found.error();
    slaves = found.value();
    mapping = ec::map_process_data(slaves).value();
  }
  void all_to(ec::AlState s) {
    for (std::size_t i = 0; i < slaves.size(); ++i) {
      ASSERT_TRUE(ec::to_preop(registers, slaves[i], mapping.slaves[i], std::chrono::seconds{1}));
      if (s == ec::AlState::kPreOp) continue;
      const auto done =
          ec::to_safeop(registers, slaves[i], mapping.slaves[i], std::chrono::seconds{1});
      ASSERT_TRUE(done) << done.error();
    }
  }
  ec::AlStatus al(std::size_t i) { return ec::read_al_status(registers, slaves[i].station); }

  rt::Startup startup;
  ec::TwinChain wire;
  ec::TwinPort port{wire};
  ec::RegisterAccess registers{port};
  std::vector<ec::SlaveInfo> slaves;
  ec::ProcessMapping mapping;
};

}  // namespace tests
