#include "tools/box/box_status.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

namespace teletact {

namespace {

constexpr std::size_t kMostBytes = 65536;  // of an answer
constexpr int kAnswersAtOnce = 4;
constexpr int kPatience_ms = 2000;

bool fits(const std::string& path, sockaddr_un& a) {
  a = {};
  a.sun_family = AF_UNIX;
  if (path.size() >= sizeof a.sun_path) return false;
  std::memcpy(a.sun_path, path.data(), path.size());
  return true;
}

bool same_user(int fd) {
  ucred peer{};
  socklen_t size = sizeof peer;
  return ::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && peer.uid == ::geteuid();
}

int connect_to(const sockaddr_un& a) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return -1;
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a) == 0) return fd;
  const int why = errno;
  ::close(fd);
  errno = why;
  return -1;
}

rt::Error status_error(const std::string& path, const std::string& what) {
  return rt::Error{"status socket " + path + ": " + what};
}

}  // namespace

std::string status_json(const BoxStatus& s) {
  const nlohmann::ordered_json j{{"box", s.box},
                                 {"version", s.version},
                                 {"pid", s.pid},
                                 {"up_s", s.up_s},
                                 {"mode", s.mode},
                                 {"cause", s.cause},
                                 {"link", s.link},
                                 {"link_fault", s.link_fault},
                                 {"connections", s.connections},
                                 {"peer", s.peer},
                                 {"turned_away", s.turned_away},
                                 {"turned_away_newest", s.turned_away_newest},
                                 {"link_note", s.link_note},
                                 {"certificate_until", s.certificate_until},
                                 {"heard_ago_ms", s.heard_ago_ms},
                                 {"round_trip_ms", s.round_trip_ms},
                                 {"congestion", s.congestion},
                                 {"picture_age_ms", s.picture_age_ms},
                                 {"pictures_per_s", s.pictures_per_s},
                                 {"rate_Mbit_per_s", s.rate_Mbit_per_s},
                                 {"pictures", s.pictures},
                                 {"commands_refused", s.commands_refused},
                                 {"commands_refused_reason", s.commands_refused_reason},
                                 {"real_time", s.real_time},
                                 {"store_MiB", s.store_MiB},
                                 {"store_cap_MiB", s.store_cap_MiB},
                                 {"disk_free_MiB", s.disk_free_MiB},
                                 {"report", s.report}};
  return j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

rt::Result<std::string> status_text(const std::string& json) {
  const auto j = nlohmann::ordered_json::parse(json, nullptr, false);
  if (j.is_discarded() || !j.is_object()) return rt::Error{"the answer is no status of a box"};
  std::string text;
  for (const auto& [key, value] : j.items()) {
    if (value.is_structured()) return rt::Error{"the answer is no status of a box"};
    std::string name = key;
    name.resize(std::max<std::size_t>(name.size() + 1, 26), ' ');
    text += name + (value.is_string() ? value.get<std::string>() : value.dump()) + "\n";
  }
  return text;
}

rt::Result<std::string> status_socket(const std::string& box) {
  const char* dir = std::getenv("XDG_RUNTIME_DIR");
  if (dir == nullptr || dir[0] != '/')
    return rt::Error{
        "XDG_RUNTIME_DIR is not set to an absolute path: there is no place for a status socket of "
        "this user"};
  return std::string(dir) + "/teletact/" + box + ".sock";
}

rt::Result<StatusServer> StatusServer::open(const std::string& path) {
  sockaddr_un a;
  if (!fits(path, a)) return status_error(path, "the path is too long");
  const std::string folder = path.substr(0, path.rfind('/'));
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    return status_error(path, std::string("cannot make its folder: ") + std::strerror(errno));
  struct stat info {};
  if (::lstat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode) || info.st_uid != ::geteuid() ||
      (info.st_mode & 077U) != 0)
    return status_error(path, "its folder must be this user's own, with mode 0700");
  if (const int other = connect_to(a); other >= 0) {
    ::close(other);
    return status_error(path, "another box of this user answers there");
  }
  ::unlink(path.c_str());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  // The file gets the socket's mode: no instant at which it is wider.
  if (fd < 0 || ::fchmod(fd, 0600) != 0 ||
      ::bind(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a) != 0 || ::listen(fd, 8) != 0) {
    const std::string why = std::strerror(errno);
    if (fd >= 0) ::close(fd);
    return status_error(path, why);
  }
  return StatusServer(fd, path);
}

StatusServer::StatusServer(StatusServer&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), path_(std::move(other.path_)) {}

StatusServer::~StatusServer() {
  if (fd_ < 0) return;
  ::close(fd_);
  ::unlink(path_.c_str());
}

void StatusServer::serve(const std::function<std::string()>& json) const {
  for (int i = 0; i < kAnswersAtOnce; ++i) {
    const int fd = ::accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd < 0) return;
    if (same_user(fd)) {
      const std::string text = json();
      (void)!::send(fd, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    }
    ::close(fd);
  }
}

rt::Result<std::string> ask_status(const std::string& path) {
  sockaddr_un a;
  if (!fits(path, a)) return status_error(path, "the path is too long");
  const int fd = connect_to(a);
  if (fd < 0) {
    return status_error(path, errno == ENOENT || errno == ECONNREFUSED
                                  ? std::string("no box runs there")
                                  : std::string(std::strerror(errno)));
  }
  std::string text, problem;
  if (!same_user(fd)) problem = "it belongs to another user";
  while (problem.empty()) {
    pollfd p{fd, POLLIN, 0};
    if (::poll(&p, 1, kPatience_ms) <= 0) {
      problem = "no answer within 2 s";
      break;
    }
    char part[4096];
    const ssize_t n = ::read(fd, part, sizeof part);
    if (n <= 0) break;
    text.append(part, static_cast<std::size_t>(n));
    if (text.size() > kMostBytes) problem = "the answer is too long";
  }
  ::close(fd);
  if (problem.empty() && text.empty()) problem = "the box gave no answer";
  if (!problem.empty()) return status_error(path, problem);
  return text;
}

}  // namespace teletact
