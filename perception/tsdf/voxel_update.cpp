#include "perception/tsdf/voxel_update.hpp"

#include <cmath>
#include <cstring>

#include "perception/tsdf/clones.hpp"

namespace perception {
namespace {

constexpr float kLeastZ = 0.05F;

// y and z of the 64 nodes of one x slice.
struct Slice {
  alignas(64) float y[64];
  alignas(64) float z[64];
};
constexpr Slice make_slice() {
  Slice s{};
  for (int n = 0; n < 64; ++n) {
    s.y[n] = static_cast<float>(n >> 3);
    s.z[n] = static_cast<float>(n & 7);
  }
  return s;
}
constexpr Slice kSlice = make_slice();

TELETACT_CLONES
void project_slice(const UpdateCamera& c, const float* base, std::int32_t* __restrict pixel,
                   float* __restrict z_out, float* __restrict stretch) noexcept {
  const float bx = base[0], by = base[1], bz = base[2];
  const float yx = c.dy[0], yy = c.dy[1], yz = c.dy[2];
  const float zx = c.dz[0], zy = c.dz[1], zz = c.dz[2];
  const float fx = c.fx, fy = c.fy, cx = c.cx, cy = c.cy;
  const auto umax = static_cast<float>(c.width) - 0.5F, vmax = static_cast<float>(c.height) - 0.5F;
  const std::int32_t width = c.width, spare = c.width * c.height;
  for (int n = 0; n < 64; ++n) {
    const float px = (bx + kSlice.y[n] * yx) + kSlice.z[n] * zx;
    const float py = (by + kSlice.y[n] * yy) + kSlice.z[n] * zy;
    const float pz = (bz + kSlice.y[n] * yz) + kSlice.z[n] * zz;
    const bool ahead = pz >= kLeastZ;
    const float inv = 1.0F / (ahead ? pz : 1.0F);
    const float x = px * inv, y = py * inv;
    const float u = x * fx + cx, v = y * fy + cy;
    const bool in = ahead & (u >= -0.5F) & (v >= -0.5F) & (u < umax) & (v < vmax);
    const auto iu = static_cast<std::int32_t>((in ? u : 0.0F) + 0.5F);
    const auto iv = static_cast<std::int32_t>((in ? v : 0.0F) + 0.5F);
    pixel[n] = in ? iv * width + iu : spare;
    z_out[n] = pz;
    stretch[n] = std::sqrt((1.0F + x * x) + y * y);
  }
}

TELETACT_CLONES
std::uint32_t gather(const std::uint32_t* pixels, const std::int32_t* __restrict index,
                     std::uint32_t* __restrict out) noexcept {
  std::uint32_t any = 0;
  for (int n = 0; n < 512; ++n) {
    out[n] = pixels[index[n]];
    any |= out[n];
  }
  return any;
}

TELETACT_CLONES
void fuse(const UpdateCamera& c, UpdateScratch& s, std::uint32_t* __restrict words,
          std::int32_t* __restrict counts) noexcept {
  const float trunc = c.truncation_m, units = c.units_per_m, band_c = c.colour_band_m;
  const std::int32_t cap = c.weight_cap;
  std::int32_t fused = 0, carved = 0, coloured = 0;
  for (int n = 0; n < 512; ++n) {
    const std::uint32_t reading = s.reading[static_cast<std::size_t>(n)];
    const auto depth_mm = static_cast<std::int32_t>(reading & 0xffffU);
    const auto w_pixel = static_cast<std::int32_t>((reading >> 16U) & 0xffU);
    const float limit =
        trunc * (static_cast<float>(static_cast<std::int32_t>(reading >> 24U)) * 0.03125F);
    const float sdf = (static_cast<float>(depth_mm) * 0.001F - s.z[static_cast<std::size_t>(n)]) *
                      s.stretch[static_cast<std::size_t>(n)];
    const std::uint32_t word = words[n];
    const auto w = static_cast<std::int32_t>(word >> 16U);
    const auto d = static_cast<std::int32_t>(word << 16U) >> 16;
    const std::int32_t seen = depth_mm != 0;
    const std::int32_t front = seen & static_cast<std::int32_t>(sdf > limit);
    const std::int32_t band = seen & static_cast<std::int32_t>(w_pixel != 0) &
                              static_cast<std::int32_t>(sdf <= limit) &
                              static_cast<std::int32_t>(sdf >= -limit);
    const std::int32_t carve = front & static_cast<std::int32_t>(w != 0);
    const std::int32_t w_new = (-band & w_pixel) | (-carve & 128);
    const float scaled = sdf * units;
    const float clipped = scaled > 32767.0F ? 32767.0F : scaled < -32767.0F ? -32767.0F : scaled;
    const float value = band != 0 ? clipped : 32767.0F;
    const std::int32_t w_sum = w + w_new;
    const float mean =
        (static_cast<float>(d) * static_cast<float>(w) + value * static_cast<float>(w_new)) /
        static_cast<float>(w_sum > 1 ? w_sum : 1);
    const auto rounded = static_cast<std::int32_t>(mean + (mean >= 0.0F ? 0.5F : -0.5F));
    const std::int32_t w_kept = w_sum < cap ? w_sum : cap;
    const std::uint32_t updated = (static_cast<std::uint32_t>(rounded) & 0xffffU) |
                                  (static_cast<std::uint32_t>(w_kept) << 16U);
    words[n] = w_new != 0 ? updated : word;
    const std::int32_t outside = static_cast<std::int32_t>(sdf > 0.0F);
    s.set_free[static_cast<std::size_t>(n)] = static_cast<std::uint8_t>(front | (band & outside));
    s.clear_free[static_cast<std::size_t>(n)] = static_cast<std::uint8_t>(band & (outside ^ 1));
    const std::int32_t near =
        band & static_cast<std::int32_t>(sdf <= band_c) & static_cast<std::int32_t>(sdf >= -band_c);
    s.near[static_cast<std::size_t>(n)] = static_cast<std::uint8_t>(near);
    fused += band;
    carved += carve;
    coloured |= near;
  }
  counts[0] = fused, counts[1] = carved, counts[2] = coloured;
}

// Eight bytes of 0 or 1 to eight bits, first byte to bit 0.
std::uint64_t pack8(const std::uint8_t* p) noexcept {
  std::uint64_t x;
  std::memcpy(&x, p, 8);
  return (x * 0x0102040810204080ULL) >> 56U;
}

}  // namespace

BlockCounts update_block(const UpdateCamera& c, const float (&p0)[3], std::uint32_t* words,
                         std::uint64_t* free, UpdateScratch& s) noexcept {
  for (int x = 0; x < 8; ++x) {
    const auto fx = static_cast<float>(x);
    const float base[3] = {p0[0] + fx * c.dx[0], p0[1] + fx * c.dx[1], p0[2] + fx * c.dx[2]};
    const std::size_t at = static_cast<std::size_t>(x) * 64;
    project_slice(c, base, &s.pixel[at], &s.z[at], &s.stretch[at]);
  }
  if (gather(c.pixels, s.pixel.data(), s.reading.data()) == 0) return {};
  std::int32_t counts[3];
  fuse(c, s, words, counts);
  for (std::size_t x = 0; x < 8; ++x) {
    std::uint64_t set = 0, clear = 0;
    for (std::size_t y = 0; y < 8; ++y) {
      set |= pack8(&s.set_free[x * 64 + y * 8]) << (8 * y);
      clear |= pack8(&s.clear_free[x * 64 + y * 8]) << (8 * y);
    }
    free[x] = (free[x] & ~clear) | set;
  }
  return {counts[0], counts[1], counts[2] != 0};
}

}  // namespace perception
