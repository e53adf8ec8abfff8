#include "tasks/edges/command_edges.hpp"

#include <memory>

#include "tasks/edges/link_edges.hpp"

namespace tasks {

namespace {

constexpr rt::Nanos kCommandReportPeriod = std::chrono::milliseconds{100};

drivers::CommandReport message_of(const drivers::CommandGate::Report& r) noexcept {
  using drivers::CommandFault;
  const auto count = [&r](CommandFault f) { return r.counts[static_cast<std::size_t>(f)]; };
  drivers::CommandReport m;
  m.replayed = count(CommandFault::kReplayed);
  m.reordered = count(CommandFault::kReordered);
  m.out_of_range = count(CommandFault::kOutOfRange);
  m.from_ahead = count(CommandFault::kFromAhead);
  m.late = count(CommandFault::kLate);
  m.newest = r.newest;
  return m;
}

}  // namespace

void receive_commands(EdgeCells<rt::Box::kRobot>& cells, drivers::CommandGate& gate,
                      drivers::LinkEndpoint& endpoint, TellRefused tell) {
  using drivers::CommandFault;
  const auto told = std::make_shared<std::uint64_t>(0);
  endpoint.on_renew([&gate, told] {
    gate.renew();
    *told = 0;  // the box that is there now may not know
  });
  endpoint.add_incoming(kEdge<EdgeId::kGoal>.row.wire.code,
                        [&, tell = std::move(tell)](std::span<const std::uint8_t> body, rt::Time) {
                          drivers::RobotGoal goal;
                          if (!drivers::decode(body, goal)) return false;
                          to_local(goal, endpoint);
                          const CommandFault fault = gate.judge(
                              goal, endpoint.arrived_seq(), endpoint.arrived(), endpoint.unsure());
                          if (fault != CommandFault::kNone) tell(gate.report().all(), fault);
                          if (fault != CommandFault::kNone && fault != CommandFault::kLate)
                            return false;
                          cells.begin_write<EdgeId::kGoal>() = goal;
                          cells.publish<EdgeId::kGoal>(endpoint.arrived(), endpoint.unsure());
                          return true;
                        });
  endpoint.add_outgoing(drivers::MessageId::kCommandReport, kCommandReportPeriod, false,
                        [&gate, told](std::span<std::uint8_t> out) -> std::size_t {
                          const std::uint64_t all = gate.report().all();
                          if (all == *told) return 0;
                          *told = all;
                          return drivers::encode(message_of(gate.report()), out);
                        });
}

void send_commands(EdgeCells<rt::Box::kOperator>& cells, drivers::LinkEndpoint& endpoint,
                   const std::function<bool()>& stopped) {
  constexpr Wire wire = kEdge<EdgeId::kGoal>.row.wire;
  const auto told = std::make_shared<bool>(false);  // of the stop that is asked for now
  endpoint.add_outgoing(
      wire.code, std::chrono::milliseconds{wire.period_ms}, wire.bulk,
      [&cells, stopped, told](std::span<std::uint8_t> out) -> std::size_t {
        const auto newest = cells.read_by_link<EdgeId::kGoal>();
        if (!newest) return 0;
        *told = stopped();
        if (!*told) return drivers::encode(*newest, out);
        // The robot's supervision reads operator_engaged, and leaves the engaged mode. robot_io
        // does not read this one where it has the goal of that number already.
        drivers::RobotGoal goal = *newest;
        goal.engaged = goal.operator_engaged = 0;
        return drivers::encode(goal, out);
      },
      [stopped, told] {
        const bool stop = stopped();
        if (!stop) *told = false;
        return stop && !*told;
      });
}

void receive_command_reports(drivers::LinkEndpoint& endpoint, TellRefused tell) {
  endpoint.add_incoming(drivers::MessageId::kCommandReport,
                        [tell = std::move(tell)](std::span<const std::uint8_t> body, rt::Time) {
                          drivers::CommandReport m;
                          if (!drivers::decode(body, m)) return false;
                          tell(m.replayed + m.reordered + m.out_of_range + m.from_ahead + m.late,
                               static_cast<drivers::CommandFault>(m.newest));
                          return true;
                        });
}

}  // namespace tasks
