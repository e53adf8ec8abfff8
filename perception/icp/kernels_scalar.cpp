// The reference: one pixel after the other.
#include <cmath>

#include "perception/icp/kernels.hpp"

namespace perception::icp {
namespace {

struct V3 {
  float x, y, z;
};
V3 turn(const float* R, const float* t, V3 p) {
  return {R[0] * p.x + R[1] * p.y + R[2] * p.z + t[0], R[3] * p.x + R[4] * p.y + R[5] * p.z + t[1],
          R[6] * p.x + R[7] * p.y + R[8] * p.z + t[2]};
}
float dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
V3 minus(V3 a, V3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
void fill_row(V3 n, V3 a, float (&J)[6]) {
  J[0] = n.x, J[1] = n.y, J[2] = n.z;
  J[3] = a.y * n.z - a.z * n.y;
  J[4] = a.z * n.x - a.x * n.z;
  J[5] = a.x * n.y - a.y * n.x;
}

struct RowSums {
  float sums[kSums][kLanes] = {};
  float cross[kCross][kLanes] = {};
};

void add_pixel(const RowsJob& job, int u, int v, bool with_cross, RowSums& row, LaneSums& out) {
  const std::ptrdiff_t at = v * job.stride + u;
  const float z = job.z[at];
  if (!(z > 0)) return;
  ++out.live;
  const V3 q = turn(job.R_F, job.t_F, {job.x_factor[u] * z, job.y_factor[v] * z, z});
  if (!(q.z > 0.05F)) return;
  const float inv_z = 1.0F / q.z;
  const float pu = job.fx * q.x * inv_z + (job.cx + 0.5F);
  const float pv = job.fy * q.y * inv_z + (job.cy + 0.5F);
  if (!(pu >= 0 && pv >= 0 && pu < job.model_width && pv < job.model_height)) return;
  const int iu = static_cast<int>(pu), iv = static_cast<int>(pv);
  const float* record =
      job.model + 4 * (static_cast<std::ptrdiff_t>(iv) * static_cast<int>(job.model_width) + iu);
  const V3 n{record[0], record[1], record[2]};
  const V3 m{(static_cast<float>(iu) - job.cx) * job.inv_fx * record[3],
             (static_cast<float>(iv) - job.cy) * job.inv_fy * record[3], record[3]};
  if (!(dot(n, n) > 0.5F)) return;
  ++out.met;
  const V3 d = minus(q, m);
  const float none[3] = {0, 0, 0};
  const V3 l = turn(job.R_F, none, {job.nx[at], job.ny[at], job.nz[at]});
  if (!(dot(d, d) < job.gate_d2)) return;
  const float r = dot(n, d);
  const float beyond = z - job.noise.from_m > 0 ? z - job.noise.from_m : 0.0F;
  const float sigma = job.noise.least_m + job.noise.per_m2 * beyond * beyond;
  if (with_cross && std::abs(r) < kOnSurfaceSigmas * sigma + job.map_error_m) ++out.on_surface;
  if (!(dot(l, n) > job.gate_cos)) return;
  ++out.inliers;
  const float share = job.noise.least_m / sigma;
  const float w = share * share;
  const V3 a = minus(q, {job.centre[0], job.centre[1], job.centre[2]});
  const int lane = u % kLanes;
  float J[6];
  fill_row(n, a, J);
  int s = 0;
  for (int i = 0; i < 6; ++i) {
    const float wJ = w * J[i];
    for (int j = i; j < 6; ++j) row.sums[s++][lane] += wJ * J[j];
    row.sums[21 + i][lane] += wJ * r;
  }
  row.sums[27][lane] += w * r * r;
  row.sums[28][lane] += w;
  if (!with_cross) return;
  float L[6];
  fill_row(l, a, L);
  s = 0;
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j) row.cross[s++][lane] += 0.5F * w * (L[i] * J[j] + J[i] * L[j]);
}

void accumulate(const RowsJob& job, bool with_cross, LaneSums& out) {
  for (int v = 0; v < job.rows; ++v) {
    RowSums row;
    for (int u = 0; u < job.width; ++u) add_pixel(job, u, v, with_cross, row, out);
    for (int k = 0; k < kLanes; ++k) {
      for (int i = 0; i < kSums; ++i) out.sums[i][k] += static_cast<double>(row.sums[i][k]);
      if (!with_cross) continue;
      for (int i = 0; i < kCross; ++i) out.cross[i][k] += static_cast<double>(row.cross[i][k]);
    }
  }
}

void accumulate_squares(const RowsJob& job, float factor, SquareSums& out) {
  RowSums all;
  LaneSums counts;
  for (int v = 0; v < job.rows; ++v)
    for (int u = 0; u < job.width; ++u) add_pixel(job, u, v, false, all, counts);
  for (int square = 0; square * kSquare < job.width; ++square) {
    for (int i = 0; i < kSums; ++i) {
      const float* s = all.sums[i] + square * kSquare;
      out[square][i] = factor * (((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7])));
    }
  }
}

void bilateral_row(const float* in, std::ptrdiff_t stride, int width, const float* weight,
                   int radius, const EdgeRule& rule, float* out) {
  for (int u = 0; u < width; ++u) {
    const float c = in[u];
    const float edge = rule.base + rule.per_m * c + rule.per_m2 * c * c;
    const float inv = 1.0F / (edge * edge);
    float sum = 0, total = *weight;
    const float* w = weight + 1;
    for (int dv = 0; dv <= radius; ++dv) {
      for (int du = dv == 0 ? 1 : -radius; du <= radius; ++du, ++w) {
        const float za = in[u + dv * stride + du], zb = in[u - dv * stride - du];
        const float a = za - c, b = zb - c;
        const float a2 = a * a, b2 = b * b;
        float k = 1.0F - (a2 < b2 ? b2 : a2) * inv;
        k = k > 0 && za > 0 && zb > 0 ? k * k * *w : 0.0F;
        sum += k * (a + b);  // around the centre: no digits lost
        total += k + k;
      }
    }
    out[u] = c > 0 ? c + sum / total : 0.0F;
  }
}

void normal_row(const float* z, std::ptrdiff_t stride, int width, const float* x_factor,
                const float* y_factor, const EdgeRule& rule, float* out_x, float* out_y,
                float* out_z) {
  for (int u = 0; u < width; ++u) {
    const float c = z[u], l = z[u - 1], r = z[u + 1], t = z[u - stride], b = z[u + stride];
    const float noise = rule.base + rule.per_m2 * c * c;
    const float step = noise + rule.per_m * c;
    bool ok = c > 0 && l > 0 && r > 0 && t > 0 && b > 0;
    ok = ok && std::fabs(l - c) < step && std::fabs(r - c) < step && std::fabs(t - c) < step &&
         std::fabs(b - c) < step;
    ok = ok && std::fabs(l + r - c - c) < noise && std::fabs(t + b - c - c) < noise;
    const float ax = x_factor[u + 1] * r - x_factor[u - 1] * l, ay = y_factor[0] * (r - l),
                az = r - l;
    const float bx = x_factor[u] * (b - t), by = y_factor[1] * b - y_factor[-1] * t, bz = b - t;
    const float nx = by * az - bz * ay, ny = bz * ax - bx * az, nz = bx * ay - by * ax;
    const float l2 = nx * nx + ny * ny + nz * nz;
    ok = ok && l2 > 0;
    const float inv = 1.0F / std::sqrt(ok ? l2 : 1.0F);
    out_x[u] = ok ? nx * inv : 0.0F;
    out_y[u] = ok ? ny * inv : 0.0F;
    out_z[u] = ok ? nz * inv : 0.0F;
  }
}

void to_metres_row(const std::uint16_t* mm, int width, float min_m, float max_m, float* out) {
  for (int u = 0; u < width; ++u) {
    const float z = static_cast<float>(mm[u]) / 1000.0F;
    out[u] = (z >= min_m && z <= max_m) ? z : 0.0F;
  }
}

void half_row(const float* in, std::ptrdiff_t stride, int width, const EdgeRule& rule, float* out) {
  for (int u = 0; u < width; ++u) {
    const float* p = in + 2 * u;
    const float c = *p;
    const float noise = rule.base + rule.per_m2 * c * c;
    const float step = noise + rule.per_m * c;
    float sum = 0, n = 1;
    const std::ptrdiff_t pair[4] = {1, stride, stride + 1, stride - 1};
    for (const std::ptrdiff_t d : pair) {
      const float a = p[d] - c, b = p[-d] - c;
      const bool same = a < step && a > -step && b < step && b > -step && a + b < noise &&
                        a + b > -noise && p[d] > 0 && p[-d] > 0;
      sum += same ? a + b : 0.0F;
      n += same ? 2.0F : 0.0F;
    }
    out[u] = c > 0 ? c + sum / n : 0.0F;
  }
}

}  // namespace

const Kernels kScalarKernels{accumulate, accumulate_squares, bilateral_row,
                             normal_row, to_metres_row,      half_row};

}  // namespace perception::icp
