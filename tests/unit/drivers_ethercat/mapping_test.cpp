// Which FMMU maps which direction: what category 40 names, and what the slave has.
#include "drivers/ethercat/mapping.hpp"

#include <gtest/gtest.h>

namespace {

using namespace drivers::ethercat;

SlaveInfo slave_with(std::vector<std::uint8_t> fmmus, std::uint8_t count, bool outputs = true) {
  SlaveInfo s;
  s.station = 0x1001;
  s.fmmus = count;
  s.sync_managers = 4;
  s.sii.fmmus = std::move(fmmus);
  s.sii.sync_managers = {{}, {}, {0x1100, 5, 0x64, 1, 3}, {0x1400, 20, 0x20, 1, 4}};
  if (!outputs) s.sii.sync_managers[2] = {};
  return s;
}

struct Units {
  int outputs = -1, inputs = -1;
  bool operator==(const Units&) const = default;
};

// From the blocks as they go to the slave: FMMU registers lie at 0x0600, 16 bytes each, type in 11.
Units units_of(const SlaveInfo& s) {
  const auto mapping = map_process_data({s});
  EXPECT_TRUE(mapping) << mapping.error();
  if (!mapping) return {};
  Units u;
  const SlaveMapping& m = mapping.value().slaves[0];
  for (int k = 0; k < m.data_blocks; ++k) {
    const RegisterBlock& b = m.data_setup[static_cast<std::size_t>(k)];
    if (b.size != 16) continue;
    (b.bytes[11] == 2 ? u.outputs : u.inputs) = (b.reg - 0x0600) / 16;
  }
  return u;
}

TEST(Mapping, EveryDirectionHasAnFmmuOfItsOwn) {
  const std::vector<std::pair<std::vector<std::uint8_t>, Units>> cases{
      {{}, {0, 1}},     {{1, 2}, {0, 1}},    {{2, 1}, {1, 0}},          {{2}, {1, 0}},
      {{1}, {0, 1}},    {{0xFF, 1}, {1, 0}}, {{0xFF, 2}, {0, 1}},       {{2, 2}, {1, 0}},
      {{3, 1}, {1, 0}}, {{1, 2, 3}, {0, 1}}, {{0xFF, 0xFF, 1}, {2, 0}}, {{3, 0xFF, 2}, {0, 2}}};
  for (const auto& [named, wanted] : cases) {
    const Units is = units_of(slave_with(named, 4));
    EXPECT_EQ(is, wanted) << testing::PrintToString(named) << ": outputs on " << is.outputs
                          << ", inputs on " << is.inputs;
  }
}

// What the SII names is only taken where the slave has it (register 0x0004).
TEST(Mapping, NoFmmuBeyondThoseOfTheSlave) {
  EXPECT_EQ(units_of(slave_with({0xFF, 0xFF, 1, 2}, 2)), (Units{0, 1}));
  EXPECT_EQ(units_of(slave_with({0xFF, 2, 1}, 2)), (Units{0, 1}));
  EXPECT_EQ(units_of(slave_with({2, 0xFF, 1}, 2)), (Units{1, 0}));
  EXPECT_EQ(units_of(slave_with({0xFF, 2}, 1, false)), (Units{-1, 0}));
  EXPECT_FALSE(map_process_data({slave_with({1, 2}, 1)})) << "two directions, one FMMU";
}

}  // namespace
