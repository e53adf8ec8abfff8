// The operator's console at a device that has braked: of a twin it acts for the person, of a device
// it waits for one.
#include "tools/host/console.hpp"

#include <gtest/gtest.h>

namespace {

using drivers::DeviceState;

// So many times the console asked for forces: braked for 2 s, then the clutch pressed for 100 ms
// and let go.
struct Asked {
  std::uint32_t waiting = 0, after_the_clutch = 0;
  std::string status;  // while it waits
};

Asked asked_of(std::vector<std::string> overrides) {
  static rt::Startup startup;
  overrides.push_back(
      "fusion.tsdf.voxel_size_m=0.02");  // of the window that the scene's scale wants
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  teletact::BoxOptions options;
  options.epoch = rt::time_from_ns(1'000'000'000);
  options.real_devices = true;
  teletact::OperatorBox box(startup.token(), *scene, teletact::camera_of(*scene), options);
  teletact::OperatorConsole console(box, *scene, options.epoch);
  rt::Time now = options.epoch;
  const auto pass = [&](int ms, bool clutch) {
    for (int i = 0; i < ms; ++i) {
      now += std::chrono::milliseconds{1};
      tasks::HapticSample s;
      s.stamp = now;
      s.device_state = static_cast<std::uint8_t>(DeviceState::kBrake);
      s.clutched = clutch;
      box.graph().cells().haptic_samples.try_push(s);
      if (i % 20 == 19) console.tick(now);
    }
  };
  Asked asked;
  pass(2000, false);
  asked.waiting = console.seen().device_brakes;
  asked.status = console.status_line(now);
  pass(100, true);
  pass(100, false);
  asked.after_the_clutch = console.seen().device_brakes;
  return asked;
}

TEST(Console, ForcesOfARealDeviceComeBackByTheClutchOnly) {
  const Asked real = asked_of({"device.kind=\"mouse\"", "device.mouse.path=\"\""});
  EXPECT_EQ(real.waiting, 0U);
  EXPECT_EQ(real.after_the_clutch, 1U);
  EXPECT_NE(real.status.find("forces off: press the clutch and let go"), std::string::npos)
      << real.status;
  const Asked twin = asked_of({});
  EXPECT_GE(twin.waiting, 5U);
  EXPECT_EQ(twin.status.find("forces off"), std::string::npos) << twin.status;
}

}  // namespace
