// The firmware and the boot: what is missing or wrong is one line.
#include <array>

#include "tests/unit/drivers_falcon/device_rig.hpp"

namespace tests {
namespace {

TEST(FalconStart, LoadsTheFirmware) {
  const FirmwareFile file;
  FalconTwinConfig c = ready_twin();
  c.loaded = c.homed = false;
  c.firmware = file.bytes;
  FalconConfig d = quick_config();
  d.firmware = file.path;
  Rig rig(c, d);
  EXPECT_TRUE(rig.twin.running());
  rig.ticks(5);
  EXPECT_TRUE(rig.sensed);
}

TEST(FalconStart, EachMissingPieceIsOneLine) {
  const FirmwareFile file;
  FalconTwinConfig t = ready_twin();
  t.loaded = false;
  t.firmware = file.bytes;
  FalconConfig d = quick_config();
  EXPECT_EQ(refusal(t, d),
            "falcon: the firmware is not loaded (it is lost with the power), and "
            "device.falcon.firmware names no file");
  d.firmware = "/nonexistent/firmware.bin";
  EXPECT_EQ(refusal(t, d),
            "falcon: device.falcon.firmware = '/nonexistent/firmware.bin': can not be read, or is "
            "not between 1 byte and 1 MiB long");
  d.firmware = file.path;
  t.firmware.push_back(0);  // another firmware than the device takes
  EXPECT_EQ(refusal(t, d),
            "falcon: the firmware is loaded and does not answer: is it the right file?");
}

TEST(FalconStart, FaultsOfTheBootAreOneLineEach) {
  const FirmwareFile file;
  FalconConfig d = quick_config();
  d.firmware = file.path;
  struct Case {
    void (*set)(drivers::FalconTwinFaults&);
    const char* said;
  };
  const std::array<Case, 3> cases{{
      {[](drivers::FalconTwinFaults& f) { f.refuse_control = true; },
       "falcon: the FTDI chip refuses a setting"},
      {[](drivers::FalconTwinFaults& f) { f.deaf_monitor = true; },
       "falcon: the boot monitor does not answer: switch the Falcon off and on, or use another "
       "port"},
      {[](drivers::FalconTwinFaults& f) { f.wrong_echo = true; },
       "falcon: the firmware came back changed at byte 62"},
  }};
  for (const Case& c : cases) {
    FalconTwinConfig t = ready_twin();
    t.loaded = false;
    t.firmware = file.bytes;
    rt::Startup startup;
    FalconTwin twin(startup.token(), t);
    c.set(twin.faults());
    std::int64_t now = kMs;
    try {
      const FalconDevice device(startup.token(), d, [&] {
        return rt::Result<std::unique_ptr<FalconTransport>>(
            std::unique_ptr<FalconTransport>(std::make_unique<FalconTwinTransport>(twin, now)));
      });
      FAIL() << c.said;
    } catch (const std::runtime_error& e) {
      EXPECT_EQ(std::string(e.what()), c.said);
    }
  }
}

}  // namespace
}  // namespace tests
