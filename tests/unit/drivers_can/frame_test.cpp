// TMCL on CAN as bytes, the kernel's frames and error frames. The vectors are written out by hand
// from the manuals' tables.
#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <linux/errqueue.h>

#include <cerrno>
#include <cstring>

#include "drivers/can/socket_frames.hpp"
#include "drivers/tmcl/tmcl_can.hpp"
#include "rt/random.hpp"

namespace {

using drivers::can::BusState;
using drivers::can::BusWatch;
using drivers::can::CanFrame;
using drivers::can::FrameKind;
using drivers::can::PortState;
namespace tmcl = drivers::tmcl;

using Bytes7 = std::array<std::uint8_t, 7>;
using Bytes8 = std::array<std::uint8_t, 8>;

TEST(TmclCan, BytesOfTheManual) {
  // ROR 0, 350 (reference manual, "Rotate right": value 0x0000015E).
  EXPECT_EQ(tmcl::to_can(tmcl::Request{9, 1, 0, 0, 350}), (Bytes7{1, 0, 0, 0, 0, 0x01, 0x5E}));
  // SAP 2, motor 0, -1000 rpm.
  EXPECT_EQ(tmcl::to_can(tmcl::Request{1, 5, 2, 0, -1000}),
            (Bytes7{5, 2, 0, 0xFF, 0xFF, 0xFC, 0x18}));
  // GAP 1 of motor 0, and its reply of module 1: 711 (GAP's example).
  EXPECT_EQ(tmcl::to_can(tmcl::Request{1, 6, 1, 0, 0}), (Bytes7{6, 1, 0, 0, 0, 0, 0}));
  tmcl::Reply r;
  ASSERT_TRUE(tmcl::from_can(Bytes7{1, 100, 6, 0, 0, 0x02, 0xC7}, r));
  EXPECT_EQ(r, (tmcl::Reply{0, 1, 100, 6, 711}));
  EXPECT_EQ(tmcl::to_can(r), (Bytes7{1, 100, 6, 0, 0, 0x02, 0xC7}));
  tmcl::Request q;
  ASSERT_TRUE(tmcl::from_can(Bytes7{5, 2, 3, 0x80, 0, 0, 0}, q));
  EXPECT_EQ(q, (tmcl::Request{0, 5, 2, 3, INT32_MIN}));
}

TEST(TmclCan, OnlySevenBytesAreAMessage) {
  const std::array<std::uint8_t, 8> bytes{};
  for (std::size_t n = 0; n <= 8; ++n) {
    tmcl::Reply r{7, 7, 7, 7, 7};
    EXPECT_EQ(tmcl::from_can(std::span(bytes).first(n), r), n == 7);
    if (n != 7) {
      EXPECT_EQ(r, (tmcl::Reply{7, 7, 7, 7, 7}));
    }
  }
}

TEST(TmclCan, RatesOfParameter69) {
  EXPECT_EQ(tmcl::can_rate_kbit_per_s(1), 10);
  EXPECT_EQ(tmcl::can_rate_kbit_per_s(6), 250);
  EXPECT_EQ(tmcl::can_rate_kbit_per_s(8), 1000);
  for (const int bad : {INT32_MIN, -1, 0, 9, INT32_MAX}) EXPECT_EQ(tmcl::can_rate_kbit_per_s(bad), 0);
}

TEST(CanFrame, ToTheKernelAndBack) {
  rt::Random random(5);
  for (int i = 0; i < 10000; ++i) {
    CanFrame f;
    f.extended = random.uniform() < 0.5;
    f.remote = random.uniform() < 0.2;
    f.id = static_cast<std::uint32_t>(random.integer(0, f.extended ? 0x1FFFFFFF : 0x7FF));
    f.length = static_cast<std::uint8_t>(random.integer(0, 8));
    for (int k = 0; k < f.length; ++k)
      f.data[static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(random.integer(0, 255));
    const can_frame k = drivers::can::to_kernel(f);
    EXPECT_EQ((k.can_id & CAN_EFF_FLAG) != 0, f.extended);
    EXPECT_EQ((k.can_id & CAN_RTR_FLAG) != 0, f.remote);
    EXPECT_EQ(k.can_dlc, f.length);
    CanFrame back;
    ASSERT_EQ(drivers::can::from_kernel(k, sizeof k, back), FrameKind::kData);
    EXPECT_EQ(back, f);
  }
}

TEST(CanFrame, WhatIsNoClassicFrame) {
  can_frame k{};
  CanFrame out;
  for (std::size_t n : {0U, 1U, 15U, 17U, 72U})
    EXPECT_EQ(drivers::can::from_kernel(k, n, out), FrameKind::kOther) << n;
  for (const int dlc : {9, 15, 64, 255}) {
    k.can_dlc = static_cast<std::uint8_t>(dlc);
    EXPECT_EQ(drivers::can::from_kernel(k, sizeof k, out), FrameKind::kOther) << dlc;
  }
  k.can_dlc = 8;
  k.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF;
  EXPECT_EQ(drivers::can::from_kernel(k, sizeof k, out), FrameKind::kError);
}

// By the names of the kernel's header, each alone.
TEST(CanErrors, EachClassOfTheKernel) {
  const auto read = [](std::uint32_t id, std::uint8_t control) {
    return drivers::can::read_error(id, Bytes8{0, control, 0, 0, 0, 0, 17, 130});
  };
  EXPECT_EQ(read(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING).state, BusState::kWarning);
  EXPECT_EQ(read(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_WARNING).state, BusState::kWarning);
  EXPECT_EQ(read(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE).state, BusState::kPassive);
  EXPECT_EQ(read(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE).state, BusState::kPassive);
  EXPECT_EQ(read(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE).state, BusState::kActive);
  EXPECT_TRUE(read(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE).state_known);
  EXPECT_FALSE(read(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW).state_known);
  EXPECT_TRUE(read(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW).overflow);
  EXPECT_TRUE(read(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_OVERFLOW).overflow);
  EXPECT_EQ(read(CAN_ERR_BUSOFF, 0).state, BusState::kBusOff);
  EXPECT_TRUE(read(CAN_ERR_RESTARTED, 0).restarted);
  EXPECT_EQ(read(CAN_ERR_RESTARTED, 0).state, BusState::kActive);
  EXPECT_TRUE(read(CAN_ERR_ACK, 0).no_ack);
  EXPECT_TRUE(read(CAN_ERR_PROT, 0).protocol);
  EXPECT_TRUE(read(CAN_ERR_BUSERROR, 0).protocol);
  EXPECT_FALSE(read(CAN_ERR_LOSTARB, 0xFF).state_known) << "data[1] is of CAN_ERR_CRTL alone";
  EXPECT_EQ(read(CAN_ERR_ACK, 0).tx_errors, -1);
  EXPECT_EQ(read(0x200, 0).tx_errors, 17);
  EXPECT_EQ(read(0x200, 0).rx_errors, 130);
}

TEST(BusWatch, OffAndBack) {
  BusWatch w;
  w.take_error(CAN_ERR_CRTL, Bytes8{0, CAN_ERR_CRTL_TX_PASSIVE});
  EXPECT_EQ(w.bus, BusState::kPassive);
  EXPECT_EQ(w.port, PortState::kUp);
  w.take_error(CAN_ERR_BUSOFF, Bytes8{});
  w.take_error(CAN_ERR_BUSOFF, Bytes8{});
  EXPECT_EQ(w.port, PortState::kBusOff);
  EXPECT_EQ(w.counters.bus_offs, 1U) << "once, however often it is said";
  w.take_room();
  w.take_errno(ENOBUFS);
  EXPECT_EQ(w.port, PortState::kBusOff) << "the queue says nothing of the controller";
  w.take_error(CAN_ERR_RESTARTED, Bytes8{});
  EXPECT_EQ(w.port, PortState::kUp);
  EXPECT_EQ(w.counters.restarts, 1U);
}

TEST(BusWatch, WhatErrnoSays) {
  for (const auto& [error, state] :
       {std::pair{ENOBUFS, PortState::kQueueFull}, {EAGAIN, PortState::kQueueFull},
        {ENETDOWN, PortState::kDown}, {ENODEV, PortState::kGone}, {ENXIO, PortState::kGone}}) {
    BusWatch w;
    w.take_errno(error);
    EXPECT_EQ(w.port, state) << error;
    w.take_life();
    EXPECT_EQ(w.port, PortState::kUp) << "a frame passed";
  }
}

// Control data as the kernel writes it, and cut short anywhere.
TEST(SocketFrames, TimeAndDropsOfTheControlData) {
  alignas(cmsghdr) std::array<char, 256> buffer{};
  msghdr head{};
  head.msg_control = buffer.data();
  head.msg_controllen = CMSG_SPACE(sizeof(scm_timestamping)) + CMSG_SPACE(sizeof(std::uint32_t));
  cmsghdr* c = CMSG_FIRSTHDR(&head);
  c->cmsg_level = SOL_SOCKET;
  c->cmsg_type = SO_TIMESTAMPING;
  c->cmsg_len = CMSG_LEN(sizeof(scm_timestamping));
  scm_timestamping t{};
  t.ts[0].tv_sec = 1'700'000'000;
  t.ts[0].tv_nsec = 5;
  std::memcpy(CMSG_DATA(c), &t, sizeof t);
  c = CMSG_NXTHDR(&head, c);
  ASSERT_NE(c, nullptr);
  c->cmsg_level = SOL_SOCKET;
  c->cmsg_type = SO_RXQ_OVFL;
  c->cmsg_len = CMSG_LEN(sizeof(std::uint32_t));
  const std::uint32_t drops = 3;
  std::memcpy(CMSG_DATA(c), &drops, sizeof drops);
  std::int64_t ns = 0;
  std::uint32_t dropped = 0;
  EXPECT_TRUE(drivers::can::read_control(head, ns, dropped));
  EXPECT_EQ(ns, 1'700'000'000'000'000'005);
  EXPECT_EQ(dropped, 3U);
  const std::size_t whole = head.msg_controllen;
  for (std::size_t n = 0; n < whole; ++n) {
    head.msg_controllen = n;
    (void)drivers::can::read_control(head, ns, dropped);  // reads nothing beyond
  }
  head.msg_controllen = 0;
  EXPECT_FALSE(drivers::can::read_control(head, ns, dropped));
}

}  // namespace
