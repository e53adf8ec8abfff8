#include "tasks/fusion/map_anchor.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "perception/icp/degeneracy.hpp"

namespace tasks {

using perception::MapView;
using perception::Pose;
using perception::RaycastMaps;
using perception::Vec3;

namespace {

using Mat6 = Eigen::Matrix<double, 6, 6>;

constexpr int kNodes = 3500;  // about that many, evenly over the image
constexpr int kLeastNodes = 400;
constexpr int kSettledWeight = 64 * MapView::kWeightOne;
constexpr double kGain = 2;
constexpr double kMost_m = 5e-4;  // that a pose is moved by, at the mean depth
constexpr double kGrazing = 0.3;  // cosine; flatter seen, a node's distance is clipped
constexpr double kWay_m = 0.02, kTurn_deg = 1;  // farther, the camera has moved
constexpr int kRest = 30, kAgain = 8;  // frames: before nodes are remembered; if too few were
constexpr float kChanged_m = 0.01F;    // by more than this, and a pixel, the scene has
// Of the surface seen, at least this share has to be near enough for its nodes to show it: the near
// part alone may well say nothing of a direction in which the whole is tracked.
constexpr double kShown = 0.75;

// Is there no edge within a voxel or so? There some readings are of the other side, and what one of
// them teaches is taken back by many.
bool smooth(const RaycastMaps& model, int u, int v, double voxel_m) noexcept {
  const float z = model.at(u, v)[3];
  const int m =
      1 + static_cast<int>(std::ceil(voxel_m * model.intrinsics.fx / static_cast<double>(z)));
  if (u < m || v < m || u + m >= model.width() || v + m >= model.height()) return false;
  const float l = model.at(u - m, v)[3], r = model.at(u + m, v)[3], t = model.at(u, v - m)[3],
              b = model.at(u, v + m)[3];
  const float least = std::min(std::min(l, r), std::min(t, b)), bend = 0.02F;
  return least > 0 && std::abs(l + r - 2 * z) < bend && std::abs(t + b - 2 * z) < bend;
}

}  // namespace

MapAnchor::MapAnchor(rt::NonRealtime&) { nodes_.reserve(std::size_t{2} * kNodes); }

void MapAnchor::forget() noexcept {
  moved_.setZero();
  nodes_.clear();
  rested_ = 0;
}

Pose MapAnchor::held(const Pose& X_WC) const noexcept {
  Twist back = -kGain * moved_;
  const double size = std::max(back.head<3>().norm(), length_m_ * back.tail<3>().norm());
  if (!(size > 0)) return X_WC;
  if (size > kMost_m) back *= kMost_m / size;
  const Eigen::Translation3d to_centre(-centre_W_), from_centre(centre_W_);
  return perception::orthonormalised(
      Pose(from_centre * perception::exp_se3(back) * to_centre * X_WC));
}

void MapAnchor::update(const MapView& map, const RaycastMaps& model,
                       const perception::icp::NoiseRule& noise, const Pose& X_WC,
                       double length_m) noexcept {
  const Pose step = X_WC_.inverse(Eigen::Isometry) * X_WC;
  if (step.translation().norm() > kWay_m ||
      perception::rotation_angle(step.linear()) * 180 / std::numbers::pi > kTurn_deg) {
    forget();
    X_WC_ = X_WC;
  } else if (!nodes_.empty()) {
    compare(map);
  } else if (++rested_ >= kRest) {
    length_m_ = length_m;
    centre_W_ = X_WC * Vec3(0, 0, length_m);
    remember(map, model, noise);
    rested_ = kRest - kAgain;
  }
}

void MapAnchor::remember(const MapView& map, const RaycastMaps& model,
                         const perception::icp::NoiseRule& noise) noexcept {
  const int pixels = model.width() * model.height();
  const int step =
      std::max(1, static_cast<int>(std::lround(std::sqrt(static_cast<double>(pixels) / kNodes))));
  int seen = 0, shown = 0;
  for (int v = step / 2; v < model.height(); v += step)
    for (int u = step / 2; u < model.width(); u += step) {
      if (!model.hit(u, v) || nodes_.size() == nodes_.capacity()) continue;
      const Vec3 p_C = model.vertex_C(u, v).cast<double>(),
                 n_C = model.normal_C(u, v).cast<double>();
      const double across = -n_C.dot(p_C) / p_C.norm();
      // Where a pixel covers more than a node's cell, nodes show the pixels' steps and not the
      // surface.
      ++seen;
      if (p_C.z() > map.voxel_size() * model.intrinsics.fx) continue;
      ++shown;
      if (across < kGrazing || !smooth(model, u, v, map.voxel_size())) continue;
      const float beyond = std::max(static_cast<float>(p_C.z()) - noise.from_m, 0.0F);
      const float share = noise.least_m / (noise.least_m + noise.per_m2 * beyond * beyond);
      Node node{};
      node.across = static_cast<float>(across) * map.metres_per_unit();
      node.most_m = kChanged_m + static_cast<float>(p_C.z() / model.intrinsics.fx);
      node.weight = share * share;
      take(map, model.X_WC * p_C, model.X_WC.linear() * n_C, node);
    }
  if (nodes_.size() < static_cast<std::size_t>(kLeastNodes) || shown < kShown * seen)
    nodes_.clear();
}

// The node nearest to a point of the surface, if it is settled.
void MapAnchor::take(const MapView& map, const Vec3& hit_W, const Vec3& n_W, Node node) noexcept {
  const Vec3 at = hit_W / map.voxel_size();
  const int i = static_cast<int>(std::lround(at.x())), j = static_cast<int>(std::lround(at.y())),
            k = static_cast<int>(std::lround(at.z()));
  node.at = {i >> 3, j >> 3, k >> 3};
  node.block = map.find_block(node.at);
  if (node.block == MapView::kNoBlock) return;
  node.voxel = MapView::in_block(i, j, k);
  node.word = map.block_words(node.block)[node.voxel];
  if (MapView::word_weight(node.word) < kSettledWeight) return;
  const Vec3 turn = (hit_W - centre_W_).cross(n_W);
  for (int c = 0; c < 3; ++c) {
    node.row[c] = static_cast<float>(n_W(c));
    node.row[c + 3] = static_cast<float>(turn(c));
  }
  nodes_.push_back(node);
}

void MapAnchor::compare(const MapView& map) noexcept {
  Mat6 H = Mat6::Zero();
  Twist g = Twist::Zero();
  double sum = 0;
  int count = 0;
  for (const Node& node : nodes_) {
    if (!map.in_use(node.block) || !(map.block_coord(node.block) == node.at)) continue;
    const std::uint32_t word = map.block_words(node.block)[node.voxel];
    const int learned = MapView::word_distance(word) - MapView::word_distance(node.word);
    const double farther = static_cast<double>(learned) * static_cast<double>(node.across);
    if (std::abs(farther) > static_cast<double>(node.most_m) ||
        MapView::word_weight(word) < kSettledWeight)
      continue;
    const Twist row = Eigen::Map<const Eigen::Matrix<float, 6, 1>>(node.row).cast<double>();
    const double w = static_cast<double>(node.weight);
    H += w * row * row.transpose();
    g += w * farther * row;
    sum += w;
    ++count;
  }
  moved_.setZero();
  if (count < kLeastNodes || 2 * count < nodes()) return nodes_.clear();  // others, then
  const perception::Degeneracy directions =
      perception::analyse(H, H, sum, length_m_, perception::DegeneracyConfig{});
  Twist step;
  if (perception::confined_step(H, g, length_m_, directions, step)) moved_ = step;
}

}  // namespace tasks
