#include "drivers/ethercat/card_problem.hpp"

#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace drivers::ethercat {

std::string card_problem(const std::string& interface, int error) {
  const std::string what = "interface " + interface + ": ";
  if (error == EPERM || error == EACCES)
    return what +
           "raw Ethernet frames need CAP_NET_RAW (setcap cap_net_raw+ep on the program, or run "
           "it with that capability)";
  if (error == ENODEV) return what + "there is none of this name";
  return what + std::strerror(error);
}

std::string card_down(const std::string& interface) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return {};
  ifreq request{};
  std::copy_n(interface.begin(), std::min(interface.size(), std::size_t{IFNAMSIZ - 1}),
              std::begin(request.ifr_name));
  const bool asked = ::ioctl(fd, SIOCGIFFLAGS, &request) == 0;
  ::close(fd);
  if (!asked || (static_cast<unsigned>(request.ifr_flags) & IFF_UP) != 0) return {};
  return "interface " + interface + ": is down: sudo ip link set " + interface + " up";
}

}  // namespace drivers::ethercat
