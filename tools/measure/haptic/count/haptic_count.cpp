// Ticks of a recorded haptic run, for callgrind to count, and for the guard against allocations and
// locks.
//
//   haptic_count RUN TICKS [EFFECT]
//
// EFFECT: none, friction, texture, bump_normal, viscosity, materials. Prints the ticks served, of
// them in contact, and what the guard counted inside of step(). Built twice: with the effects, and
// without them.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/measure/support/rt_guard.hpp"
#include "tools/touch/tick_rerun.hpp"

int main(int argc, char** argv) {
  const std::string effect = argc > 3 ? argv[3] : "none";
  const long ticks = argc > 2 ? std::atol(argv[2]) : 0;
  if (argc < 3 || argc > 4 || ticks < 1) {
    std::fprintf(stderr, "usage: haptic_count RUN TICKS [EFFECT]\n");
    return 2;
  }
  std::FILE* file = std::fopen(argv[1], "rbe");
  if (file == nullptr) {
    std::fprintf(stderr, "haptic_count: %s can not be opened\n", argv[1]);
    return 2;
  }
  auto reader = teletact::HapticRunReader::open(file, argv[1]);
  if (!reader) {
    std::fprintf(stderr, "haptic_count: %s\n", reader.error().c_str());
    return 2;
  }
  tasks::HapticConfig config = reader.value()->header().config;
  if (effect == "friction") {
    config.friction_static = 0.3;
    config.friction_dynamic = 0.24;
  } else if (effect == "texture" || effect == "bump_normal") {
    config.texture_amplitude_m = 0.0003;
    config.texture_period_m = 0.002;
    config.bump_normal = effect == "bump_normal";
  } else if (effect == "viscosity") {
    config.viscosity_N_s_per_m = 1;
  } else if (effect == "materials") {
    config.materials = true;
  } else if (effect != "none") {
    std::fprintf(stderr, "haptic_count: effect '%s'\n", effect.c_str());
    return 2;
  }
  rt::Startup startup;
  teletact::HapticRerun replay(startup.token(), *reader.value(), config);
  rt_guard::reset();
  long served = 0, contact = 0;
  while (served < ticks && replay.next()) {
    ++served;
    contact += replay.out().telemetry.in_contact ? 1 : 0;
  }
  std::fclose(file);
  std::printf(
      "%ld ticks %ld contact %llu allocations %llu locks %d guard\n", served, contact,
      static_cast<unsigned long long>(rt_guard::counts().allocations + rt_guard::counts().frees),
      static_cast<unsigned long long>(rt_guard::counts().locks + rt_guard::counts().waits),
      rt_guard::linked() ? 1 : 0);
  return served == ticks ? 0 : 1;
}
