// Ring-down against the twin, whose mass, damping and friction are known.
#include "tools/touch/ring_down.hpp"

#include <gtest/gtest.h>

#include "drivers/omega/omega_twin.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace {

using teletact::IdentifyOptions;

TEST(Identify, FindsWhatTheTwinIsMadeOf) {
  constexpr std::uint64_t kSeed = 7;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  for (int i = 0; i < 5; ++i) {
    drivers::OmegaTwinConfig c;
    c.mass_kg = random.uniform(0.1, 0.5);
    c.damping_N_s_per_m = random.uniform(0.5, 4);
    c.coulomb_N = i == 0 ? 0 : random.uniform(0.02, 0.2);
    c.delay_s = i % 2 == 0 ? 0 : 0.0005;
    c.quantum_m = 1e-5;
    rt::Startup startup;
    drivers::OmegaTwin twin(startup.token(), c, nullptr);
    twin.enable_force(rt::time_from_ns(0));
    const auto r =
        teletact::identify_device(twin, IdentifyOptions{}, rt::time_from_ns(0), [](rt::Time) {});
    std::printf("m %.4f of %.4f kg, b %.3f of %.3f N s/m, c %.4f of %.4f N, residual %.1f um\n",
                r.mean.mass_kg, c.mass_kg, r.mean.damping_N_s_per_m, c.damping_N_s_per_m,
                r.mean.coulomb_N, c.coulomb_N, 1e6 * r.mean.residual_m);
    for (const auto& axis : r.axes) {
      EXPECT_NEAR(axis.mass_kg, c.mass_kg, 0.02 * c.mass_kg);
      EXPECT_NEAR(axis.damping_N_s_per_m, c.damping_N_s_per_m, 0.05 * c.damping_N_s_per_m + 0.02);
      EXPECT_NEAR(axis.coulomb_N, c.coulomb_N, 0.01);
      EXPECT_LT(axis.residual_m, 2e-5);
    }
    EXPECT_EQ(teletact::poor_fit(r), "");
  }
}

TEST(Identify, FindsTheDelayToo) {
  drivers::OmegaTwinConfig c;
  c.mass_kg = 0.2;
  c.damping_N_s_per_m = 2;
  c.coulomb_N = 0.05;
  c.delay_s = 0.001;
  rt::Startup startup;
  drivers::OmegaTwin twin(startup.token(), c, nullptr);
  twin.enable_force(rt::time_from_ns(0));
  IdentifyOptions options;
  options.fit_delay = true;
  options.seconds = 0.8;
  const auto r = teletact::identify_device(twin, options, rt::time_from_ns(0), [](rt::Time) {});
  std::printf("t_d %.3f of 1.000 ms, b %.3f of 2.000 N s/m\n", 1e3 * r.delay_s,
              r.mean.damping_N_s_per_m);
  EXPECT_NEAR(r.delay_s, 0.001, 0.0002);
  EXPECT_NEAR(r.mean.damping_N_s_per_m, 2, 0.1);
}

// So light and free that a tick of 1 ms is too coarse: damping 12 % off.
TEST(Identify, SaysWhereTheModelDoesNotHold) {
  teletact::IdentifyResult r;
  for (auto& axis : r.axes) axis.residual_m = 19e-6;
  EXPECT_EQ(teletact::poor_fit(r), "");
  r.axes[1].residual_m = 147e-6;
  EXPECT_EQ(teletact::poor_fit(r).find("residual 147 um along y, allowed up to 20: "), 0U);
  drivers::OmegaTwinConfig c;
  c.mass_kg = 0.1;
  c.damping_N_s_per_m = 0.3;
  rt::Startup startup;
  drivers::OmegaTwin twin(startup.token(), c, nullptr);
  twin.enable_force(rt::time_from_ns(0));
  r = teletact::identify_device(twin, {}, rt::time_from_ns(0), [](rt::Time) {});
  EXPECT_NE(teletact::poor_fit(r).find(" um along x"), std::string::npos) << teletact::poor_fit(r);
}

// Like a device over USB: nothing comes in the first `silent` reads.
class LateDevice final : public drivers::HapticDevice {
 public:
  LateDevice(drivers::OmegaTwin& twin, int silent) : twin_(twin), silent_(silent) {}
  drivers::DeviceProperties properties() const noexcept override { return twin_.properties(); }
  bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    return twin_.sense(now, out) && silent_-- <= 0;
  }
  void act(rt::Time now, const drivers::ForceCommand& c) noexcept override { twin_.act(now, c); }
  void request_enable() noexcept override { twin_.request_enable(); }
  void make_safe() noexcept override { twin_.make_safe(); }

 private:
  drivers::OmegaTwin& twin_;
  int silent_;
};

TEST(Identify, WaitsForTheFirstSampleOfADeviceThatWasJustOpened) {
  drivers::OmegaTwinConfig c;
  c.mass_kg = 0.3;
  rt::Startup startup;
  drivers::OmegaTwin twin(startup.token(), c, nullptr);
  twin.enable_force(rt::time_from_ns(0));
  LateDevice late(twin, 5);
  IdentifyOptions options;
  options.seconds = 0.8;
  const auto r = teletact::identify_device(late, options, rt::time_from_ns(0), [](rt::Time) {});
  EXPECT_NEAR(r.mean.mass_kg, 0.3, 0.006);
  LateDevice never(twin, 1'000'000);
  EXPECT_THROW((void)teletact::identify_device(never, options, rt::time_from_ns(100'000'000'000),
                                               [](rt::Time) {}),
               std::runtime_error);
}

TEST(Identify, RefusesAHeldStylus) {
  drivers::OmegaTwinConfig c;
  c.hand_stiffness_N_per_m = 5000;
  c.hand_damping_N_s_per_m = 100;
  c.coulomb_N = 3;
  rt::Startup startup;
  drivers::HandScript hand(startup.token(), {}, {});
  drivers::OmegaTwin twin(startup.token(), c, &hand);
  twin.enable_force(rt::time_from_ns(0));
  IdentifyOptions options;
  options.seconds = 0.3;
  EXPECT_THROW((void)teletact::identify_device(twin, options, rt::time_from_ns(0), [](rt::Time) {}),
               std::runtime_error);
}

}  // namespace
