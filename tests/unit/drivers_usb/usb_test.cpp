// The code that calls libusb: what is plugged in, and the Falcon's asynchronous transfers, on a
// libusb that keeps the rules. Real time on purpose: the event thread is the thing under test.
#include <gtest/gtest.h>
#include <libusb.h>

#include <thread>

#include "drivers/falcon/falcon_device.hpp"
#include "drivers/falcon/libusb_transport.hpp"
#include "drivers/omega/omega_device.hpp"
#include "drivers/usb/usb_scan.hpp"
#include "tests/unit/drivers_usb/fake_libusb.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::DeviceState;
using drivers::FalconConfig;
using drivers::FalconDevice;
using drivers::FalconTwin;
using drivers::FalconTwinConfig;
using drivers::LibusbFalconTransport;
using drivers::UsbId;
using drivers::UsbPresence;
using drivers::UsbVerdict;
using fake_libusb::Bus;
using perception::Vec3;

constexpr fake_libusb::Device kFalcon{0x0403, 0xcb48, 3, 7, 0, 0};

struct BusTest : testing::Test {
  BusTest() { fake_libusb::reset(); }
  ~BusTest() override {
    // Whatever was opened is closed, and nobody broke a rule.
    fake_libusb::with([](Bus& b) {
      EXPECT_EQ(b.contexts, 0);
      EXPECT_EQ(b.handles, 0);
      EXPECT_EQ(b.transfers, 0);
      EXPECT_EQ(b.claimed, 0);
      EXPECT_EQ(b.lists, 0);
      EXPECT_EQ(b.offences, std::vector<std::string>{});
    });
    fake_libusb::reset();
  }
  static UsbVerdict omega() {
    return drivers::judge(drivers::scan_usb(drivers::OmegaDevice::kUsbIds),
                          drivers::OmegaDevice::kUsbIds, "the.rules");
  }
  static void plug(const fake_libusb::Device& d) {
    fake_libusb::with([&](Bus& b) { b.devices.push_back(d); });
  }
};

using UsbScanTest = BusTest;

TEST_F(UsbScanTest, NothingPluggedIn) {
  plug({0x0403, 0x6001, 1, 2, 0, 0});
  plug({0x1d6b, 0x0002, 1, 1, 0, 0});
  EXPECT_EQ(omega().presence, UsbPresence::kAbsent);
}

TEST_F(UsbScanTest, EitherControllerIsFound) {
  plug({0x1451, 0x0301, 2, 5, 0, 0});
  EXPECT_EQ(omega().presence, UsbPresence::kUsable);
  EXPECT_EQ(omega().text, "1451:0301 (Force Dimension controller) on bus 2 device 5");
  fake_libusb::reset();
  plug({0x1451, 0x0402, 1, 9, 0, 0});
  EXPECT_EQ(omega().text, "1451:0402 (omega.x) on bus 1 device 9");
}

TEST_F(UsbScanTest, NoPermissionAndBusy) {
  plug({0x1451, 0x0402, 1, 9, LIBUSB_ERROR_ACCESS, 0});
  EXPECT_EQ(omega().presence, UsbPresence::kNoPermission);
  EXPECT_NE(omega().text.find("udev rule missing; copy the.rules to"), std::string::npos);
  fake_libusb::reset();
  plug({0x1451, 0x0402, 1, 9, LIBUSB_ERROR_BUSY, 0});
  EXPECT_EQ(omega().presence, UsbPresence::kBusy);
}

TEST_F(UsbScanTest, UsbItselfIsMissing) {
  fake_libusb::with([](Bus& b) { b.init_error = LIBUSB_ERROR_NOT_FOUND; });
  EXPECT_EQ(omega().text, "USB can not be read on this machine: Entity not found");
  fake_libusb::reset();
  fake_libusb::with([](Bus& b) { b.list_error = LIBUSB_ERROR_NOT_FOUND; });
  EXPECT_EQ(omega().presence, UsbPresence::kNoUsb);
}

// ---- the Falcon's transfers

struct FalconUsbTest : BusTest {
  rt::Startup startup;
  FalconTwin twin{startup.token(), config()};
  FalconConfig device_config;
  std::unique_ptr<FalconDevice> device;
  drivers::StylusSample sample;
  std::int64_t now_ns = 0;
  bool sensed = false;

  FalconUsbTest() {
    device_config.retry_s = 0.01;
    device_config.lost_after_s = 3;  // a busy test machine is no lost device
    plug(kFalcon);
    fake_libusb::with([&](Bus& b) { b.twin = &twin; });
  }
  ~FalconUsbTest() override { device.reset(); }
  static FalconTwinConfig config() {
    FalconTwinConfig c;
    c.plant.hand_stiffness_N_per_m = 0;
    c.plant.mass_kg = 5;
    c.loaded = c.homed = true;
    return c;
  }
  void open() {
    device = std::make_unique<FalconDevice>(startup.token(), device_config,
                                            [] { return LibusbFalconTransport::open(0); });
  }
  std::string refused() {
    try {
      open();
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "opened";
  }
  void tick(const Vec3& f = Vec3::Zero()) {
    std::this_thread::sleep_for(1ms);
    const rt::Time now = rt::time_from_ns(now_ns += 1'000'000);
    sensed = device->sense(now, sample);
    device->act(now, {f});
  }
  template <class Done>
  bool wait_until(Done done, const Vec3& f = Vec3::Zero()) {
    for (int i = 0; i < 10000; ++i) {
      if (done()) return true;
      tick(f);
    }
    return false;
  }
  Vec3 motor() {
    Vec3 f;
    fake_libusb::with([&](Bus&) { f = twin.motor_force_D(); });
    return f;
  }
  void enable() {
    device->request_enable();
    ASSERT_TRUE(wait_until([&] { return sensed && sample.state == DeviceState::kForce; }));
  }
};

TEST_F(FalconUsbTest, StreamsAndRendersAForce) {
  open();
  enable();
  ASSERT_TRUE(
      wait_until([&] { return (motor() - Vec3(1, 0.5, 0)).norm() < 0.05; }, Vec3(1, 0.5, 0)));
  for (int i = 0; i < 50; ++i) tick({1, 0.5, 0});
  fake_libusb::with([](Bus& b) {
    EXPECT_GT(b.completed, 20U);
    EXPECT_EQ(b.allocated, 4U);  // three in, one out: once, before the loop
    EXPECT_LE(b.most_in_flight, 4);
    EXPECT_GE(b.most_in_flight, 3);
  });
  EXPECT_GT(device->round_trips().count(), 5U);
}

TEST_F(FalconUsbTest, ClosingEndsWithZeroTorque) {
  open();
  enable();
  ASSERT_TRUE(wait_until([&] { return motor().norm() > 0.5; }, Vec3(1, 0, 0)));
  device.reset();
  EXPECT_EQ(motor(), Vec3::Zero());
}

TEST_F(FalconUsbTest, UnplugInForceAndBackManyTimes) {
  open();
  for (int i = 1; i <= 5; ++i) {
    enable();
    ASSERT_TRUE(wait_until([&] { return motor().norm() > 0.5; }, Vec3(1, 0, 0)));
    fake_libusb::with([](Bus& b) { b.devices.clear(); });
    ASSERT_TRUE(wait_until([&] { return !device->connected() && !sensed; }, Vec3(1, 0, 0)));
    std::this_thread::sleep_for(20ms);  // some tries to open find nothing
    plug(kFalcon);
    ASSERT_TRUE(wait_until([&] { return sensed; }, Vec3(1, 0, 0)));
    EXPECT_EQ(sample.state, DeviceState::kBrake);
    ASSERT_TRUE(wait_until([&] { return motor() == Vec3::Zero(); }, Vec3(1, 0, 0)));
    // Counted by the device's own thread, after it has let the first sample through.
    EXPECT_TRUE(wait_until([&] { return device->counters().reopened >= static_cast<unsigned>(i); },
                           Vec3::Zero()));
    EXPECT_EQ(device->counters().reopened, static_cast<unsigned>(i));
  }
}

TEST_F(FalconUsbTest, SingleTransferErrorsAreLivedThrough) {
  open();
  for (const int status :
       {LIBUSB_TRANSFER_ERROR, LIBUSB_TRANSFER_OVERFLOW, LIBUSB_TRANSFER_TIMED_OUT}) {
    fake_libusb::with([&](Bus& b) { b.next_statuses = {status, status, status}; });
    ASSERT_TRUE(wait_until([&] {
      bool used = false;
      fake_libusb::with([&](Bus& b) { used = b.next_statuses.empty(); });
      return used;
    }));
    const auto frames = device->counters().frames;
    ASSERT_TRUE(wait_until([&] { return device->counters().frames > frames + 5; }));
  }
  EXPECT_EQ(device->counters().losses, 0U);
}

TEST_F(FalconUsbTest, StallAndManyErrorsOpenAgain) {
  open();
  fake_libusb::with([&](Bus& b) { b.next_statuses = {LIBUSB_TRANSFER_STALL}; });
  ASSERT_TRUE(wait_until([&] { return device->counters().reopened == 1 && sensed; }));
  fake_libusb::with([&](Bus& b) { b.next_statuses = std::vector<int>(25, LIBUSB_TRANSFER_ERROR); });
  ASSERT_TRUE(wait_until([&] { return device->counters().reopened == 2 && sensed; }));
  EXPECT_EQ(device->counters().losses, 2U);
}

TEST_F(FalconUsbTest, EachMissingPieceIsOneLine) {
  fake_libusb::with([](Bus& b) { b.devices[0].open_error = LIBUSB_ERROR_ACCESS; });
  EXPECT_EQ(
      refused().find("falcon: 0403:cb48 (Novint Falcon) on bus 3 device 7: no permission: udev "
                     "rule missing; copy config/system/udev/70-teletact-haptic.rules"),
      0U);
  fake_libusb::with([](Bus& b) {
    b.devices[0].open_error = 0;
    b.devices[0].claim_error = LIBUSB_ERROR_BUSY;
  });
  EXPECT_EQ(refused(),
            "falcon: 0403:cb48 (Novint Falcon): the interface can not be claimed: Other error");
  fake_libusb::with([](Bus& b) {
    b.devices[0].claim_error = 0;
    b.submit_error = LIBUSB_ERROR_IO;
  });
  EXPECT_EQ(refused(), "falcon: the transfers can not be started");
  fake_libusb::with([](Bus& b) { b.devices.clear(); });
  EXPECT_EQ(refused(), "falcon: not plugged in: no USB device 0403:cb48 is there");
  fake_libusb::with([](Bus& b) { b.init_error = LIBUSB_ERROR_NOT_FOUND; });
  EXPECT_EQ(refused(), "falcon: USB can not be read on this machine: Entity not found");
}

}  // namespace
