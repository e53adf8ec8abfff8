// The built page on disk. Files are read once and again when they change; all who load one share
// its bytes. A path is opened segment by segment beneath the folder, and no link is followed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "rt/result.hpp"

namespace teletact {

class PageFiles {
 public:
  static constexpr std::size_t kMostFileBytes = std::size_t{16} << 20U,
                               kMostBytes = std::size_t{48} << 20U;
  using Content = std::shared_ptr<const std::string>;

  // Refused where there is no index.html.
  [[nodiscard]] static rt::Result<PageFiles> open(const std::string& folder);
  ~PageFiles();
  PageFiles(PageFiles&& other) noexcept;
  PageFiles& operator=(PageFiles&&) = delete;

  // Of page_path(); null: no such ordinary file, or one too many or too long.
  [[nodiscard]] Content get(const std::vector<std::string>& segments);

 private:
  explicit PageFiles(int folder) noexcept : folder_(folder) {}
  struct Known {
    std::int64_t changed_ns = 0;
    Content content;
  };
  int folder_ = -1;
  std::size_t bytes_ = 0;
  std::map<std::string, Known> known_;
};

}  // namespace teletact
