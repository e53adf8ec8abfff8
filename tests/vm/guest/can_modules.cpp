#include "tests/vm/guest/can_modules.hpp"

#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "rt/clock/box_time.hpp"
#include "tests/vm/guest/say.hpp"

namespace vm {

namespace {

constexpr int kPriority = 90;
constexpr double kTicksPerTurn = 4000;
// Far apart, so that a reply of one module can not pass for that of another.
constexpr double kFirstTicks = 500'000;

}  // namespace

int open_raw(const std::string& iface) {
  const int raw = ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(::if_nametoindex(iface.c_str()));
  if (raw >= 0 && ::bind(raw, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0)
    return raw;
  std::perror(iface.c_str());
  return -1;
}

void put_error(int raw, std::uint32_t classes, std::uint8_t controller) {
  can_frame f{};
  f.can_id = CAN_ERR_FLAG | classes;
  f.can_dlc = 8;
  f.data[1] = controller;
  if (::write(raw, &f, sizeof f) != sizeof f) std::perror("error frame");
}

CanModules::CanModules(const std::string& iface) : raw_(open_raw(iface)) {
  const std::int64_t now = rt::monotonic_ns();
  for (int i = 0; i < kModules; ++i) {
    auto& m = modules_[static_cast<std::size_t>(i)];
    m.id = module_id(i);
    m.address = static_cast<std::uint8_t>(module_id(i));
    m.reply_id = kReplyId;
    motors_[static_cast<std::size_t>(i)].ticks = kFirstTicks * (1 + i);
    motors_[static_cast<std::size_t>(i)].at_ns = now;
  }
  thread_ = std::thread([this] { live(); });
}

CanModules::~CanModules() {
  ends_ = true;
  thread_.join();
  if (raw_ >= 0) ::close(raw_);
}

bool CanModules::any_turns() const {
  return std::any_of(motors_.begin(), motors_.end(), [](const Motor& m) { return m.turns(); });
}

std::uint64_t CanModules::speeds() const {
  std::uint64_t n = 0;
  for (const Motor& m : motors_) n += m.speeds.load();
  return n;
}

void CanModules::live() {
  become_real_time(kPriority);
  while (!ends_.load()) {
    pollfd ready{raw_, POLLIN, 0};
    (void)::poll(&ready, 1, due_.empty() ? 5 : 1);
    can_frame f{};
    while (::read(raw_, &f, sizeof f) == sizeof f) take(f, rt::monotonic_ns());
    send_due(rt::monotonic_ns());
  }
}

void CanModules::move(std::size_t i, std::int64_t now) {
  Motor& m = motors_[i];
  const auto& module = modules_[i];
  const double ticks = m.ticks_at(now);
  // First no motion, so that a reader in between sees a motor that stands where it was.
  m.ticks_per_ns = 0;
  m.ticks = ticks;
  m.at_ns = now;
  m.ticks_per_ns = module.turning ? module.target_rpm * kTicksPerTurn / 60e9 : 0;
}

void CanModules::take(const can_frame& f, std::int64_t now) {
  drivers::tmcl::Request q;
  const std::span<const std::uint8_t> bytes(f.data, f.can_dlc);
  if (faults.no_bus.load() || !drivers::tmcl::from_can(bytes, q)) return;
  for (std::size_t i = 0; i < modules_.size(); ++i) {
    auto& m = modules_[i];
    if (m.id != f.can_id || faults.silent.load() == static_cast<int>(i)) continue;
    move(i, now);
    m.position = static_cast<std::int32_t>(std::floor(motors_[i].ticks.load()));
    m.rpm = m.turning ? m.target_rpm : 0;
    drivers::tmcl::Reply reply;
    bool text = false;
    const bool turned = m.turning;
    if (!m.answer(q, reply, text) || text) continue;
    if (turned && !m.turning) motors_[i].stopped_ns = now;
    using drivers::tmcl::Command;
    if (q.command == static_cast<std::uint8_t>(Command::kSetAxisParameter)) ++motors_[i].speeds;
    move(i, now);
    if (faults.lose.load() > 0) {
      --faults.lose;
      continue;
    }
    can_frame out{};
    out.can_id = m.reply_id;
    const auto payload = drivers::tmcl::to_can(reply);
    out.can_dlc = static_cast<std::uint8_t>(payload.size());
    std::copy(payload.begin(), payload.end(), out.data);
    due_.push_back({now + faults.delay_ms.load() * 1'000'000LL, out});
  }
}

void CanModules::send_due(std::int64_t now) {
  while (!due_.empty() && due_.front().at_ns <= now) {
    if (::write(raw_, &due_.front().frame, sizeof(can_frame)) == sizeof(can_frame)) ++replies_;
    due_.pop_front();
  }
}

}  // namespace vm
