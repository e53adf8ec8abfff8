// The safety lines on the guest's GPIO chip (gpio-sim), through the product's driver, safety chain,
// robot_io task and EtherCAT master to the wire; docs/gpio.md is what it is held against.
//
//   vm_gpio_stop --iface veth0 --chip gpiochip0 --sim FOLDER --live FILE --chain-pid PID
//                [--presses N]
//
// FOLDER, FILE: gpio-sim's own, of the chip: lines' other ends, and what takes the chip away.
#include <sys/wait.h>

#include <memory>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/gpio/chip_lines.hpp"
#include "drivers/gpio/safety_chain.hpp"
#include "tests/vm/guest/gpio_story.hpp"

namespace {

using namespace drivers;

gpio::GpioConfig config_of(const std::string& chip) {
  gpio::GpioConfig c;
  c.kind = "chip";
  c.chip = chip;
  c.estop_line = vm::kEstop;
  c.estop_line_2 = vm::kEstop2;
  c.enable_line = vm::kEnable;
  c.heartbeat_line = vm::kBeat;
  c.lamp_line = vm::kLamp;
  c.debounce_ms = vm::kDebounce_ms;
  c.disagree_ms = vm::kDisagree_ms;
  c.heartbeat_ms = vm::kBeat_ms;
  return c;
}

std::string refusal(rt::NonRealtime& nrt, const gpio::GpioConfig& c) {
  try {
    (void)gpio::open_chip_lines(nrt, c);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "opened";
}

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Another process holds the enable switch's line.
void taken_line(rt::NonRealtime& nrt, const gpio::GpioConfig& c) {
  int ready[2], done[2];
  if (::pipe(ready) != 0 || ::pipe(done) != 0) return;
  char byte = 0;
  const pid_t other = ::fork();
  if (other == 0) {
    gpio::GpioConfig one;
    one.chip = c.chip;
    one.estop_line = vm::kEnable;
    std::unique_ptr<gpio::GpioLines> held;
    try {
      held = gpio::open_chip_lines(nrt, one);
      byte = 1;
    } catch (const std::exception& e) {
      std::fprintf(stderr, "%s\n", e.what());
    }
    (void)!::write(ready[1], &byte, 1);
    ::close(done[1]);
    (void)!::read(done[0], &byte, 1);
    ::_exit(0);
  }
  ::close(done[0]);
  (void)!::read(ready[0], &byte, 1);
  const std::string said = refusal(nrt, c);
  vm::check("a line that another process has is refused by its name",
            byte == 1 && has(said, "/dev/" + c.chip + " line 2: ") && has(said, "holds the line"),
            said);
  ::close(done[1]);
  ::waitpid(other, nullptr, 0);
}

// Without the right to open the chip, and without the chip.
void no_right(rt::NonRealtime& nrt, const gpio::GpioConfig& c) {
  const pid_t other = ::fork();
  if (other == 0) {
    if (::setgid(65534) != 0 || ::setuid(65534) != 0) ::_exit(2);
    const std::string said = refusal(nrt, c);
    ::_exit(vm::check("a chip that this user may not open is named",
                      has(said, "/dev/" + c.chip) && has(said, "group of the device"), said)
                ? 0
                : 1);
  }
  ::waitpid(other, nullptr, 0);
  gpio::GpioConfig none = c;
  none.chip = "gpiochip77";
  const std::string said = refusal(nrt, none);
  vm::check("a chip that is not there is named", has(said, "/dev/gpiochip77: "), said);
}

}  // namespace

int main(int argc, char** argv) {
  const auto word = [&](const char* name, const char* otherwise) {
    return vm::option(argc, argv, name, std::string(otherwise));
  };
  rt::Startup startup;
  auto& nrt = startup.token();
  const std::string iface = word("iface", "veth0");
  const gpio::GpioConfig config = config_of(word("chip", "gpiochip0"));
  taken_line(nrt, config);
  no_right(nrt, config);
  auto port = ethercat::RawPort::open(nrt, iface);
  if (!port) return vm::check("port", false, port.error()) ? 0 : 1;
  ethercat::Master master(nrt, *port.value());
  if (!vm::bring_up(nrt, master)) return 1;
  std::unique_ptr<gpio::GpioLines> lines;
  try {
    lines = gpio::open_chip_lines(nrt, config);
  } catch (const std::exception& e) {
    return vm::check("lines", false, e.what()) ? 0 : 1;
  }
  gpio::SafetyChain chain(nrt, config, *lines);
  youbot_bus::EtherCatMotorBus bus(nrt, master);
  vm::RobotJob job(nrt, chain, bus);
  vm::WireTap tap(iface, master.mapping());

  const auto person = [&](std::int64_t epoch_ns) {
    vm::GpioStory story(job, tap, vm::SimLines(word("sim", "")), epoch_ns,
                        static_cast<int>(vm::option(argc, argv, "chain-pid", 0.0)),
                        word("live", ""));
    story.tell_all(static_cast<int>(vm::option(argc, argv, "presses", 50.0)));
  };
  const std::uint64_t missed = vm::run_robot(nrt, job, person, vm::GpioStory::timed);
  vm::figure("gpio.jobs", static_cast<double>(job.jobs()), "1");
  vm::check("no job missed", missed == 0, std::to_string(missed));
  return 0;
}
