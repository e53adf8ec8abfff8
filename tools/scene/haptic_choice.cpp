#include "tools/scene/haptic_choice.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "drivers/omega/omega_twin.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/scene/haptic_kinds.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {
namespace {

std::unique_ptr<drivers::OmegaTwin> make_twin(rt::NonRealtime& nrt, const Scene& scene,
                                              drivers::HandScript& hand, rt::Time epoch) {
  const auto start = hand.target(rt::Nanos{0});
  auto twin =
      std::make_unique<drivers::OmegaTwin>(nrt, scene.device, hand.size() > 0 ? &hand : nullptr,
                                           scene.workspace().to_device(start.p_WT));
  twin->set_cpu_clock(&rt::thread_cpu_ns);
  twin->start_hand(epoch);
  twin->enable_force(epoch);
  return twin;
}

class TwinHere : public OpenedDevice {
 public:
  explicit TwinHere(std::unique_ptr<drivers::OmegaTwin> twin) : twin_(std::move(twin)) {}
  drivers::HapticDevice& device() noexcept override { return *twin_; }
  std::string description() const override { return "twin of an Omega.3"; }
  bool person_simulated() const noexcept override { return true; }
  std::function<std::int64_t()> twin_cpu() override {
    return [this] { return twin_->twin_cpu_ns(); };
  }
  std::vector<std::string> effects() const override { return twin_->effects(); }

 protected:
  std::unique_ptr<drivers::OmegaTwin> twin_;
};

// The twin's mechanics under the properties of the chosen device.
class StandIn final : public TwinHere, private drivers::HapticDevice {
 public:
  StandIn(std::unique_ptr<drivers::OmegaTwin> twin, const drivers::DeviceProperties& p)
      : TwinHere(std::move(twin)), properties_(p) {}
  drivers::HapticDevice& device() noexcept override { return *this; }

 private:
  drivers::DeviceProperties properties() const noexcept override { return properties_; }
  bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    return twin_->sense(now, out);
  }
  void act(rt::Time now, const drivers::ForceCommand& c) noexcept override { twin_->act(now, c); }
  void request_enable() noexcept override { twin_->request_enable(); }
  void make_safe() noexcept override { twin_->make_safe(); }
  drivers::DeviceProperties properties_;
};

}  // namespace

std::vector<std::string> haptic_kind_names() {
  std::vector<std::string> names{"twin"};
  for (const HapticKindRow& row : kHapticKinds) names.emplace_back(row.name);
  return names;
}

std::string haptic_kind_list() {
  std::string list;
  for (const std::string& name : haptic_kind_names()) list += (list.empty() ? "" : ", ") + name;
  return list;
}

HapticChoice::HapticChoice() {
  for (const HapticKindRow& row : kHapticKinds) kinds_.push_back(row.make());
}

void HapticChoice::describe(config::Section& s) {
  s.text("kind", kind, haptic_kind_names(), "which haptic device");
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    kinds_[i]->describe(s.section(kHapticKinds[i].name, kHapticKinds[i].doc));
  }
}

const HapticKind& HapticChoice::chosen() const {
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    if (kind == kHapticKinds[i].name) return *kinds_[i];
  }
  throw std::logic_error("device.kind = \"" + kind + "\" has no driver");
}

std::unique_ptr<OpenedDevice> open_haptic_device(rt::NonRealtime& nrt, const Scene& scene,
                                                 drivers::HandScript& hand, rt::Time epoch,
                                                 bool real) {
  const HapticChoice& choice = scene.choice;
  if (choice.in_process()) {
    return std::make_unique<TwinHere>(make_twin(nrt, scene, hand, epoch));
  }
  if (!real) {
    return std::make_unique<StandIn>(make_twin(nrt, scene, hand, epoch),
                                     choice.chosen().properties());
  }
  return choice.chosen().open(nrt, scene, hand, epoch);
}

void check_haptic_device(const Scene& scene) {
  if (scene.choice.in_process()) return;
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0)
    throw std::runtime_error(std::string("device: no pipe for the check: ") + std::strerror(errno));
  const pid_t child = ::fork();
  if (child < 0)
    throw std::runtime_error(std::string("device: no process for the check: ") +
                             std::strerror(errno));
  if (child == 0) {
    std::string why;
    try {
      rt::Startup startup;
      auto& nrt = startup.token();
      drivers::HandScript hand(nrt, scene.hand, scene.workspace());
      (void)open_haptic_device(nrt, scene, hand, rt::time_from_ns(rt::monotonic_ns()), true);
    } catch (const std::exception& e) {
      why = e.what();
    }
    (void)!::write(ends[1], why.data(), why.size());
    ::_exit(why.empty() ? 0 : 1);
  }
  ::close(ends[1]);
  std::string why;
  std::array<char, 512> part{};
  for (ssize_t n = 0; (n = ::read(ends[0], part.data(), part.size())) > 0;) {
    why.append(part.data(), static_cast<std::size_t>(n));
  }
  ::close(ends[0]);
  int status = 0;
  (void)::waitpid(child, &status, 0);
  if (!why.empty()) throw std::runtime_error(why);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw std::runtime_error("device.kind = \"" + scene.choice.kind +
                             "\": its driver ended by a signal while it was opened");
  }
}

}  // namespace teletact
