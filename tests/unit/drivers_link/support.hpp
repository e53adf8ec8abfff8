// Valid messages with random content, a slow second opinion on checksums, and two endpoints joined
// by a simulated cable.
#pragma once

#include <cstdint>
#include <cstring>
#include <deque>
#include <span>
#include <vector>

#include "drivers/link/endpoint.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/random.hpp"

namespace link_test {

using Bytes = std::vector<std::uint8_t>;

// Bit by bit, from the polynomial's definition; shares nothing with the table of the product.
inline std::uint32_t slow_crc32c(std::span<const std::uint8_t> data) {
  std::uint32_t c = 0xFFFFFFFFU;
  for (const std::uint8_t byte : data) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      const bool flip = ((c ^ (byte >> bit)) & 1U) != 0;
      c >>= 1U;
      if (flip) c ^= 0x82F63B78U;
    }
  }
  return ~c;
}

template <class T>
T field(std::span<const std::uint8_t> bytes, std::size_t at) {
  T v = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    v |= static_cast<T>(static_cast<T>(bytes[at + i]) << (8 * i));
  return v;
}

template <class T>
void set_field(Bytes& bytes, std::size_t at, T v) {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    bytes[at + i] = static_cast<std::uint8_t>(v >> (8 * i));
}

inline drivers::RobotState random_state(rt::Random& r) {
  drivers::RobotState m;
  m.seq = r();
  m.made = rt::time_from_ns(r.integer(0, 1'000'000'000'000'000));
  m.taken = rt::time_from_ns(r.integer(0, 1'000'000'000'000'000));
  for (double* v :
       {&m.x_m, &m.y_m, &m.yaw_rad, &m.vx, &m.vy, &m.wz, &m.cmd_vx, &m.cmd_vy, &m.cmd_wz}) {
    *v = r.uniform(-1e6, 1e6);
  }
  m.goal_seq = r();
  m.mode = static_cast<std::uint8_t>(r.integer(0, 4));
  m.moving = static_cast<std::uint8_t>(r.integer(0, 1));
  m.fault = static_cast<std::uint16_t>(r());
  return m;
}

inline drivers::RobotGoal random_goal(rt::Random& r) {
  drivers::RobotGoal m;
  m.seq = r();
  m.made = rt::time_from_ns(r.integer(0, 1'000'000'000'000'000));
  m.valid_until = rt::time_from_ns(r.integer(0, 1'000'000'000'000'000));
  for (double* v : {&m.x_m, &m.y_m, &m.yaw_rad, &m.vx, &m.vy, &m.wz, &m.speed_limit_m_per_s}) {
    *v = r.uniform(-1e6, 1e6);
  }
  m.engaged = static_cast<std::uint8_t>(r.integer(0, 1));
  m.operator_engaged = static_cast<std::uint8_t>(r.integer(0, 2));
  m.operator_clear = static_cast<std::uint8_t>(r.integer(0, 1));
  m.path_seq = r();
  return m;
}

inline Bytes whole(drivers::MessageId id, std::span<const std::uint8_t> body, std::uint64_t seq = 1,
                   std::int64_t stamp = 0) {
  drivers::Header h;
  h.id = id;
  h.seq = seq;
  h.stamp_ns = stamp;
  h.schema = id == drivers::MessageId::kHello ? drivers::schema_hash() : 0;
  Bytes out(drivers::kHeaderSize + body.size());
  (void)drivers::write_message(h, body, out);
  return out;
}

template <class Message>
Bytes body_of(const Message& m) {
  Bytes out(drivers::kMaxControlBody);
  out.resize(drivers::encode(m, out));
  return out;
}

// Operator and robot endpoint with clocks of their own and a cable with a delay each way.
struct Pair {
  rt::Startup startup;
  drivers::LinkEndpoint op{startup.token(), rt::Box::kOperator};
  drivers::LinkEndpoint robot{startup.token(), rt::Box::kRobot};
  rt::BoxTime op_clock, robot_clock;
  std::int64_t to_robot_ns = 1'000'000, to_op_ns = 1'000'000;
  std::int64_t host = 1'000'000'000;
  bool line_free = true;
  bool broken = false;

  struct Packet {
    std::int64_t due;
    Bytes bytes;
  };
  std::deque<Packet> for_robot, for_op;

  drivers::LinkEndpoint::Send to_robot() {
    return [this](std::span<const std::uint8_t> m) {
      for_robot.push_back({host + to_robot_ns, {m.begin(), m.end()}});
    };
  }
  drivers::LinkEndpoint::Send to_op() {
    return [this](std::span<const std::uint8_t> m) {
      for_op.push_back({host + to_op_ns, {m.begin(), m.end()}});
    };
  }
  void deliver(std::deque<Packet>& queue, drivers::LinkEndpoint& e, const rt::BoxTime& clock,
               const drivers::LinkEndpoint::Send& back) {
    while (!queue.empty() && queue.front().due <= host) {
      const Packet p = std::move(queue.front());
      queue.pop_front();
      if (!e.receive(p.bytes, clock.from_host(host), back)) broken = true;
    }
  }
  void run(std::int64_t length_ns, std::int64_t step_ns = 1'000'000) {
    for (const std::int64_t end = host + length_ns; host < end; host += step_ns) {
      deliver(for_robot, robot, robot_clock, to_op());
      deliver(for_op, op, op_clock, to_robot());
      op.poll(op_clock.from_host(host), line_free, to_robot());
      robot.poll(robot_clock.from_host(host), line_free, to_op());
    }
  }
};

}  // namespace link_test
