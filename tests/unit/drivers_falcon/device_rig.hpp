// The Falcon's driver on its twin at the wire, on a clock that the test moves.
#pragma once

#include <gtest/gtest.h>

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "drivers/falcon/falcon_device.hpp"
#include "drivers/falcon/falcon_twin.hpp"
#include "rt/random.hpp"

namespace tests {

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

inline constexpr std::int64_t kMs = 1'000'000;

inline FalconTwinConfig ready_twin() {
  FalconTwinConfig c;
  c.plant.coulomb_N = 0;
  c.plant.hand_stiffness_N_per_m = 0;
  c.plant.mass_kg = 0.2;
  c.plant.damping_N_s_per_m = 2;
  c.plant.workspace_radius_m = 0.06;
  c.loaded = c.homed = true;
  return c;
}

inline FalconConfig quick_config() {
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
  // The transport locks the twin for the driver's minder; the test's own thread is the event
  // thread.
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

inline std::string refusal(const FalconTwinConfig& t, const FalconConfig& d) {
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

}  // namespace tests
