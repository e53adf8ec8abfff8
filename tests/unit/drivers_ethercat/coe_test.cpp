// SDO over the mailbox: bytes of the standard's tables, both sizes, aborts, messages in between.
#include "drivers/ethercat/coe.hpp"

#include <gtest/gtest.h>

#include "drivers/ethercat/mailbox_client.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"
#include "rt/random.hpp"
#include "tests/unit/drivers_ethercat/coe_slave.hpp"

namespace tests {
namespace {

using namespace drivers::ethercat;
using Bytes = std::vector<std::uint8_t>;

TEST(Coe, BytesOfTheRequests) {
  EXPECT_EQ(encode_sdo_upload({0x1018, 1}, 2),
            (Bytes{10, 0, 0, 0, 0, 0x23, 0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0}));
  const Bytes two{0x34, 0x12};
  EXPECT_EQ(encode_sdo_download({0x6040, 0}, two, 7, 64).value(),
            (Bytes{10, 0, 0, 0, 0, 0x73, 0, 0x20, 0x2B, 0x40, 0x60, 0, 0x34, 0x12, 0, 0}));
  const Bytes five{1, 2, 3, 4, 5};
  EXPECT_EQ(encode_sdo_download({0x1008, 0}, five, 1, 64).value(),
            (Bytes{15, 0, 0, 0, 0, 0x13, 0, 0x20, 0x21, 0x08, 0x10, 0, 5, 0, 0, 0, 1, 2, 3, 4, 5}));
  EXPECT_FALSE(encode_sdo_download({0x1008, 0}, five, 1, 20));
  EXPECT_FALSE(encode_sdo_download({0x1008, 0}, {}, 1, 64));
}

TEST(Coe, CounterGoesFromOneToSeven) {
  std::uint8_t c = 0;
  for (int i = 0; i < 50; ++i) {
    c = next_counter(c);
    EXPECT_EQ(c, i % 7 + 1);
  }
}

struct CoeRig {
  explicit CoeRig(std::uint16_t protocols = 4) {
    SiiBuilder sii;
    sii.identity(1, 2, 3, 4).mailbox(0x1000, 64, 0x1040, 64, protocols).strings({"coe"});
    sii.managers({{0x1000, 64, 0x26, 1, 1}, {0x1040, 64, 0x22, 1, 2}});
    auto made = std::make_unique<CoeSlave>();
    slave = made.get();
    wire.add(std::make_unique<Esc>(startup.token(), EscConfig{}, sii.image(), std::move(made)));
    RegisterAccess r(port);
    info = scan(startup.token(), r).value().at(0);
    const auto m = map_process_data({info}).value().slaves[0];
    EXPECT_TRUE(to_preop(r, info, m, std::chrono::seconds{1}));
  }
  rt::Startup startup;
  TwinChain wire;
  TwinPort port{wire};
  CoeSlave* slave = nullptr;
  SlaveInfo info;
  MailboxClient client{port};
};

TEST(Coe, ReadsAndWritesEverySizeThatFits) {
  CoeRig rig;
  for (std::size_t n = 1; n <= 48; ++n) {
    Bytes v(n);
    for (std::size_t i = 0; i < n; ++i) v[i] = static_cast<std::uint8_t>(3 * i + n);
    rig.slave->objects[0x200001] = {};
    const auto w = rig.client.sdo_download(rig.info, {0x2000, 1}, v);
    ASSERT_TRUE(w) << w.error();
    EXPECT_EQ(rig.slave->objects[0x200001], v);
    const auto r = rig.client.sdo_upload(rig.info, {0x2000, 1});
    ASSERT_TRUE(r) << r.error();
    EXPECT_EQ(r.value(), v);
  }
  rig.slave->objects[0x200001].assign(49, 1);
  EXPECT_NE(rig.client.sdo_upload(rig.info, {0x2000, 1}).error().find("segments are not served"),
            std::string::npos);
  for (std::size_t i = 0; i < rig.slave->counters.size(); ++i)
    ASSERT_EQ(rig.slave->counters[i], i % 7 + 1);
}

TEST(Coe, AbortsAndOthersMessages) {
  CoeRig rig;
  const auto no = rig.client.sdo_upload(rig.info, {0x1234, 5});
  ASSERT_FALSE(no);
  EXPECT_EQ(no.error(), "slave 1 'coe': mailbox: object 0x1234:5: object does not exist");
  rig.slave->objects[0x100000] = {1, 2};
  rig.slave->emergencies_before_reply = 1;
  // The emergency is answered in place of the reply; who asks reads on, and finds no reply.
  EXPECT_FALSE(rig.client.sdo_upload(rig.info, {0x1000, 0}));
  EXPECT_TRUE(rig.client.sdo_upload(rig.info, {0x1000, 0}));
  CoeRig without(0);
  EXPECT_NE(without.client.sdo_upload(without.info, {0x1000, 0}).error().find("no CoE"),
            std::string::npos);
}

TEST(Coe, AnyBytes) {
  const std::uint64_t seed = 61;
  rt::Random random(seed);
  for (int i = 0; i < 50000; ++i) {
    Bytes b(static_cast<std::size_t>(random.integer(0, 40)));
    for (auto& x : b) x = static_cast<std::uint8_t>(random.integer(0, 255));
    // Half of them look like a reply.
    if (b.size() > 16 && random.uniform() < 0.5) {
      const Bytes head{
          static_cast<std::uint8_t>(b.size() - 6), 0, 0, 0, 0, 0x13, 0, 0x30, b[8], 0x00, 0x10, 0};
      std::copy(head.begin(), head.end(), b.begin());
    }
    const auto r = decode_sdo_reply(b, {0x1000, 0}, random.uniform() < 0.5);
    if (!r) {
      EXPECT_EQ(r.error().find('\n'), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace tests
