// Numbers of seven bits a byte, at the ends of each length and of all 64 bits.
#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <vector>

#include "rt/store/bytes.hpp"

namespace {

TEST(Packed, EachLengthAtBothEndsComesBack) {
  std::vector<std::uint64_t> values{0, std::numeric_limits<std::uint64_t>::max()};
  for (unsigned bits = 1; bits < 64; ++bits) {
    const std::uint64_t v = std::uint64_t{1} << bits;
    values.insert(values.end(), {v - 1, v, v + 1});
  }
  for (const std::uint64_t v : values) {
    rt::ByteWriter w;
    w.packed(v);
    rt::ByteReader r(w.bytes());
    EXPECT_EQ(r.packed(), v);
    EXPECT_TRUE(r.good()) << v;
    EXPECT_EQ(r.left(), 0U) << v;
  }
}

TEST(Packed, MoreThan64BitsIsAnError) {
  for (const int last : {2, 3, 0x7f, 0x81}) {
    std::vector<std::uint8_t> bytes(9, 0xff);
    bytes.push_back(static_cast<std::uint8_t>(last));
    rt::ByteReader r(bytes);
    EXPECT_EQ(r.packed(), 0U) << last;
    EXPECT_FALSE(r.good()) << last;
  }
}

}  // namespace
