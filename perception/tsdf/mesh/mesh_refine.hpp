// Moves vertices onto the surface that their neighbourhood agrees on.
//
// Marching cubes puts a vertex where the two nodes of one grid edge place the surface, so it has
// the noise of two voxels. The neighbouring nodes saw other pixels. So each vertex is moved along
// its normal onto a surface of second order through the vertices round it (moving least squares,
// Alexa et al. 2003), with these weights:
//
//   distance   (1 - r^2 / R^2)^2, R = radius
//   normal     ((c - c_g) / (1 - c_g))^2, c = cosine between the two, c_g = cosine of most_angle:
//              not round an edge
//   offset     (1 - z^2 / voxel^2)^2, z = across: not from one step to the next
//   readings   how many the vertex rests on
//
// Curvature counts as far as it exceeds its own standard error; without it the surface is a plane,
// which is less noisy. No vertex moves farther than the noise of its own readings explains, so a
// vertex with many readings stays.
#pragma once

#include <span>

#include "rt/memory/non_realtime.hpp"

namespace perception {

struct Mesh;

struct RefineOptions {
  double radius = 2.5;            // voxels
  double most_angle_deg = 40;     // between normals
  double reading_sigma_m = 4e-3;  // of one reading across the surface, at most
  double most_sigmas = 3;         // of a vertex's own readings that it may move
};

// `readings` of each vertex; vertices and normals are changed. Same input, same bytes.
void refine_vertices(rt::NonRealtime&, std::span<const float> readings, double voxel_m,
                     const RefineOptions& options, Mesh& mesh);

}  // namespace perception
