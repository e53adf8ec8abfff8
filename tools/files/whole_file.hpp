// A file appears whole or not at all: written beside its place, then renamed.
#pragma once

#include <cstdio>
#include <string>

namespace teletact {

// kWhenBack: the file and its name are on the disk, and not in the kernel's memory alone, when the
// call comes back. That can take a second.
enum class OnDisk : unsigned char { kSometime, kWhenBack };

// Throws std::runtime_error naming the file and the reason; then nothing is left behind.
void write_whole_file(const std::string& path, const std::string& content,
                      OnDisk on_disk = OnDisk::kSometime);

// The same, written piece by piece: it is there after finish(). Both throw as above.
class WholeFile {
 public:
  explicit WholeFile(std::string path);
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;
  [[nodiscard]] std::FILE* get() const { return file_; }
  void finish();

 private:
  [[noreturn]] void fail(const std::string& reason);
  std::string path_, part_;
  std::FILE* file_ = nullptr;
};

}  // namespace teletact
