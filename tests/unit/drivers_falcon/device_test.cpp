// The driver against the twin at the wire, on a clock that the test moves.
#include "drivers/falcon/falcon_device.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <thread>

#include "drivers/falcon/falcon_twin.hpp"
#include "rt/memory/section.hpp"
#include "tests/support/rt_guard.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::DeviceState;
using drivers::FalconConfig;
using drivers::FalconDevice;
using drivers::FalconTransport;
using drivers::FalconTwin;
using drivers::FalconTwinConfig;
using drivers::FalconTwinTransport;
using drivers::ForceOffCause;
using perception::Vec3;

constexpr std::int64_t kMs = 1'000'000;

FalconTwinConfig ready_twin() {
  FalconTwinConfig c;
  c.plant.coulomb_N = 0;
  c.plant.hand_stiffness_N_per_m = 0;
  c.plant.mass_kg = 0.2;
  c.plant.damping_N_s_per_m = 2;
  c.plant.workspace_radius_m = 0.06;
  c.loaded = c.homed = true;
  return c;
}

FalconConfig quick_config() {
  FalconConfig c;
  c.retry_s = 0.01;
  return c;
}

struct Rig {
  rt::Startup startup;
  std::int64_t now_ns = 50 * kMs;
  std::atomic<bool> held{false};  // the minder may open only when the test lets it
  std::mutex mutex;               // the twin has one user at a time
  FalconTwin twin;
  FalconTwinTransport* transport = nullptr;
  std::unique_ptr<FalconDevice> device;
  drivers::StylusSample sample;
  bool sensed = false;

  explicit Rig(const FalconTwinConfig& c = ready_twin(), const FalconConfig& d = quick_config(),
               const Vec3& start = Vec3::Zero())
      : twin(startup.token(), c, nullptr, start) {
    device = std::make_unique<FalconDevice>(startup.token(), d, [this] { return open(); });
    if (c.homed) ticks(3);
  }
  // The transport locks the twin for the driver's minder; the test's own thread is the event thread.
  class Locked final : public FalconTransport {
   public:
    Locked(Rig& rig) : rig_(rig), inner_(rig.twin, rig.now_ns) {}
    ~Locked() override {
      const std::lock_guard lock(rig_.mutex);
      if (rig_.current == this) rig_.current = nullptr;
    }
    bool control(std::uint8_t r, std::uint16_t v) override {
      const std::lock_guard lock(rig_.mutex);
      return inner_.control(r, v);
    }
    bool write_wait(std::span<const std::uint8_t> b, int ms) override {
      const std::lock_guard lock(rig_.mutex);
      return inner_.write_wait(b, ms);
    }
    int read_wait(std::span<std::uint8_t> b, int ms) override {
      const std::lock_guard lock(rig_.mutex);
      return inner_.read_wait(b, ms);
    }
    bool start(Listener& l) override {
      const std::lock_guard lock(rig_.mutex);
      rig_.current = this;
      return inner_.start(l);
    }
    bool send(const drivers::FalconFrame& f) noexcept override { return inner_.send(f); }
    void stop() noexcept override {
      const std::lock_guard lock(rig_.mutex);
      inner_.stop();
      if (rig_.current == this) rig_.current = nullptr;
    }
    void pump() noexcept { inner_.pump(); }

   private:
    Rig& rig_;
    FalconTwinTransport inner_;
  };
  Locked* current = nullptr;
  rt::Result<std::unique_ptr<FalconTransport>> open() {
    if (held) return rt::Error{"held by the test"};
    const std::lock_guard lock(mutex);
    if (twin.faults().unplugged) return rt::Error{"not plugged in"};
    return std::unique_ptr<FalconTransport>(std::make_unique<Locked>(*this));
  }

  // Time in quarters of a millisecond.
  void pass(std::int64_t ns) {
    for (; ns > 0; ns -= kMs / 4) {
      const std::lock_guard lock(mutex);
      now_ns += kMs / 4;
      if (current != nullptr) current->pump();
    }
  }
  rt::Time
  time_now() {  // waiting for an answer at the start of the device, its own thread moves it on
    const std::lock_guard lock(mutex);
    return rt::time_from_ns(now_ns);
  }
  void tick(const Vec3& f = Vec3::Zero(), bool command = true) {
    pass(kMs);
    const rt::Time now = time_now();
    sensed = device->sense(now, sample);
    if (command) device->act(now, {f});
  }
  void ticks(int n, const Vec3& f = Vec3::Zero()) {
    for (int i = 0; i < n; ++i) tick(f);
  }
  void enable() {
    device->request_enable();
    tick();
    ASSERT_EQ(sample.state, DeviceState::kForce);
  }
  template <class Done>
  bool wait_until(Done done) {
    for (int i = 0; i < 5000; ++i) {
      if (done()) return true;
      tick();
      std::this_thread::sleep_for(1ms);
    }
    return false;
  }
  Vec3 push(const Vec3& dv) {
    const std::lock_guard lock(mutex);
    twin.plant().push(dv);
    return dv;
  }
};

std::string refusal(const FalconTwinConfig& t, const FalconConfig& d) {
  try {
    const Rig rig(t, d);
  } catch (const std::runtime_error& e) {
    const std::string text = e.what();
    EXPECT_EQ(text.find('\n'), std::string::npos);
    return text;
  }
  return "opened";
}

struct FirmwareFile {
  std::string path =
      (std::filesystem::temp_directory_path() / ("teletact_falcon_" + std::to_string(::getpid())))
          .string();
  std::vector<std::uint8_t> bytes;
  FirmwareFile() {
    rt::Random random(521);
    for (int i = 0; i < 5000; ++i) {
      bytes.push_back(static_cast<std::uint8_t>(random.integer(0, 255)));
    }
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
  }
  ~FirmwareFile() { std::filesystem::remove(path); }
};

// ---- position and force

TEST(FalconDevice, ReadsWhereTheGripIs) {
  for (const Vec3& at : {Vec3(0, 0, 0), Vec3(0.03, -0.02, 0.01), Vec3(-0.04, 0.01, -0.02)}) {
    Rig rig(ready_twin(), quick_config(), at);
    rig.ticks(5);
    ASSERT_TRUE(rig.sensed);
    // Half an encoder step a leg.
    EXPECT_LT((rig.sample.p_DH - at).norm(), 6e-5) << at.transpose();
    EXPECT_EQ(rig.sample.state, DeviceState::kIdle);
  }
}

TEST(FalconDevice, ForceArrivesInSizeAndDirection) {
  for (const Vec3& at : {Vec3(0, 0, 0), Vec3(0.02, 0.02, -0.01)}) {
    FalconTwinConfig heavy = ready_twin();
    heavy.plant.mass_kg = 5;  // stays while the force is looked at
    Rig rig(heavy, quick_config(), at);
    rig.enable();
    for (const Vec3& f : {Vec3(2, 0, 0), Vec3(0, -3, 0), Vec3(0, 0, 1.5), Vec3(1, 1, -1)}) {
      rig.ticks(6, f);
      EXPECT_LT((rig.twin.motor_force_D() - f).norm(), 0.02 * f.norm())
          << rig.twin.motor_force_D().transpose();
    }
  }
}

TEST(FalconDevice, SaturationKeepsTheDirection) {
  FalconConfig c = quick_config();
  c.torque_limit_cnt = 1000;
  FalconTwinConfig heavy = ready_twin();
  heavy.plant.mass_kg = 5;
  Rig rig(heavy, c);
  rig.enable();
  const Vec3 f(5, 3, -4);
  rig.ticks(6, f);
  const Vec3 got = rig.twin.motor_force_D();
  EXPECT_LT(got.norm(), 0.7 * f.norm());
  EXPECT_LT(got.normalized().cross(f.normalized()).norm(), 0.01);
  EXPECT_GT(got.dot(f), 0);
  int most = 0;
  for (const auto t : rig.twin.last_command().torque_cnt) most = std::max<int>(most, std::abs(t));
  EXPECT_EQ(most, 1000);
  EXPECT_GT(rig.device->counters().saturated, 0U);
  rig.ticks(6, 100 * f);  // the force limit goes before
  EXPECT_LE(rig.twin.motor_force_D().norm(), 8.9 * 1.01);
}

TEST(FalconDevice, RunsAtOneKilohertz) {
  Rig rig;
  const auto frames = rig.twin.frames();
  rig.ticks(1000);
  EXPECT_NEAR(static_cast<double>(rig.twin.frames() - frames), 1000, 5);
  EXPECT_EQ(rig.device->counters().kicks, 0U);
}

// From the instant the encoders are read to the instant a torque computed from them is set, over all
// phases of tick against packets: not more than the delay that the device states.
TEST(FalconDevice, StatedDelayHolds) {
  double worst_s = 0;
  for (int phase = 0; phase < 4; ++phase) {
    FalconTwinConfig heavy = ready_twin();
    heavy.plant.mass_kg = 5;
    Rig rig(heavy);
    rig.enable();
    rig.pass(phase * kMs / 4);
    // A force that is a function of the sample: after a slip of the encoders the next force differs.
    for (int trial = 0; trial < 40; ++trial) {
      rig.pass((trial % 4) * kMs / 4);
      rig.twin.faults().slip_cnt = {0, 0, static_cast<std::int16_t>(trial % 2 == 0 ? 40 : 0)};
      const auto answered = rig.twin.frames();
      std::int64_t sampled = 0;
      const auto before = rig.twin.last_command().torque_cnt;
      for (int quarter = 0; quarter < 60; ++quarter) {
        rig.pass(kMs / 4);
        if (sampled == 0 && rig.twin.frames() > answered) sampled = rig.twin.exchange_ns();
        if (quarter % 4 == 3) {
          (void)rig.device->sense(rt::time_from_ns(rig.now_ns), rig.sample);
          rig.device->act(rt::time_from_ns(rig.now_ns), {-300 * rig.sample.p_DH});
        }
        const auto now = rig.twin.last_command().torque_cnt;
        int change = 0;
        for (std::size_t i = 0; i < 3; ++i) change = std::max(change, std::abs(now[i] - before[i]));
        if (sampled != 0 && change > 20) {
          worst_s = std::max(worst_s, static_cast<double>(rig.twin.exchange_ns() - sampled) * 1e-9);
          break;
        }
      }
    }
  }
  std::printf("falcon: sample to force at most %.2f ms\n", worst_s * 1e3);
  EXPECT_GT(worst_s, 1e-3);
  EXPECT_LE(worst_s, FalconConfig{}.delay_s);
}

TEST(FalconDevice, DelayCountsInTheStiffnessLimit) {
  Rig rig;
  const auto p = rig.device->properties();
  EXPECT_NEAR(p.stiffness_limit(1e-3), 0.8 * 2 / (0.0005 + 0.0025), 1e-9);  // 533 N/m
}

// ---- states

TEST(FalconDevice, ResetUntilTheHandHasShownTheMarks) {
  FalconTwinConfig c = ready_twin();
  c.homed = false;
  Rig rig(c);
  rig.device->request_enable();
  rig.ticks(20, {1, 0, 0});
  EXPECT_TRUE(rig.sensed);
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
  EXPECT_TRUE(rig.twin.last_command().red);
  EXPECT_TRUE(rig.twin.last_command().home);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  // Once out and in.
  rig.push({-0.6, 0, 0});
  rig.ticks(150);
  rig.push({0.9, 0, 0});
  rig.ticks(150);
  rig.push({-0.5, 0, 0});
  rig.ticks(200);
  EXPECT_EQ(rig.sample.state, DeviceState::kIdle);  // forces still want an act
  EXPECT_FALSE(rig.twin.last_command().home);
  EXPECT_TRUE(rig.twin.last_command().green);
  EXPECT_LT((rig.sample.p_DH - rig.twin.plant().true_position()).norm(), 2e-4);
  rig.enable();
  rig.ticks(4);
  EXPECT_TRUE(rig.twin.last_command().blue);
}

TEST(FalconDevice, MakeSafeAndBack) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  EXPECT_GT(rig.twin.motor_force_D().x(), 0.9);
  std::thread([&] { rig.device->make_safe(); }).join();
  rig.pass(3 * kMs);  // the owner hangs: the event thread alone sends zero
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.ticks(5, {1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  EXPECT_GT(rig.twin.motor_force_D().x(), 0.9);
}

TEST(FalconDevice, StalledOwnerMeansZeroWithinTwentyMilliseconds) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {1, 0, 0});
  int held = 0;
  for (; held < 100; ++held) {
    rig.pass(kMs);
    if (rig.twin.motor_force_D() == Vec3::Zero()) break;
  }
  EXPECT_LE(held, 22);
  EXPECT_GE(held, 18);
  EXPECT_GT(rig.device->counters().starved, 0U);
}

TEST(FalconDevice, OverSpeedBrakes) {
  Rig rig;
  rig.enable();
  rig.push({1.6, 0, 0});
  rig.ticks(8, {0.1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kVelocity);
  rig.ticks(4, {0.1, 0, 0});
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
}

TEST(FalconDevice, NotANumberIsRefused) {
  Rig rig;
  rig.enable();
  rig.ticks(5, {std::numeric_limits<double>::quiet_NaN(), 0, 0});
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  EXPECT_EQ(rig.device->counters().refused_commands, 5U);
}

// ---- the wire

TEST(FalconDevice, LostAnswersAreAskedForAgain) {
  Rig rig;
  rig.twin.faults().lose_answers = 1;
  rig.ticks(4);
  EXPECT_TRUE(rig.sample.repeated);
  EXPECT_GT(rig.device->counters().repeats, 0U);
  rig.ticks(10);
  EXPECT_FALSE(rig.sample.repeated);
  EXPECT_EQ(rig.device->counters().kicks, 1U);
  EXPECT_EQ(rig.device->counters().losses, 0U);
}

// Damaged, doubled, noisy answers in contact: no position that the hand was not at, no loss.
TEST(FalconDevice, DamagedAnswersNeverMoveTheHand) {
  const std::uint64_t seed = 522;
  rt::Random random(seed);
  FalconTwinConfig c = ready_twin();
  c.seed = seed;
  Rig rig(c);
  rig.enable();
  rig.push({0.05, 0.02, 0});
  int far = 0;
  for (int i = 0; i < 20000; ++i) {
    auto& faults = rig.twin.faults();
    switch (random.integer(0, 7)) {
      case 0:
        faults.damage_answers = 1;
        break;
      case 1:
        faults.noise_bytes = static_cast<std::uint32_t>(random.integer(1, 90));
        break;
      case 2:
        faults.double_answers = 1;
        break;
      case 3:
        faults.lose_answers = random.integer(0, 9) == 0 ? 1 : 0;
        break;
      case 4:
        faults.line_errors = 1;
        break;
      default:
        break;
    }
    if (i % 500 == 0) rig.push(Vec3(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), 0));
    rig.tick(-20 * rig.sample.p_DH);
    ASSERT_TRUE(rig.sensed);
    ASSERT_EQ(rig.sample.state, DeviceState::kForce) << "tick " << i << " seed " << seed;
    ASSERT_FALSE(rig.sample.button) << "tick " << i << " seed " << seed;
    // What may pass for a motion at twice the speed limit: 118 counts of one leg.
    const double off = (rig.sample.p_DH - rig.twin.plant().true_position()).norm();
    ASSERT_LT(off, 0.010) << "tick " << i << " seed " << seed;
    far += off > 0.001;
  }
  // 0.5 % of the frames carry a change that the format allows; beside it the hand moves on while an
  // answer is lost. 2 % of the ticks.
  EXPECT_LT(far, 400);
  const auto n = rig.device->counters();
  EXPECT_GT(n.damaged, 1000U);
  EXPECT_GT(n.leaps, 50U);
  EXPECT_GT(n.line_errors, 1000U);
  EXPECT_EQ(n.losses, 0U);
}

TEST(FalconDevice, ALastingSlipIsBelieved) {
  Rig rig;
  rig.twin.faults().slip_cnt = {0, 400, 0};
  rig.ticks(10);
  EXPECT_EQ(rig.device->counters().leaps, 3U);
  EXPECT_GT(rig.sample.p_DH.norm(), 0.003);
  EXPECT_FALSE(rig.sample.repeated);
}

TEST(FalconDevice, ImpossibleAnglesAreNoSample) {
  Rig rig;
  const Vec3 before = rig.sample.p_DH;
  rig.twin.faults().slip_cnt = {-3000, 2500, -3000};
  rig.ticks(20);
  EXPECT_GT(rig.device->counters().unsolved, 5U);
  EXPECT_TRUE(rig.sample.repeated);
  EXPECT_EQ(rig.sample.p_DH, before);
  rig.twin.faults().slip_cnt = {};
  rig.ticks(10);
  EXPECT_FALSE(rig.sample.repeated);
}

TEST(FalconDevice, SilenceIsALoss) {
  Rig rig;
  rig.enable();
  rig.held = true;
  rig.twin.faults().silent = true;
  rig.ticks(90);
  EXPECT_TRUE(rig.device->connected());
  rig.ticks(30);
  EXPECT_FALSE(rig.device->connected());
  EXPECT_FALSE(rig.sensed);
}

TEST(FalconDevice, UnpluggedInContactGoesLimpAndComesBack) {
  Rig rig;
  rig.enable();
  rig.twin.plant().set_external_force({1.5, 0, 0});
  const auto wall = [&] {
    const double depth = rig.sample.p_DH.x() - 0.002;
    return Vec3(depth > 0 ? -300 * depth : 0, 0, 0);
  };
  for (int i = 0; i < 1500; ++i) rig.tick(wall());
  ASSERT_NEAR(rig.twin.motor_force_D().x(), -1.5, 0.2);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.faults().unplugged = true;
  }
  for (int i = 0; i < 10; ++i) {
    rig.tick(wall());
    EXPECT_FALSE(rig.sensed);
  }
  EXPECT_EQ(rig.device->counters().losses, 1U);
  EXPECT_EQ(rig.device->force_off_cause(), ForceOffCause::kDisconnect);
  std::this_thread::sleep_for(30ms);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.plant().set_external_force(Vec3::Zero());
    rig.twin.faults().unplugged = false;  // the chip kept its power: firmware and marks are there
  }
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  ASSERT_TRUE(rig.wait_until([&] { return rig.device->counters().reopened > 0; }));
  EXPECT_EQ(rig.device->counters().reopened, 1U);
  rig.ticks(10, {-1, 0, 0});
  EXPECT_EQ(rig.sample.state, DeviceState::kBrake);
  EXPECT_EQ(rig.twin.motor_force_D(), Vec3::Zero());
  rig.enable();
  rig.ticks(5, {-1, 0, 0});
  EXPECT_NEAR(rig.twin.motor_force_D().x(), -1, 0.05);
}

// With the power gone the firmware is loaded again and the marks are looked for again.
TEST(FalconDevice, PowerCycleLoadsTheFirmwareAgain) {
  const FirmwareFile file;
  FalconTwinConfig c = ready_twin();
  c.firmware = file.bytes;
  FalconConfig d = quick_config();
  d.firmware = file.path;
  Rig rig(c, d);
  rig.enable();
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.faults().unplugged = true;
  }
  rig.ticks(5);
  {
    const std::lock_guard lock(rig.mutex);
    rig.twin.power_cycle();
    rig.twin.faults().unplugged = false;
  }
  ASSERT_TRUE(rig.wait_until([&] { return rig.sensed; }));
  EXPECT_TRUE(rig.twin.running());
  EXPECT_EQ(rig.sample.state, DeviceState::kReset);
}

// ---- start

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

TEST(FalconDevice, NothingInTheTickAllocatesOrLocks) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  Rig rig;
  rig.enable();
  rig.push({0.1, 0, 0});
  rt_guard::reset();
  for (int i = 0; i < 200; ++i) {
    rig.pass(kMs);
    const rt::Section section;
    (void)rig.device->sense(rt::time_from_ns(rig.now_ns), rig.sample);
    rig.device->act(rt::time_from_ns(rig.now_ns), {Vec3(1, 0, 0)});
  }
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace
