// The order in which a stripe of a depth image is coded, and what is predicted from what: one piece
// of code for encoder and decoder, so that they can not differ.
//
// A stripe is some rows of 8 x 8 blocks; it is coded without a look at the other one. A block has a
// validity (which of its pixels have a reading: as before, all, mixed, none) and a prediction:
//
//   copy    what had a reading keeps its value; what has one now alone is predicted from neighbours
//   time    residual against the value before; or, by kSwitch, against the neighbours
//   plane   the plane that fits 13 neighbours best, continued
//   edge    median edge detector: W, N or W + N - NW (M. Weinberger et al., LOCO-I, 2000)
//   mean    (3 W + WW + 2 N + NE + NW) / 8
//
// A residual counts steps: value = prediction + step * residual, kept within [1, top]. Where a
// pixel has no reading its left neighbour's value stands in for it in predictions.
//
// Io is the encoder's or the decoder's side:
//   unsigned kind(int context, int block)         block: index in the stripe
//   bool     valid(int context, int pixel)        has a reading
//   Coded    spatial(int context, int pixel, int prediction)
//   Coded    temporal(int context, int pixel, int before, prediction)   may switch, then calls
//                                                                       prediction()
//   bool     bad()                                what was read can not be
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>
#include <vector>

namespace drivers::codec {

inline constexpr int kBlock = 8;

enum class Validity : unsigned { kAsBefore, kAll, kMixed };
enum class Prediction : unsigned { kCopy, kTime, kPlane, kEdge, kMean };
inline constexpr unsigned kEmptyBlock = 0, kSameBlock = 1, kBlockKinds = 16;
[[nodiscard]] constexpr unsigned block_kind(Validity v, Prediction p) noexcept {
  return 1 + 5 * static_cast<unsigned>(v) + static_cast<unsigned>(p);
}
static_assert(block_kind(Validity::kAsBefore, Prediction::kCopy) == kSameBlock);
static_assert(block_kind(Validity::kMixed, Prediction::kMean) == kBlockKinds - 1);

// Contexts of residuals: by the size of the neighbours', in space, then in time, then alone.
inline constexpr int kSizes = 10;
inline constexpr int kSpaceContext = 0, kTimeContext = kSizes, kAloneContext = 2 * kSizes,
                     kKindContext = kAloneContext + 1, kContexts = kKindContext + 9,
                     kBitContexts = 64;
inline constexpr int kMostSize = 31;  // sizes count up to here
inline constexpr std::array<std::uint8_t, 6 * kMostSize + 1> kSizeOf = [] {
  std::array<std::uint8_t, 6 * kMostSize + 1> t{};
  constexpr std::array<int, kSizes - 1> kFrom{1, 2, 3, 5, 7, 10, 15, 25, 50};
  for (std::size_t i = 0; i < t.size(); ++i) {
    for (const int from : kFrom)
      t[i] = static_cast<std::uint8_t>(t[i] + (static_cast<int>(i) >= from));
  }
  return t;
}();

struct Coded {
  int value;  // point of the lattice
  int size;   // |residual|, at most kMostSize
};

struct StripeShape {
  int width = 0, rows = 0;            // px, multiples of kBlock
  int used_width = 0, used_rows = 0;  // of them of the image; the rest never has a reading
  [[nodiscard]] int blocks_wide() const noexcept { return width / kBlock; }
  [[nodiscard]] std::size_t plain_bytes() const noexcept {
    return 1 + 2 * static_cast<std::size_t>(used_width) * static_cast<std::size_t>(used_rows);
  }
  [[nodiscard]] int blocks() const noexcept { return blocks_wide() * (rows / kBlock); }
};

// Blocks of a kind side by side.
struct BlockRun {
  std::uint8_t kind = kEmptyBlock;
  int x0 = 0, x1 = 0;  // px
};

// Rows of values and sizes around the one that is being coded, with margins; and the kinds of the
// blocks that it lies in.
class WalkRows {
 public:
  static constexpr int kMargin = 4;
  explicit WalkRows(int width)
      : length_(static_cast<std::size_t>(width) + 2 * kMargin),
        values_(3 * length_),
        linear_(2 * static_cast<std::size_t>(width)),
        sizes_(2 * length_),
        kinds_(2 * (static_cast<std::size_t>(width) / kBlock + 1)),
        runs_(static_cast<std::size_t>(width) / kBlock) {}

  void begin() noexcept {
    std::fill(values_.begin(), values_.end(), std::uint16_t{0});
    std::fill(sizes_.begin(), sizes_.end(), std::uint16_t{0});
    std::fill(kinds_.begin(), kinds_.end(), static_cast<std::uint8_t>(kSameBlock));
    now = values_.data() + kMargin, up = now + length_, up2 = up + length_;
    size = sizes_.data() + kMargin, size_up = size + length_;
    plane = linear_.data(), mean = plane + linear_.size() / 2;
    kinds = kinds_.data() + 1, kinds_up = kinds + kinds_.size() / 2;
  }
  void begin_row() noexcept {
    for (int i = 1; i <= kMargin; ++i) now[-i] = up[0];
  }
  void end_row(int width, bool first) noexcept {
    for (int i = 0; i < kMargin; ++i) now[width + i] = now[width - 1];
    if (first) std::memcpy(up - kMargin, now - kMargin, length_ * sizeof *now);
    std::uint16_t* const old = up2;
    up2 = up, up = now, now = old;
    std::swap(size, size_up);
  }
  // From `kinds`, of so many blocks.
  void find_runs(int blocks) noexcept {
    run_count_ = 0;
    for (int bx = 0; bx < blocks; ++bx) {
      if (bx == 0 || kinds[bx] != kinds[bx - 1]) runs_[run_count_++] = {kinds[bx], bx * kBlock, 0};
      runs_[run_count_ - 1].x1 = (bx + 1) * kBlock;
    }
  }
  [[nodiscard]] std::span<const BlockRun> runs() const noexcept {
    return {runs_.data(), run_count_};
  }
  // Leaves in plane and mean the part of these predictions that lies in the rows above.
  void predict_rows(int x0, int x1) noexcept;

  std::int32_t *plane = nullptr, *mean = nullptr;
  // Not bytes: a byte may be a part of anything, and the compiler would read all again after each.
  std::uint16_t *now = nullptr, *up = nullptr, *up2 = nullptr;
  std::uint16_t *size = nullptr, *size_up = nullptr;
  std::uint8_t *kinds = nullptr, *kinds_up = nullptr;

 private:
  std::size_t length_;
  std::vector<std::uint16_t> values_;
  std::vector<std::int32_t> linear_;
  std::vector<std::uint16_t> sizes_;
  std::vector<std::uint8_t> kinds_;
  std::vector<BlockRun> runs_;
  std::size_t run_count_ = 0;
};

[[nodiscard]] inline int edge_prediction(int w, int n, int nw) noexcept {
  // Without a jump: which of the three it is, is as good as random.
  return std::max(std::min(w, n), std::min(std::max(w, n), w + n - nw));
}

// The part of the linear predictions that lies in the rows above, `up` and `up2` of the pixel. Of
// the plane, in 64ths: the row above has weights 8 + 4 dx, the one above it -4 + 4 dx, and the row
// itself 19, 14, 11: the least-squares plane of these neighbours, rounded to what still reproduces
// any plane exactly.
struct RowsAbove {
  int plane, mean;
};
[[nodiscard]] inline RowsAbove rows_above(const std::uint16_t* up,
                                          const std::uint16_t* up2) noexcept {
  const int near = up[-2] + up[-1] + up[0] + up[1] + up[2];
  const int far = up2[-2] + up2[-1] + up2[0] + up2[1] + up2[2];
  const int slope = 2 * (up[2] - up[-2] + up2[2] - up2[-2]) + up[1] - up[-1] + up2[1] - up2[-1];
  return {4 * (2 * near - far + slope), 2 * up[0] + up[1] + up[-1]};
}
// With the row itself: the three values to the left.
[[nodiscard]] inline int plane_prediction(int above, int w, int ww, int www) noexcept {
  return (above + 14 * ww + 11 * www + 32 + 19 * w) >> 6;
}
[[nodiscard]] inline int mean_prediction(int above, int w, int ww) noexcept {
  return (above + ww + 4 + 3 * w) >> 3;
}

template <class Io>
class Walk {
 public:
  Walk(const StripeShape& shape, WalkRows& rows, Io& io, std::uint16_t* points,
       const std::uint8_t* history) noexcept
      : shape_(shape), r_(rows), io_(io), points_(points), history_(history) {}

  // False: what was read can not be.
  [[nodiscard]] bool run() noexcept {
    r_.begin();
    for (int by = 0; by * kBlock < shape_.rows; ++by) {
      if (!read_kinds(by)) return false;
      r_.find_runs(shape_.blocks_wide());
      for (int y = by * kBlock; y < (by + 1) * kBlock; ++y) {
        row(y);
        if (io_.bad()) return false;
      }
      std::swap(r_.kinds, r_.kinds_up);
    }
    return true;
  }

 private:
  // What a block's neighbour says of it: unchanged, changed in time, or anew.
  [[nodiscard]] static int kind_class(unsigned kind) noexcept {
    if (kind <= kSameBlock) return 0;
    return (kind - 1) % 5 <= static_cast<unsigned>(Prediction::kTime) ? 1 : 2;
  }

  [[nodiscard]] bool read_kinds(int by) noexcept {
    const int wide = shape_.blocks_wide();
    for (int bx = 0; bx < wide; ++bx) {
      const int context =
          kKindContext + 3 * kind_class(r_.kinds[bx - 1]) + kind_class(r_.kinds_up[bx]);
      const unsigned kind = io_.kind(context, by * wide + bx);
      if (kind >= kBlockKinds) return false;
      r_.kinds[bx] = static_cast<std::uint8_t>(kind);
    }
    return true;
  }

  // All of it in one function: a call for each pixel costs a tenth of the time.
  __attribute__((flatten)) void row(int y) noexcept {
    r_.begin_row();
    first_ = y == 0;
    at_ = y * shape_.width;
    for (const BlockRun& run : r_.runs()) segment(run);
    r_.end_row(shape_.width, first_);
  }

  void segment(const BlockRun& run) noexcept {
    if (run.kind == kEmptyBlock) return empty(run.x0, run.x1);
    if (run.kind == kSameBlock) return same(run.x0, run.x1);
    switch (static_cast<Validity>((run.kind - 1) / 5)) {
      case Validity::kAsBefore:
        return predicted<Validity::kAsBefore>(run);
      case Validity::kAll:
        return predicted<Validity::kAll>(run);
      case Validity::kMixed:
        return predicted<Validity::kMixed>(run);
    }
  }
  template <Validity V>
  void predicted(const BlockRun& run) noexcept {
    switch (static_cast<Prediction>((run.kind - 1) % 5)) {
      case Prediction::kCopy:
        return pixels<V, Prediction::kCopy>(run);
      case Prediction::kTime:
        return pixels<V, Prediction::kTime>(run);
      case Prediction::kPlane:
        return pixels<V, Prediction::kPlane>(run);
      case Prediction::kEdge:
        return pixels<V, Prediction::kEdge>(run);
      case Prediction::kMean:
        return pixels<V, Prediction::kMean>(run);
    }
  }

  void empty(int x0, int x1) noexcept {
    for (int i = x0; i < x1; ++i) {
      points_[at_ + i] = 0;
      set(i, 0, 0);
    }
  }
  // Most blocks of a camera at rest, and most of these have every reading: eight pixels at a time.
  void same(int x0, int x1) noexcept {
    const std::uint16_t* const row = points_ + at_;
    for (int x = x0; x < x1; x += kBlock) {
      if (any_zero(row + x)) {
        for (int i = x; i < x + kBlock; ++i) set(i, row[i], 0);
        continue;
      }
      std::memcpy(r_.now + x, row + x, kBlock * sizeof *row);
      std::fill_n(r_.size + x, kBlock, std::uint16_t{0});
    }
  }
  [[nodiscard]] static bool any_zero(const std::uint16_t* eight) noexcept {
    constexpr std::uint64_t kOnes = 0x0001000100010001U, kTops = kOnes << 15U;
    std::array<std::uint64_t, 2> w{};
    std::memcpy(w.data(), eight, sizeof w);
    // The lowest part that is zero borrows and sets its top bit; above one that is not, no part
    // has lent anything.
    return ((((w[0] - kOnes) & ~w[0]) | ((w[1] - kOnes) & ~w[1])) & kTops) != 0;
  }
  void set(int x, int value, int size) noexcept {
    r_.now[x] = value != 0 ? static_cast<std::uint16_t>(value) : r_.now[x - 1];
    r_.size[x] = static_cast<std::uint16_t>(size);
  }

  // What lies left of a pixel. Held by value: what was stored just now is slow to be read again,
  // and each pixel waits for the one before.
  struct Left {
    std::int32_t w, ww, www;
    int size;
  };

  template <Validity V, Prediction P>
  void pixels(const BlockRun& run) noexcept {
    constexpr bool kLinear = P == Prediction::kPlane || P == Prediction::kMean;
    if constexpr (kLinear) r_.predict_rows(run.x0, run.x1);
    const std::uint16_t* const now = r_.now + run.x0;
    Left left{now[-1], now[-2], now[-3], r_.size[run.x0 - 1]};
    for (int x = run.x0; x < run.x1; ++x) {
      const int before = points_[at_ + x];
      bool valid = true;
      if constexpr (V == Validity::kAsBefore) valid = before != 0;
      if constexpr (V == Validity::kMixed) valid = io_.valid(validity_context(x), at_ + x);
      if (!valid) {
        points_[at_ + x] = 0;
        set(x, 0, 0);
        left = {left.w, left.w, left.ww, 0};
        continue;
      }
      const Coded c = pixel<P>(x, before, left);
      left = {c.value, left.w, left.ww, c.size};
      points_[at_ + x] = r_.now[x] = static_cast<std::uint16_t>(c.value);
      r_.size[x] = static_cast<std::uint16_t>(c.size);
    }
  }

  // What lies outside of the stripe has no reading.
  [[nodiscard]] int validity_context(int x) const noexcept {
    const std::uint16_t* const at = points_ + at_ + x;
    const int w = shape_.width;
    int there = x > 0 && at[-1] != 0 ? 1 : 0;
    if (!first_) {
      there |= (at[-w] != 0 ? 2 : 0) | (x + 1 < w && at[1 - w] != 0 ? 4 : 0) |
               (x > 0 && at[-1 - w] != 0 ? 8 : 0);
    }
    return there | (history_[at_ + x] & 3) << 4;
  }
  [[nodiscard]] int size_context(int x, const Left& left) const noexcept {
    return kSizeOf[static_cast<std::size_t>(2 * left.size + 2 * r_.size_up[x] + r_.size_up[x - 1] +
                                            r_.size_up[x + 1])];
  }
  [[nodiscard]] int edge(int x, const Left& left) const noexcept {
    return first_ ? left.w : edge_prediction(left.w, r_.up[x], r_.up[x - 1]);
  }

  template <Prediction P>
  [[nodiscard]] Coded pixel(int x, int before, const Left& left) noexcept {
    if constexpr (P == Prediction::kCopy) {
      if (before != 0) return {before, 0};
      return io_.spatial(kAloneContext, at_ + x, edge(x, left));
    } else if constexpr (P == Prediction::kTime) {
      if (before == 0) return io_.spatial(kAloneContext, at_ + x, edge(x, left));
      return io_.temporal(kTimeContext + size_context(x, left), at_ + x, before,
                          [&] { return edge(x, left); });
    } else {
      int prediction = 0;
      if (P == Prediction::kEdge || first_) {
        prediction = edge(x, left);
      } else if (P == Prediction::kPlane) {
        prediction = plane_prediction(r_.plane[x], left.w, left.ww, left.www);
      } else {
        prediction = mean_prediction(r_.mean[x], left.w, left.ww);
      }
      return io_.spatial(kSpaceContext + size_context(x, left), at_ + x, prediction);
    }
  }

  StripeShape shape_;
  WalkRows& r_;
  Io& io_;
  std::uint16_t* points_;
  const std::uint8_t* history_;
  int at_ = 0;  // index of the row's first pixel
  bool first_ = false;
};

}  // namespace drivers::codec
