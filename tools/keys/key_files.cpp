#include "tools/keys/key_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace teletact {

rt::Result<bool> write_key_file(const std::string& path, const std::string& text) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd < 0) {
    return rt::Error{
        path + ": " +
        (errno == EEXIST ? "is there already and is not overwritten" : std::strerror(errno))};
  }
  const bool ok = ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                  ::fsync(fd) == 0;
  const bool closed = ::close(fd) == 0;
  if (ok && closed) return true;
  ::unlink(path.c_str());
  return rt::Error{path + ": can not be written"};
}

// Whole or not at all: a box may be reading it.
rt::Result<bool> replace_key_file(const std::string& path, const std::string& text) {
  const std::string part = path + ".new";
  ::unlink(part.c_str());
  if (auto ok = write_key_file(part, text); !ok) return ok;
  if (::rename(part.c_str(), path.c_str()) == 0) return true;
  const std::string why = std::strerror(errno);
  ::unlink(part.c_str());
  return rt::Error{path + ": " + why};
}

rt::Result<bool> make_key_folder(const std::string& path) {
  if (::mkdir(path.c_str(), 0700) == 0) return true;
  return rt::Error{
      path + ": " +
      (errno == EEXIST ? "is there already and is not overwritten" : std::strerror(errno))};
}

}  // namespace teletact
