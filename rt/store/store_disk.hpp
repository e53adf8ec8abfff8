// Where a store's files lie. The real one is a folder; tests put a full or broken one in its place.
// Every verb says whether it was done, and none throws but read(), for want of memory.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace rt {

class StoreDisk {
 public:
  virtual ~StoreDisk() = default;
  // To the end of `name`, which is made when it is not there. False: nothing, or only a part of it,
  // was written.
  virtual bool append(const std::string& name, std::span<const std::uint8_t> bytes) noexcept = 0;
  // The whole file at once: after a kill at any moment it is the old one or the new one.
  virtual bool replace(const std::string& name, std::span<const std::uint8_t> bytes) noexcept = 0;
  // Empty: not there, or not readable.
  [[nodiscard]] virtual std::vector<std::uint8_t> read(const std::string& name) = 0;
  virtual bool remove(const std::string& name) noexcept = 0;
};

[[nodiscard]] std::vector<std::uint8_t> read_bytes(const std::string& path);

// Makes the folder. Throws std::runtime_error naming it.
[[nodiscard]] std::unique_ptr<StoreDisk> open_store_folder(const std::string& folder);

}  // namespace rt
