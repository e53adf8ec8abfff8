// What the tasks of one box say for people: one log a task, written in commit, put into words by an
// ordinary thread (rt/audit/rt_log.hpp). Lines are events, not values: a quiet run is a short log.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "rt/audit/rt_log.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/graph/bus_log.hpp"

namespace tasks {

class TaskLogs {
 public:
  explicit TaskLogs(rt::NonRealtime& nrt)
      : mode(sites_.add<unsigned, unsigned, unsigned>(
            nrt, rt::LogLevel::kInfo,
            "mode {} -> {} (0 init, 1 hold, 2 engaged, 3 ramp down, 4 safe stop), cause {}")),
        contact(sites_.add<double, double, double, double>(
            nrt, rt::LogLevel::kInfo, "contact begins at ({:.3f}, {:.3f}, {:.3f}) m, {:.2f} N")),
        events_lost(sites_.add<std::uint64_t>(nrt, rt::LogLevel::kWarning,
                                              "touch event {} did not fit; the next one says so")),
        mark(sites_.add<unsigned>(nrt, rt::LogLevel::kInfo, "mark {} taken")),
        mark_dropped(sites_.add<std::uint64_t>(
            nrt, rt::LogLevel::kWarning, "open mark dropped at job {}: touch events were lost")),
        path(sites_.add<std::uint64_t, int, std::uint64_t>(
            nrt, rt::LogLevel::kInfo, "path {} made: {} points, for the mark of event {}")),
        given_up(sites_.add<std::uint64_t, unsigned>(nrt, rt::LogLevel::kWarning,
                                                     "goal given up at job {}, fault {}")),
        tracking_lost(
            sites_.add<std::uint64_t>(nrt, rt::LogLevel::kWarning, "tracking lost in job {}")),
        tracking_back(
            sites_.add<std::uint64_t>(nrt, rt::LogLevel::kInfo, "tracking recovered in job {}")),
        goal_refused(sites_.add<std::uint64_t>(nrt, rt::LogLevel::kWarning,
                                               "goal refused, not finite; {} so far")),
        goal_expired(
            sites_.add<std::uint64_t>(nrt, rt::LogLevel::kWarning, "goal expired; {} so far")),
        estop(sites_.add<double>(
            nrt, rt::LogLevel::kWarning,
            "emergency stop opened {:.0f} us before the job that turned the motors off")),
        level(sites_.add<unsigned, unsigned>(nrt, rt::LogLevel::kInfo, "level {} -> {}")),
        edit(sites_.add<std::uint64_t, unsigned, unsigned>(
            nrt, rt::LogLevel::kInfo,
            "edit {}: kind {} (0 clear, 1 disc, 2 box, 3 erase, 4 part of an object, 5 object, "
            "6 no object), id {}")),
        grasp(sites_.add<unsigned, double, double>(
            nrt, rt::LogLevel::kInfo,
            "grasp from {} (1 above, 2 the side), gripper {:.3f} m open, base at {:.2f} m")),
        no_grasp(sites_.add<unsigned>(
            nrt, rt::LogLevel::kWarning,
            "no grasp: {} (1 not an object, 2 too wide, 3 too thin, 4 out of reach)")),
        edit_refused(sites_.add<std::uint64_t, unsigned>(
            nrt, rt::LogLevel::kWarning, "edit {} refused, kind {}: out of range, or no room")),
        surface_left(sites_.add<double, double, double>(
            nrt, rt::LogLevel::kWarning,
            "the surface under the hand at ({:.3f}, {:.3f}, {:.3f}) m left: the hand is let go")),
        bus(nrt, sites_),
        limits(limit_sites(nrt)) {}

  [[nodiscard]] rt::RtLog& of(TaskId id) noexcept { return logs_[index_of(id)]; }
  [[nodiscard]] const rt::LogSites& sites() const noexcept { return sites_; }
  // Logs of the tasks of `box`, by name, to a drain.
  void attach(rt::NonRealtime& nrt, rt::Box box, rt::LogDrain& drain) {
    for (const auto& row : kTaskTable) {
      if (row.box == box) drain.attach(nrt, std::string(row.name), of(row.id));
    }
  }

 private:
  using LimitSite = rt::LogSite<unsigned, double, double>;
  [[nodiscard]] std::array<LimitSite, kLimitTable.size()> limit_sites(rt::NonRealtime& nrt) {
    std::array<LimitSite, kLimitTable.size()> sites;
    for (std::size_t i = 0; i < sites.size(); ++i) {
      const LimitRow& row = kLimitTable[i];
      sites[i] = sites_.add<unsigned, double, double>(
          nrt, rt::LogLevel::kWarning,
          std::string(kEdgeTable[index_of(row.edge)].name) +
              ": {} (0 in time again, 1 silent, 2 old), {:.0f} ms, limit {:.0f} ms; beyond its "
              "limits: " +
              std::string(row.beyond));
    }
    return sites;
  }

  rt::LogSites sites_;
  std::array<rt::RtLog, kTaskCount> logs_;

 public:
  const rt::LogSite<unsigned, unsigned, unsigned> mode;
  const rt::LogSite<double, double, double, double> contact;
  const rt::LogSite<std::uint64_t> events_lost;
  const rt::LogSite<unsigned> mark;
  const rt::LogSite<std::uint64_t> mark_dropped;
  const rt::LogSite<std::uint64_t, int, std::uint64_t> path;
  const rt::LogSite<std::uint64_t, unsigned> given_up;
  const rt::LogSite<std::uint64_t> tracking_lost, tracking_back, goal_refused, goal_expired;
  const rt::LogSite<double> estop;
  const rt::LogSite<unsigned, unsigned> level;
  const rt::LogSite<std::uint64_t, unsigned, unsigned> edit;
  const rt::LogSite<unsigned, double, double> grasp;
  const rt::LogSite<unsigned> no_grasp;
  const rt::LogSite<std::uint64_t, unsigned> edit_refused;
  const rt::LogSite<double, double, double> surface_left;
  const BusLog bus;
  const std::array<LimitSite, kLimitTable.size()> limits;  // of rows of kLimitTable
};

}  // namespace tasks
