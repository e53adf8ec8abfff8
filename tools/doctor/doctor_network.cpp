// What an EtherCAT bus needs of the box: the right to raw frames, a network card that reports each
// frame at once, and interrupt threads that come before the tasks that wait for them. A box
// without such a bus is fine: only a scene that names one needs them (docs/robot.md).
#include "tools/doctor/doctor_network.hpp"

#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <sstream>

namespace teletact::doctor {

using Level = DoctorCheck::Level;

namespace {

constexpr long long kArphrdEther = 1;  // linux/if_arp.h
// The first rank of a task (rt/sched/admission.hpp: 80 - rank); a thread of the kernel's has 50.
constexpr long kAboveTasks = 80;

// Cards in a wire: no bridge, no tunnel, no radio.
std::vector<std::string> cards(const Tree& tree) {
  const std::string folder = "/sys/class/net";
  std::vector<std::string> out;
  for (const auto& name : tree.names(folder)) {
    const std::string at = folder + "/" + name;
    if (tree.number(at + "/type").value_or(0) != kArphrdEther) continue;
    if (!tree.is_there(at + "/device") || tree.is_there(at + "/wireless")) continue;
    out.push_back(name);
  }
  return out;
}

// FIFO priority of a thread by /proc/PID/stat, whose name in brackets may hold anything; 0: none.
long priority_of(const Tree& tree, const std::string& pid) {
  const std::string stat = tree.text("/proc/" + pid + "/stat").value_or("");
  const auto bracket = stat.rfind(')');
  if (bracket == std::string::npos) return 0;
  std::istringstream fields(stat.substr(bracket + 1));
  std::string field;
  for (int i = 3; i <= 40; ++i) {  // proc(5): 3 is the state, 40 rt_priority
    if (!(fields >> field)) return 0;
  }
  return std::strtol(field.c_str(), nullptr, 10);
}

}  // namespace

std::optional<Moderation> moderation_of(const std::string& card) {
  if (card.size() >= IFNAMSIZ) return std::nullopt;
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return std::nullopt;
  ethtool_coalesce c{};
  c.cmd = ETHTOOL_GCOALESCE;
  ifreq request{};
  std::memcpy(request.ifr_name, card.data(), card.size());
  request.ifr_data = reinterpret_cast<char*>(&c);
  const bool told = ioctl(fd, SIOCETHTOOL, &request) == 0;
  close(fd);
  if (!told) return std::nullopt;
  return Moderation{c.rx_coalesce_usecs, c.tx_coalesce_usecs, c.use_adaptive_rx_coalesce != 0};
}

DoctorCheck raw_frames(const Tree& tree) {
  DoctorCheck c{"raw_frames",
                "raw frames",
                Level::kFine,
                "",
                "an EtherCAT bus (robot.bus.kind = \"ethercat\") is spoken to in raw frames, which "
                "need CAP_NET_RAW and no other right of root",
                ""};
  const auto wired = cards(tree);
  if (limits_of(tree).cap_raw) {
    c.state = "allowed by CAP_NET_RAW";
  } else if (wired.empty()) {
    c.state = "not allowed; no wired network card that could need it";
  } else {
    c.level = Level::kAdvice;
    c.state = "not allowed for this program";
    c.todo =
        "only with an EtherCAT bus: start the robot's box by config/systemd (it has the "
        "capability), or as root: setcap cap_net_raw,cap_sys_nice,cap_ipc_lock+ep teletact";
  }
  return c;
}

DoctorCheck coalescing(const Tree& tree, const ModerationReader& read) {
  DoctorCheck c{"coalescing",
                "interrupts of network cards",
                Level::kFine,
                "",
                "a card that gathers frames before it interrupts holds each frame of an EtherCAT "
                "bus back, often by 50 us to 150 us a cycle",
                ""};
  for (const auto& card : cards(tree)) {
    const auto m = read ? read(card) : std::nullopt;
    c.state += (c.state.empty() ? "" : "; ") + one_line(card) + " ";
    if (!m) {
      c.state += "does not tell";
      continue;
    }
    c.state += "rx " + std::to_string(m->rx_us) + " us, tx " + std::to_string(m->tx_us) + " us" +
               (m->adaptive ? ", adaptive" : "");
    if (m->rx_us == 0 && m->tx_us == 0 && !m->adaptive) continue;
    c.level = Level::kAdvice;
    if (c.todo.empty())
      c.todo = "if the EtherCAT bus is there, as root: ethtool -C " + one_line(card) +
               " adaptive-rx off rx-usecs 0 tx-usecs 0 (package ethtool; again after each boot)";
  }
  if (c.state.empty()) c.state = "no wired network card";
  return c;
}

// A kernel with PREEMPT_RT, or booted with threadirqs, runs interrupts in threads of FIFO 50: below
// every task here.
DoctorCheck interrupt_threads(const Tree& tree) {
  DoctorCheck c{"irq_threads",
                "interrupt threads",
                Level::kFine,
                "",
                "a task that waits for a frame or an emergency stop gets it when the interrupt's "
                "thread has run: below the tasks it waits for them, and its time stamp is late",
                ""};
  std::vector<std::string> ours = cards(tree);
  ours.emplace_back("teletact");  // consumer of the GPIO lines (drivers/gpio)
  for (const auto& pid : tree.numbered("/proc", "")) {
    const std::string name = tree.text("/proc/" + pid + "/comm").value_or("");
    if (name.compare(0, 4, "irq/") != 0) continue;
    const auto dash = name.find('-');  // irq/35-enp3s0, cut off at 15 letters
    if (dash == std::string::npos || dash + 1 == name.size()) continue;
    const std::string of = name.substr(dash + 1);
    const bool wanted = std::any_of(ours.begin(), ours.end(), [&](const std::string& o) {
      return of.compare(0, o.size(), o) == 0 || o.compare(0, of.size(), of) == 0;
    });
    if (!wanted) continue;
    const long priority = priority_of(tree, pid);
    c.state += (c.state.empty() ? "" : "; ") + one_line(name) + " FIFO " + std::to_string(priority);
    if (priority >= kAboveTasks) continue;
    c.level = Level::kAdvice;
    c.todo += (c.todo.empty() ? "as root: " : " && ") + std::string("chrt -f -p 93 ") + pid;
  }
  if (c.state.empty()) c.state = "none of a network card or a GPIO line of ours";
  return c;
}

DoctorCheck congestion(const Tree& tree) {
  DoctorCheck c{"congestion",
                "congestion control",
                Level::kAdvice,
                "",
                "without BBR a few lost packets on a long road make pictures and commands late",
                ""};
  const auto file = tree.text("/proc/sys/net/ipv4/tcp_available_congestion_control");
  const std::string names = one_line(file.value_or(""));
  std::istringstream words(names);
  for (std::string name; words >> name;) {
    if (name != "bbr") continue;
    c.level = Level::kFine;
    c.state = "BBR is there";
    return c;
  }
  c.state = names.empty() ? "the kernel does not tell" : names + ", no BBR";
  c.todo =
      "load it: modprobe tcp_bbr, and at each start by config/systemd/teletact.modules.conf "
      "in /etc/modules-load.d (a box without rights can not load it)";
  return c;
}

}  // namespace teletact::doctor
