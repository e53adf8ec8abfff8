// Which surface pieces belong to one object: the support plane taken out, pieces merged over
// boundaries that are neither depth steps nor concave creases.
//
// Evidence of a boundary is a mean over the pixel pairs along it, so a few noisy pieces do not
// decide:
//   step      share of pairs whose points lie apart by more than the noise allows, as seen from the
//             nearer of both planes
//   concave   angle between the two planes where they form a valley (Stein et al., CVPR 2014:
//             objects are convex, valleys lie between them)
//   colour    difference of the regions' mean colours; nothing where one of them has none
// Merged in rounds, every region with its best neighbour when the choice is mutual. Then the inside
// of a hollow thing joins its outside, whatever their colours: beyond the near rim it lies lower,
// all that it hides it hides by its own rim, and both rims are of one height. What stands behind
// something else shows its sides down to the support.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/surface_patches.hpp"

namespace perception {

struct ObjectGraphConfig {
  // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
  // Noise of a reading: depth_noise_m at 1 m, growing with z^2.
  float step_m = 0.008F, step_per_m2 = 0.004F;  // a larger gap is a step
  float smooth_deg = 12, crease_deg = 40;       // concave angle that counts nothing; fully
  float step_weight = 1.2F, concave_weight = 1.0F, colour_weight = 0.25F;
  float colour_scale = 25;                            // Lab units
  float same_colour = 0.6F, same_colour_step = 0.6F;  // share of a valley, of a step, that like
                                                      // colours take away
  float stop = 0.45F;
  // Seen area at which the smaller of two regions counts half: crumbs join more readily.
  float area_cm2 = 200, step_area_cm2 = 70;
  float occluded_colour = 25;  // Lab units between two parts of one object
  float far_m = 0.20F;         // a gap beyond it is never bridged
  float flat_colour = 12;  // enclosed support that differs so much in a, b is a thing of its own
  // chosen on: clutter 200 to 211, tabletop; judged on: clutter 100 to 109
  float common_share = 0.25F;  // a colour that so much of the support has is the support's
  // chosen on: not recorded; judged on: mosd_learn, tabletop, ycb_video (docs/segmentation.md)
  // Support plane: searched within this distance of the touch.
  float support_radius_m = 0.6F;
  float support_m = 0.006F, support_per_m2 = 0.003F;  // height that is still support
  float support_tilt_deg = 30;
  int support_draws = 120, support_samples = 500;
  // chosen on: not recorded; judged on: mosd_learn mirrored, turned, with noise, tabletop, ycb_video (docs/segmentation.md)
  // A hollow thing: how far its rim departs from one height, and its inside lies below it, noise
  // included.
  float rim_m = 0.012F, rim_per_m2 = 0.003F;
  float bottom_share = 0.8F;   // of the outline of its bottom that its inside touches at least
  float rim_share = 0.10F;     // of the inside's outline that the near rim hides at least
  float hollow_gap_m = 0.35F;  // from the near rim to what is seen behind it at most
  std::uint64_t seed = 1;      // no data
};

// What a noise of at_1m, growing by per_m2 with z^2, is at z.
[[nodiscard]] inline float height_noise(float at_1m, float per_m2, float z) noexcept {
  return at_1m + per_m2 * z * z;
}

// n . p = d in the camera frame C, m; the normal points to the camera's side.
struct SupportPlane {
  Vec3f n{0, 0, 0};
  float d = 0;
  float share = 0;  // of the readings near the touch
  [[nodiscard]] bool valid() const noexcept { return n.squaredNorm() > 0.5F; }
  [[nodiscard]] float height(const Vec3f& p) const noexcept { return n.dot(p) - d; }
};

class ObjectGraph {
 public:
  ObjectGraph(int max_width, int max_height);

  // The plane that most of the surface within support_radius_m of p_touch lies on. Same input, same
  // plane. Invalid when nothing supports one.
  [[nodiscard]] SupportPlane find_support(const SurfacePatches& patches, const Vec3f& p_touch,
                                          const ObjectGraphConfig& config) noexcept;

  // Regions of the pieces given the plane (may be invalid). Does not allocate.
  void build(const SurfacePatches& patches, const SupportPlane& plane,
             const ObjectGraphConfig& config) noexcept;

  static constexpr int kNone = -1, kSupport = -2;
  // Two regions are one object cut by an occluder: their largest faces lie in one plane, and on the
  // way from one to the other nothing is seen behind that plane.
  [[nodiscard]] bool same_behind_occluder(const SurfacePatches& patches, int region_a, int region_b,
                                          const ObjectGraphConfig& config) noexcept;
  [[nodiscard]] float area_cm2(int region) const noexcept {
    return sums_[static_cast<std::size_t>(region)].area_cm2;
  }
  // Mean colour of what was marked as support.
  [[nodiscard]] Lab support_colour() const noexcept { return support_colour_; }
  [[nodiscard]] bool support_has_colour() const noexcept { return support_has_colour_; }

  // Region of a piece: >= 0, or kSupport, or kNone (no plane through it).
  [[nodiscard]] int region(int piece) const noexcept {
    return region_[static_cast<std::size_t>(piece)];
  }

 private:
  struct Edge {
    int a = 0, b = 0;  // pieces at first, then regions, a < b
    float length = 0, step = 0, concave = 0;
    float cost = 0;  // while edges are collected: of a pair of pixels' share in `concave`
  };
  static constexpr float kNotKnown = -1;
  struct Region {
    float L = 0, a = 0, b = 0, n = 0, area_cm2 = 0;  // sums over n pixels with colour
  };
  [[nodiscard]] bool fit_support(SupportPlane& plane, float aligned) const noexcept;
  void mark_support(const SurfacePatches& patches, const SupportPlane& plane,
                    const ObjectGraphConfig& config) noexcept;
  void free_coloured_support(const SurfacePatches& patches,
                             const ObjectGraphConfig& config) noexcept;
  Edge& edge_between(int a, int b) noexcept;
  [[nodiscard]] static float valley_of(const SurfacePiece& p, const SurfacePiece& q,
                                       const ObjectGraphConfig& config) noexcept;
  void collect(const SurfacePatches& patches, const ObjectGraphConfig& config) noexcept;
  void combine() noexcept;
  [[nodiscard]] bool merge_round(const ObjectGraphConfig& config) noexcept;
  int root(int i) noexcept;
  // Of points of a region's outline.
  struct Heights {
    float n = 0, sum = 0, square = 0;
    void add(float h, float weight = 1) noexcept {
      n += weight, sum += weight * h, square += weight * h * h;
    }
    [[nodiscard]] float mean() const noexcept { return sum / n; }
    [[nodiscard]] float deviation() const noexcept;
  };
  // Of a region: where it hides what is behind it, all of it, and pixel pairs along its outline.
  struct Outline {
    Heights open, all;
    float pairs = 0;
  };
  // Of an edge: where a hides b [0], b hides a [1], and pairs where both touch.
  struct Between {
    std::array<Heights, 2> rim;
    float touching = 0;
  };
  void measure_outlines(const SurfacePatches& patches, const SupportPlane& plane,
                        const ObjectGraphConfig& config) noexcept;
  [[nodiscard]] Between* between(int a, int b) noexcept;
  [[nodiscard]] bool is_inside_of(int inside, const Heights& rim, float z,
                                  const ObjectGraphConfig& config) const noexcept;
  [[nodiscard]] bool is_bottom_of(int bottom, int inside, const Between& edge,
                                  const ObjectGraphConfig& config) const noexcept;
  void join(int a, int b) noexcept;
  void join_hollow(const SurfacePatches& patches, const SupportPlane& plane,
                   const ObjectGraphConfig& config) noexcept;
  struct Face {
    Vec3f n{0, 0, 0}, centre{0, 0, 0};
    float area = 0;
  };
  [[nodiscard]] Face largest_face(const SurfacePatches& patches, int region) noexcept;
  // Lab units, L counted half; kNotKnown where one has no colour.
  [[nodiscard]] static float colour_difference(const Region& a, const Region& b) noexcept;
  Lab support_colour_;
  bool support_has_colour_ = false;
  Face asked_face_;  // of asked_region_, since the last build()
  int asked_region_ = kNone;

  int edge_count_ = 0, pieces_ = 0;
  std::vector<Edge> edges_;
  std::vector<Region> sums_;
  std::vector<int> parent_, region_;
  // An edge a region: the first one, while they are collected; the best one. After build() the
  // pieces of the region asked for.
  std::vector<int> best_;
  std::vector<int> next_;  // edge of the same first piece
  std::vector<std::uint8_t> support_;
  std::vector<Outline> outlines_;  // a region
  std::vector<Between> between_;   // an edge between regions
  struct Sample {
    Vec3f p{0, 0, 0}, n{0, 0, 0};
    float area = 0, tolerance = 0;
  };
  std::vector<Sample> sample_;
};

}  // namespace perception
