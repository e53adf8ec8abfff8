// EEPROM content of a virtual slave: written by the tables of ETG.1000.6, 5.4 and ETG.2010, and by
// nothing of the reader's (drivers/ethercat/sii.hpp).
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

namespace drivers::ethercat {

class SiiBuilder {
 public:
  SiiBuilder();
  SiiBuilder& identity(std::uint32_t vendor, std::uint32_t product, std::uint32_t revision,
                       std::uint32_t serial);
  SiiBuilder& alias(std::uint16_t value);
  // Words 0x18 to 0x1C.
  SiiBuilder& mailbox(std::uint16_t out_start, std::uint16_t out_length, std::uint16_t in_start,
                      std::uint16_t in_length, std::uint16_t protocols);
  SiiBuilder& strings(std::initializer_list<std::string> texts);
  // Category 30; name is the index of a string. `flags`: bit 1 forbids LRW.
  SiiBuilder& general(std::uint8_t group, std::uint8_t order, std::uint8_t name,
                      std::uint8_t flags);
  SiiBuilder& fmmus(std::initializer_list<std::uint8_t> uses);
  struct Manager {
    std::uint16_t start, length;
    std::uint8_t control, enable, type;
  };
  SiiBuilder& managers(std::initializer_list<Manager> list);
  // One PDO of `bits.size()` entries; transmit: the slave's inputs (category 50), else 51.
  SiiBuilder& pdo(bool transmit, std::uint16_t index, std::uint8_t manager,
                  std::initializer_list<std::uint8_t> bits);
  // With checksum and end mark, filled with 0xFF up to `bytes`.
  [[nodiscard]] std::vector<std::uint8_t> image(std::size_t bytes = 2048) const;

 private:
  void put(std::size_t word, unsigned value);
  void put_two(std::size_t word, std::uint32_t value);
  void category(unsigned type, std::vector<std::uint8_t> data);
  std::vector<std::uint8_t> head_, categories_;
};

}  // namespace drivers::ethercat
