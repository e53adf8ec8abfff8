// Small messages that go together (LinkEndpoint::gather): few packets, and nothing that is urgent
// waits for one.
#include <gtest/gtest.h>

#include <set>

#include "tests/unit/drivers_link/support.hpp"

namespace {

using namespace link_test;
using drivers::MessageId;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kTurn_ms = 20;

// One end that says what the road's ends say: something each 10 ms, something each 50 ms, now and
// then something urgent, and pictures. Its peer is known; time is in steps of a millisecond.
struct OneEnd {
  rt::Startup startup;
  drivers::LinkEndpoint end{startup.token(), rt::Box::kOperator};
  std::int64_t ms = 0, stop_from = -1;
  bool stop_told = false;
  std::set<std::int64_t> small_at, stop_at, picture_at;
  std::uint64_t small = 0;

  explicit OneEnd(std::int64_t gather_ms, bool quiet = false) {
    end.gather(rt::Nanos{gather_ms * kMs});
    const auto body = [this](auto out) {
      return encode(drivers::FrameReport{static_cast<std::uint64_t>(ms), 0}, out);
    };
    if (!quiet) {
      end.add_outgoing(MessageId::kFrameReport, rt::Nanos{10 * kMs}, false, body);
      end.add_outgoing(MessageId::kCommandReport, rt::Nanos{50 * kMs}, false, body);
      end.add_outgoing(MessageId::kFrame, rt::Nanos{33 * kMs}, true, body);
    }
    end.add_outgoing(
        MessageId::kRobotGoal, rt::Nanos{500'000 * kMs}, false,
        [this](auto out) -> std::size_t {
          if (!stop_now()) return 0;
          stop_told = true;
          return encode(drivers::FrameReport{1, 0}, out);
        },
        [this] { return stop_now(); });
    drivers::Header hello;
    hello.id = MessageId::kHello;
    hello.schema = drivers::schema_hash();
    Bytes bytes(drivers::kHeaderSize);
    bytes.resize(drivers::write_message(hello, {}, bytes));
    EXPECT_TRUE(end.receive(bytes, now(), [](auto) {}));
  }
  [[nodiscard]] rt::Time now() const { return rt::time_from_ns(1'000 * kMs + ms * kMs); }
  [[nodiscard]] bool stop_now() const { return !stop_told && stop_from >= 0 && ms >= stop_from; }
  void run(std::int64_t for_ms) {
    for (std::int64_t n = 0; n < for_ms; ++n, ++ms) {
      end.poll(now(), true, [this](std::span<const std::uint8_t> m) {
        drivers::Header h;
        ASSERT_EQ(drivers::read_header(m, h), drivers::WireStatus::kOk);
        if (h.id == MessageId::kFrame) {
          picture_at.insert(ms);
          return;
        }
        if (h.id == MessageId::kHello) return;
        if (h.id == MessageId::kRobotGoal) stop_at.insert(ms);
        ++small;
        small_at.insert(ms);
      });
    }
  }
};

TEST(Gather, SmallMessagesGoTogetherOnceInATurn) {
  OneEnd e(kTurn_ms);
  e.run(2'000);
  EXPECT_LE(e.small_at.size(), 101U) << "packets, of 2000 / 20";
  EXPECT_GE(e.small_at.size(), 99U);
  EXPECT_GE(e.small, 2'000U / 20 + 2'000U / 50 - 2)
      << "and each message at its rate, or the turn's";
  std::int64_t last = -1;
  for (const std::int64_t at : e.small_at) {
    EXPECT_TRUE(last < 0 || at - last <= kTurn_ms + 1) << at;
    last = at;
  }
  EXPECT_GE(e.picture_at.size(), 59U) << "pictures wait for no turn";
  OneEnd each(0);
  each.run(2'000);
  EXPECT_GE(each.small_at.size(), 199U);
}

TEST(Gather, WhatIsUrgentGoesAtOnce) {
  for (std::int64_t at = 500; at < 520; ++at) {
    OneEnd e(kTurn_ms);
    e.stop_from = at;
    e.run(600);
    ASSERT_EQ(e.stop_at.size(), 1U);
    EXPECT_EQ(*e.stop_at.begin(), at);
  }
}

// Silences are told from 90 ms on; the other end must hear something well before.
TEST(Gather, AnEndWithNothingToSayIsStillHeard) {
  OneEnd e(kTurn_ms, true);
  e.run(2'000);
  std::int64_t last = 0;
  for (const std::int64_t at : e.small_at) {
    EXPECT_LE(at - last, kTurn_ms + 1) << at;
    last = at;
  }
  EXPECT_GE(e.small, 99U);
}

TEST(Gather, ARenewedEndBeginsAtOnce) {
  OneEnd e(kTurn_ms);
  e.run(507);
  e.end.renew();
  e.small_at.clear();
  drivers::Header hello;
  hello.id = MessageId::kHello;
  hello.schema = drivers::schema_hash();
  Bytes bytes(drivers::kHeaderSize);
  bytes.resize(drivers::write_message(hello, {}, bytes));
  ASSERT_TRUE(e.end.receive(bytes, e.now(), [](auto) {}));
  e.run(1);
  EXPECT_EQ(e.small_at.size(), 1U);
}

}  // namespace
