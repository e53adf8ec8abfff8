// What a moved thing leaves in the map, against the true world at that instant.
#pragma once

#include <vector>

#include "perception/ground/cost_map.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "tools/measure/accuracy/moving_film.hpp"

namespace teletact {

class MovingGhosts {
 public:
  MovingGhosts(rt::NonRealtime& nrt, const MovingSample& sample, const MovingFilm& film);

  // A frame that the run did not claim sees nothing free, since its pose is unknown. Before that:
  // all frames are claimed.
  void claimed(int frame, bool claimed) { claimed_[static_cast<std::size_t>(frame)] = claimed; }

  // cm^3: cells of 10 mm that hold a vertex more than 30 mm off every true surface at this frame,
  // in the volume swept so far grown by 50 mm, at a place that was seen free in 10 frames since the
  // mover left it (a reading of the nearest pixel at least 50 mm behind it). `mesh` in T, the frame
  // of the map; X_WT its truth.
  [[nodiscard]] double volume_cm3(const perception::Mesh& mesh, const perception::Pose& X_WT,
                                  int frame) const;
  // Occupied cells of the cost map with nothing true in their column (0.05 to 1.05 m, 100 mm round
  // their middle), where the mover was, and all of where it was in the column was seen free as
  // above.
  [[nodiscard]] int cost_cells(const perception::CostMap& map, const perception::Pose& X_WT,
                               int frame) const;
  // Solid nodes of the windows that a hand would be given where the mover was, every 10th frame
  // until this one: more than 30 mm off every true surface, at a place that was seen free as above.
  [[nodiscard]] int window_nodes(const perception::TsdfMap& map, const perception::Pose& X_WT,
                                 int frame) const;
  // Share of the mover's seen surface that has a vertex within `reach_m`. NaN: hardly to be seen.
  [[nodiscard]] double mover_in_mesh(const perception::Mesh& mesh, const perception::Pose& X_WT,
                                     int frame, double reach_m) const;
  // Share of the mover's seen points in the robot's height that lie in or beside an occupied cell.
  // NaN: too few.
  [[nodiscard]] double mover_in_cost(const perception::CostMap& map, const perception::Pose& X_WT,
                                     int frame) const;

 private:
  enum class Place : std::uint8_t { kNeverThere, kUnseen, kSeenFree };
  [[nodiscard]] Place place(const perception::Vec3& p_W, int frame, double grown_m) const;
  [[nodiscard]] bool mover_at(const perception::Vec3& p_W, int frame, double grown_m) const;
  [[nodiscard]] bool seen_free(const perception::Vec3& p_W, int frame) const;
  [[nodiscard]] std::vector<perception::Vec3> seen_mover(int frame) const;

  const MovingFilm& film_;
  drivers::World world_;
  std::vector<int> movers_;
  std::vector<perception::Vec3> centres_;  // frame by frame, mover by mover
  std::vector<perception::Pose> X_CW_;
  std::vector<char> claimed_;
  Eigen::AlignedBox3d swept_;
};

}  // namespace teletact
