// The 256 cases of marching cubes, made at compile time instead of typed.
//
// Corner c of a cell: bit 2 = x+1, bit 1 = y+1, bit 0 = z+1. Bit c of a case: corner c is inside.
// On each face the surface enters and leaves round every run of neighbouring inside corners. Seen
// from outside the cell all faces are walked the same way round, so an edge that one face enters
// by, the other face leaves by: the crossings link up into closed loops. A face's links depend on
// its four corners alone, so both cells that share it make the same ones: no holes.
#pragma once

#include <array>
#include <cstdint>

namespace perception::marching_cubes {

struct Edge {
  std::uint8_t corner,
      axis;  // from `corner` (whose bit of the axis is 0) along 0 = x, 1 = y, 2 = z
};

struct Case {
  std::uint8_t triangles = 0;
  std::array<std::array<std::uint8_t, 3>, 10> edge{};  // indices into kEdges
};

[[nodiscard]] constexpr std::uint8_t axis_bit(int axis) {
  return static_cast<std::uint8_t>(4 >> axis);
}

[[nodiscard]] constexpr std::array<Edge, 12> make_edges() {
  std::array<Edge, 12> edges{};
  std::size_t n = 0;
  for (std::uint8_t axis = 0; axis < 3; ++axis)
    for (std::uint8_t corner = 0; corner < 8; ++corner)
      if ((corner & axis_bit(axis)) == 0) edges[n++] = {corner, axis};
  return edges;
}
inline constexpr std::array<Edge, 12> kEdges = make_edges();

[[nodiscard]] constexpr int edge_between(int a, int b) {
  for (int e = 0; e < 12; ++e) {
    const int from = kEdges[static_cast<std::size_t>(e)].corner;
    const int to = from | axis_bit(kEdges[static_cast<std::size_t>(e)].axis);
    if ((a == from && b == to) || (a == to && b == from)) return e;
  }
  return -1;
}

[[nodiscard]] constexpr Case make_case(int inside) {
  std::array<int, 12> next{};
  next.fill(-1);
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      // Corners of the face, counter-clockwise seen from outside the cell.
      const int p = axis_bit((axis + 1) % 3), q = axis_bit((axis + 2) % 3);
      const int base = side == 0 ? 0 : axis_bit(axis);
      std::array<int, 4> ring{base, base | p, base | p | q, base | q};
      if (side == 0) ring = {base, base | q, base | p | q, base | p};
      for (std::size_t i = 0; i < 4; ++i) {
        const auto in = [&](std::size_t j) { return ((inside >> ring[j % 4]) & 1) != 0; };
        if (in(i) || !in(i + 1)) continue;  // enters between i and i + 1
        std::size_t j = i + 1;
        while (in(j + 1)) ++j;  // leaves between j and j + 1
        next[static_cast<std::size_t>(edge_between(ring[j % 4], ring[(j + 1) % 4]))] =
            edge_between(ring[i], ring[(i + 1) % 4]);
      }
    }
  Case out;
  std::array<bool, 12> done{};
  for (std::size_t first = 0; first < 12; ++first) {
    if (next[first] < 0 || done[first]) continue;
    std::size_t a = static_cast<std::size_t>(next[first]);
    done[first] = done[a] = true;
    for (auto b = static_cast<std::size_t>(next[a]); b != first;
         b = static_cast<std::size_t>(next[b])) {
      out.edge[out.triangles++] = {static_cast<std::uint8_t>(first), static_cast<std::uint8_t>(b),
                                   static_cast<std::uint8_t>(a)};
      done[b] = true;
      a = b;
    }
  }
  return out;
}

[[nodiscard]] constexpr std::array<Case, 256> make_cases() {
  std::array<Case, 256> cases{};
  for (int c = 0; c < 256; ++c) cases[static_cast<std::size_t>(c)] = make_case(c);
  return cases;
}
inline constexpr std::array<Case, 256> kCases = make_cases();

}  // namespace perception::marching_cubes
