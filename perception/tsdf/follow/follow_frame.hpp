// State of one call of SurfaceFollower (follow.hpp). Steps 1 and 2 are in follow.cpp, step 3 in
// follow_blocks.cpp.
#pragma once

#include <array>
#include <cstdint>

#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/blocks/update_camera.hpp"
#include "perception/tsdf/follow/follow.hpp"
#include "perception/tsdf/follow/follow_scratch.hpp"
#include "perception/tsdf/follow/follow_statistics.hpp"

namespace perception {
namespace follow {

// chosen on: follow 1000; judged on: follow 2000
inline constexpr std::uint32_t kStill = 5;  // frames after which what was moved is at rest
inline constexpr double kSlowReach = 0.5;   // of the truncation
inline constexpr int kAtTheEnd = 32000;     // |d|: a bound, not a distance; no data

}  // namespace follow

class FollowFrame {
 public:
  FollowFrame(MapStore& store, const DepthPyramid& pyramid, FollowScratch& scratch,
              const FrameCamera& view, std::uint32_t frame) noexcept
      : store_(store),
        pyramid_(pyramid),
        s_(scratch),
        view_(view),
        k_(view.frame.intrinsics),
        frame_(frame) {}
  FollowCounts step() noexcept;

 private:
  using Place = std::array<int, 4>;  // of the image: u0, v0, u1, v1
  using Looked = FollowScratch::Looked;
  template <class Fn>
  int compare(const Place& place, const Eigen::AlignedBox3d& box, MapReader& reader,
              Fn&& fn) const noexcept;
  [[nodiscard]] bool compare_blocks() noexcept;
  void camera_error() noexcept;
  [[nodiscard]] double node_off(const UpdateCamera& cam, const float (&p0)[3], int n,
                                double* z) const noexcept;
  [[nodiscard]] bool look(const UpdateCamera& cam, std::int32_t block, Looked& out,
                          Vec3& slope) const noexcept;
  [[nodiscard]] bool look_round(const UpdateCamera& cam, std::int32_t block) noexcept;
  [[nodiscard]] bool is_off(Looked& it, const Vec3& slope, double view_doubt) noexcept;
  void smooth() noexcept;
  void move(const UpdateCamera& cam, const Looked& it) noexcept;
  void loosen_round(const Looked& it) noexcept;
  [[nodiscard]] bool moves(const BlockPast& m) const noexcept {
    return m.moved != 0 && frame_ - m.moved <= follow::kStill;
  }
  void remember_eye(BlockPast& m) const noexcept;
  [[nodiscard]] double view_doubt_m(std::int32_t block, const BlockPast& m) const noexcept;

  MapStore& store_;
  const DepthPyramid& pyramid_;
  FollowScratch& s_;
  const FrameCamera& view_;
  const Intrinsics& k_;
  std::uint32_t frame_;
  follow::CommonMotion camera_;  // once it is asked for
  bool asked_camera_ = false;
  FollowCounts counts_;
};

}  // namespace perception
