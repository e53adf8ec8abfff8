#include "rt/store/store_disk.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <system_error>

namespace rt {

namespace {

bool write_all(int fd, std::span<const std::uint8_t> bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

class FolderDisk final : public StoreDisk {
 public:
  explicit FolderDisk(std::string folder) : folder_(std::move(folder)) {}
  ~FolderDisk() override { close_open(); }
  FolderDisk(const FolderDisk&) = delete;
  FolderDisk& operator=(const FolderDisk&) = delete;

  // The file that is appended to stays open: one at a time is.
  bool append(const std::string& name, std::span<const std::uint8_t> bytes) noexcept override {
    if (fd_ < 0 || name != open_) {
      close_open();
      fd_ = ::open(path(name).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
      if (fd_ < 0) return false;
      open_ = name;
    }
    return write_all(fd_, bytes);
  }
  bool replace(const std::string& name, std::span<const std::uint8_t> bytes) noexcept override {
    const std::string half = path(name + ".tmp");
    const int fd = ::open(half.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd < 0) return false;
    const bool written = write_all(fd, bytes);
    const bool closed = ::close(fd) == 0;
    if (written && closed && std::rename(half.c_str(), path(name).c_str()) == 0) return true;
    ::unlink(half.c_str());
    return false;
  }
  std::vector<std::uint8_t> read(const std::string& name) override {
    return read_bytes(path(name));
  }
  bool remove(const std::string& name) noexcept override {
    if (name == open_) close_open();
    return ::unlink(path(name).c_str()) == 0 || errno == ENOENT;
  }

 private:
  [[nodiscard]] std::string path(const std::string& name) const { return folder_ + "/" + name; }
  void close_open() noexcept {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
    open_.clear();
  }
  std::string folder_, open_;
  int fd_ = -1;
};

}  // namespace

std::vector<std::uint8_t> read_bytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::unique_ptr<StoreDisk> open_store_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder + ": can not be made: " + error.message());
  return std::make_unique<FolderDisk>(folder);
}

}  // namespace rt
