// A slave with an object dictionary, for the CoE tests: an application of the virtual slave that is
// written from ETG.1000.6, 5.6, by the byte and without the driver's code.
#pragma once

#include <map>
#include <vector>

#include "drivers/ethercat/twin/esc.hpp"

namespace tests {

class CoeSlave final : public drivers::ethercat::EscApplication {
 public:
  std::map<std::uint32_t, std::vector<std::uint8_t>> objects;  // index << 8 | subindex
  int emergencies_before_reply = 0;
  std::vector<std::uint8_t> counters;  // of the requests that came

  bool on_mailbox(std::span<const std::uint8_t> q, std::span<std::uint8_t> a,
                  rt::Time) noexcept override {
    std::fill(a.begin(), a.end(), std::uint8_t{0});
    counters.push_back(q[5] >> 4);
    a[5] = 0x13;  // CoE, counter 1
    if ((q[5] & 15) != 3) {
      a[0] = 4;  // error reply: protocol not supported
      a[5] = 0x10;
      a[6] = 1;
      a[8] = 2;
      return true;
    }
    if (emergencies_before_reply > 0) {
      --emergencies_before_reply;
      a[0] = 10;
      a[7] = 0x10;  // service 1
      return true;
    }
    a[0] = 10;
    a[7] = 0x30;
    std::copy_n(q.begin() + 9, 3, a.begin() + 9);
    const std::uint32_t key = (q[9] | q[10] << 8U) << 8U | q[11];
    const auto at = objects.find(key);
    if (at == objects.end()) {
      a[8] = 0x80;
      a[14] = 0x02;
      a[15] = 0x06;  // 0x06020000
    } else if (q[8] == 0x40) {
      upload(at->second, a);
    } else {
      const std::size_t n = (q[8] & 2) != 0 ? 4 - (q[8] >> 2 & 3) : q[12] | q[13] << 8U;
      const auto from = q.begin() + ((q[8] & 2) != 0 ? 12 : 16);
      at->second.assign(from, from + static_cast<std::ptrdiff_t>(n));
      a[8] = 0x60;
    }
    return true;
  }

 private:
  static void upload(const std::vector<std::uint8_t>& v, std::span<std::uint8_t> a) {
    if (v.size() <= 4) {
      a[8] = static_cast<std::uint8_t>(0x43 | (4 - v.size()) << 2U);
      std::copy(v.begin(), v.end(), a.begin() + 12);
      return;
    }
    a[8] = 0x41;
    a[12] = static_cast<std::uint8_t>(v.size());
    a[13] = static_cast<std::uint8_t>(v.size() >> 8U);
    const std::size_t n = std::min(v.size(), a.size() - 16);
    a[0] = static_cast<std::uint8_t>(10 + n);
    std::copy_n(v.begin(), n, a.begin() + 16);
  }
};

}  // namespace tests
