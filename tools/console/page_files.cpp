#include "tools/console/page_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace teletact {

namespace {

int open_beneath(int folder, const std::vector<std::string>& segments) {
  int at = folder;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const int kind = i + 1 < segments.size() ? O_DIRECTORY : O_NONBLOCK;
    const int next = ::openat(at, segments[i].c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | kind);
    if (at != folder) ::close(at);
    if (next < 0) return -1;
    at = next;
  }
  return at == folder ? -1 : at;
}

bool read_all(int fd, std::string& text) {
  for (std::size_t at = 0; at < text.size();) {
    const ssize_t n = ::read(fd, text.data() + at, text.size() - at);
    if (n <= 0) return false;
    at += static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace

rt::Result<PageFiles> PageFiles::open(const std::string& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return rt::Error{"page folder '" + folder + "': " + std::strerror(errno)};
  PageFiles files(fd);
  if (!files.get({"index.html"}))
    return rt::Error{"page folder '" + folder + "': holds no index.html: the page is not built"};
  return files;
}

PageFiles::PageFiles(PageFiles&& other) noexcept
    : folder_(std::exchange(other.folder_, -1)),
      bytes_(other.bytes_),
      known_(std::move(other.known_)) {}

PageFiles::~PageFiles() {
  if (folder_ >= 0) ::close(folder_);
}

PageFiles::Content PageFiles::get(const std::vector<std::string>& segments) {
  const int fd = open_beneath(folder_, segments);
  if (fd < 0) return nullptr;
  struct stat info {};
  Content content;
  std::string name;
  for (const std::string& s : segments) name += "/" + s;
  if (::fstat(fd, &info) == 0 && S_ISREG(info.st_mode) &&
      info.st_size <= static_cast<off_t>(kMostFileBytes)) {
    const std::int64_t changed = info.st_mtim.tv_sec * 1'000'000'000 + info.st_mtim.tv_nsec;
    const auto size = static_cast<std::size_t>(info.st_size);
    Known& known = known_[name];
    if (known.content && known.changed_ns == changed && known.content->size() == size) {
      content = known.content;
    } else {
      bytes_ -= known.content ? known.content->size() : 0;
      known.content = nullptr;
      auto text = std::make_shared<std::string>(size, '\0');
      if (bytes_ + size <= kMostBytes && read_all(fd, *text)) {
        bytes_ += size;
        known = {changed, text};
        content = text;
      } else {
        known_.erase(name);
      }
    }
  }
  ::close(fd);
  return content;
}

}  // namespace teletact
