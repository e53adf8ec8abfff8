// The views of a run, each as often as it changes and as the contract allows at most
// (docs/console_protocol.md). By the console's thread; with nobody there to look it does nothing.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "drivers/youbot/mecanum.hpp"
#include "tools/console/console_server.hpp"
#include "tools/desk/desk_acts.hpp"
#include "tools/desk/desk_figures.hpp"
#include "tools/desk/desk_text.hpp"
#include "tools/desk/desk_views.hpp"

namespace teletact {

// What the desk needs of the page's server. Any ordinary thread.
struct DeskPort {
  std::function<int()> viewers;
  std::function<bool(ViewKind, const ViewStamp&, std::span<const std::uint8_t>)> publish;
  std::function<bool()> wants_whole_mesh;
  std::function<bool(const perception::MeshDelta&, const ViewStamp&, double block_edge_m)> mesh;
  std::function<void(std::uint32_t session, std::int64_t id, const ConsoleAnswer&)> answer;
  std::function<std::vector<ConsolePerson>()> people;
  // The same text to one session, with its own role.
  std::function<bool(std::uint32_t, const ViewStamp&, std::string_view)> text_to;
  // A view of one session alone.
  std::function<bool(std::uint32_t, ViewKind, const ViewStamp&, std::span<const std::uint8_t>)>
      view_to;
  std::function<std::int64_t()> server_cpu_ns;
};

class DeskShow {
 public:
  DeskShow(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
           const DeskPort& port, DeskFigures& figures, TaskWatch* tasks);
  void tick(const DeskActs& acts, const DeskEvents& events, DeskFacts facts, rt::Time now);
  // To whoever clicked.
  void show_proposal(const ShownProposal& shown, rt::Time now);

 private:
  [[nodiscard]] ViewStamp stamp(rt::Time now, rt::Time data) const;
  [[nodiscard]] bool due(rt::Time& next, rt::Time now, int period_ms) const;
  void show_pose(rt::Time now);
  void show_picture(rt::Time now);
  [[nodiscard]] perception::Pose camera_at(rt::Time exposure) const;
  void show_map(rt::Time now);
  void show_text(const DeskActs& acts, const DeskEvents& events, DeskFacts facts, rt::Time now);
  void measure(rt::Time now, DeskFacts& facts);
  [[nodiscard]] LinkFacts link_facts(const DeskEvents& events, rt::Time now) const;

  OperatorBox& box_;
  OperatorConsole& console_;
  const DeskPort& port_;
  DeskFigures& figures_;
  TaskWatch* tasks_;
  rt::Time epoch_;
  drivers::Mecanum wheels_;
  double block_edge_m_, brake_m_per_s2_;
  bool renders_force_;
  PictureMaker pictures_;
  rt::Time next_pose_{}, next_picture_{}, next_map_{}, next_text_{}, next_tasks_{}, rolled_{};
  std::array<double, 4> wheel_rad_{};
  std::uint64_t map_seq_ = 0;
  double share_ = 0;
  PictureLoss loss_;
  std::uint64_t frame_seq_ = 0;
  std::int64_t cpu_ns_ = 0, cpu_before_ns_ = 0;
  rt::Time measured_{};
};

}  // namespace teletact
