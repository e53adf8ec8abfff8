// A dense integrator that visits every node for every frame, one node at a time: what the sparse
// one must agree with, word for word, wherever it keeps a block.
#pragma once

#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {

struct DenseReference {
  int lo = 0, edge = 0;  // nodes lo .. lo + edge - 1 along each axis
  double voxel = 0, truncation = 0, max_weight = 0;
  struct Node {
    int d = 0, w = 0;
    bool free = false;
    int readings = 0, coloured = 0;  // ended near it; brought a colour
    std::array<int, 3> colour{};
  };
  std::vector<Node> nodes;
  int forgotten = 0,
      contradicted = 0;  // of what was seen through: heavier than 20 readings; in a band

  DenseReference(int lo_node, int edge_nodes, const TsdfConfig& c)
      : lo(lo_node),
        edge(edge_nodes),
        voxel(c.voxel_size_m),
        truncation(c.effective_truncation()),
        max_weight(c.max_weight),
        nodes(static_cast<std::size_t>(edge) * edge * edge) {}

  [[nodiscard]] Node& at(int i, int j, int k) {
    return nodes[(static_cast<std::size_t>(i - lo) * static_cast<std::size_t>(edge) +
                  static_cast<std::size_t>(j - lo)) *
                     static_cast<std::size_t>(edge) +
                 static_cast<std::size_t>(k - lo)];
  }

  // pixels: DepthPyramid's, tested apart. stored(i,j,k): the map keeps a block there. colour: empty
  // for none; it is fused within `band_m`.
  template <class Stored>
  void integrate(const Intrinsics& c, const std::uint32_t* pixels, const Pose& X_WC,
                 Stored&& stored, ImageView<const Rgb> colour = {}, double band_m = 0) {
    const Pose X_CW = X_WC.inverse(Eigen::Isometry);
    const Mat3 step = X_CW.linear() * voxel;
    const Eigen::Matrix3f axes = step.cast<float>();
    for (int i = lo; i < lo + edge; ++i)
      for (int j = lo; j < lo + edge; ++j)
        for (int k = lo; k < lo + edge; ++k) {
          if (!stored(i, j, k)) continue;
          const auto first = [](int n) { return 8.0 * (n >> 3); };
          const Eigen::Vector3f base =
              (X_CW * (voxel * Vec3(first(i), first(j), first(k)))).cast<float>();
          float p[3];
          for (int a = 0; a < 3; ++a) {
            const float along_x = static_cast<float>(i & 7) * axes(a, 0);
            const float along_xy = along_x + static_cast<float>(j & 7) * axes(a, 1);
            p[a] = base(a) + (along_xy + static_cast<float>(k & 7) * axes(a, 2));
          }
          if (p[2] < 0.05F) continue;
          const float inverse = 1.0F / p[2], x = p[0] * inverse, y = p[1] * inverse;
          const float u = x * static_cast<float>(c.fx) + static_cast<float>(c.cx + 0.5);
          const float v = y * static_cast<float>(c.fy) + static_cast<float>(c.cy + 0.5);
          if (u < 0 || v < 0 || u >= static_cast<float>(c.width) ||
              v >= static_cast<float>(c.height))
            continue;
          const int row = static_cast<int>(v), column = static_cast<int>(u);
          const std::uint32_t pixel = pixels[row * c.width + column];
          if (pixel == 0) continue;
          const int weight = static_cast<int>((pixel >> 16U) & 0xffU);
          const float depth = static_cast<float>(pixel & 0xffffU) * 0.001F;
          const float sdf = (depth - p[2]) * std::sqrt((1.0F + x * x) + y * y);
          const float limit =
              static_cast<float>(truncation) * (static_cast<float>(pixel >> 24U) / 32.0F);
          Node& n = at(i, j, k);
          const bool through =
              sdf > limit || (n.w > 0 && n.d < 0 && sdf > static_cast<float>(truncation));
          if (through) {
            n.free = true;
            contradicted += sdf <= limit ? 1 : 0;
            forgotten += n.w > 20 * 128 ? 1 : 0;
            n.w = std::min(n.w, 20 * 128);
            if (n.w > 0) learn(n, 32767.0F, 256);
          } else if (weight > 0 && sdf >= -limit) {
            float s = sdf * static_cast<float>(32767 / truncation);
            s = std::min(std::max(s, -32767.0F), 32767.0F);
            learn(n, s, weight);
            n.free = sdf > 0;
            if (colour.data != nullptr && std::fabs(sdf) <= static_cast<float>(band_m))
              see(n, colour.at(column, row));
          }
        }
  }

  // Means are rounded to the nearest, half up.
  static void see(Node& n, Rgb c) {
    n.readings = std::min(n.readings + 1, 15);
    if (c == Rgb{0, 0, 0}) return;
    const int now[3] = {c.r, c.g, c.b};
    for (std::size_t a = 0; a < 3; ++a) {
      const double mean = (n.colour[a] * n.coloured + now[a]) / (n.coloured + 1.0);
      n.colour[a] = static_cast<int>(std::floor(mean + 0.5));
    }
    n.coloured = std::min(n.coloured + 1, 15);
  }

  void learn(Node& n, float s, int w) const {
    const float mean =
        (static_cast<float>(n.d) * static_cast<float>(n.w) + s * static_cast<float>(w)) /
        static_cast<float>(n.w + w);
    n.d = static_cast<int>(std::lround(mean));
    n.w = std::min(n.w + w, static_cast<int>(max_weight * 128));
  }
};

}  // namespace tests
