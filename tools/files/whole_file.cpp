#include "tools/files/whole_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace teletact {

namespace {

// A new name is on the disk when its folder is. Some file systems know no fsync of a folder: there
// the name is as safe as they make it.
void sync_folder_of(const std::string& path) {
  const auto end = path.rfind('/');
  const std::string folder = end == std::string::npos ? "." : path.substr(0, end + 1);
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  static_cast<void>(fsync(fd));
  close(fd);
}

}  // namespace

void write_whole_file(const std::string& path, const std::string& content, OnDisk on_disk) {
  const std::string temporary = path + ".part" + std::to_string(getpid());
  const auto fail = [&](const char* what) {
    const std::string reason = std::strerror(errno);
    std::remove(temporary.c_str());
    throw std::runtime_error(path + ": " + what + ": " + reason);
  };
  const int fd = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) fail("can not be written");
  for (std::size_t done = 0; done < content.size();) {
    const ssize_t n = write(fd, content.data() + done, content.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      const int error = errno;
      close(fd);
      errno = error;
      fail("can not be written");
    }
    done += static_cast<std::size_t>(n);
  }
  if (on_disk == OnDisk::kWhenBack && fsync(fd) != 0) {
    const int error = errno;
    close(fd);
    errno = error;
    fail("can not be written");
  }
  if (close(fd) != 0) fail("can not be written");
  if (std::rename(temporary.c_str(), path.c_str()) != 0)
    fail("can not be renamed to its final name");
  if (on_disk == OnDisk::kWhenBack) sync_folder_of(path);
}

WholeFile::WholeFile(std::string path)
    : path_(std::move(path)), part_(path_ + ".part" + std::to_string(getpid())) {
  file_ = std::fopen(part_.c_str(), "wbe");
  if (file_ == nullptr) fail(std::strerror(errno));
}

WholeFile::~WholeFile() {
  if (file_ == nullptr) return;
  std::fclose(file_);
  std::remove(part_.c_str());
}

void WholeFile::fail(const std::string& reason) {
  std::remove(part_.c_str());
  throw std::runtime_error(path_ + ": can not be written: " + reason);
}

void WholeFile::finish() {
  const bool bad = std::fflush(file_) != 0 || std::ferror(file_) != 0;
  const bool closed = std::fclose(file_) == 0;
  file_ = nullptr;
  if (bad || !closed) fail("only a part could be written (disk full?)");
  if (std::rename(part_.c_str(), path_.c_str()) != 0) fail(std::strerror(errno));
}

}  // namespace teletact
