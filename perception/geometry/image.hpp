// Images: a non-owning view, and an owner whose capacity is fixed at construction.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace perception {

template <class T>
struct ImageView {
  T* data = nullptr;
  int width = 0, height = 0;
  int stride = 0;  // in elements

  [[nodiscard]] T& at(int u, int v) const noexcept {
    return data[static_cast<std::ptrdiff_t>(v) * stride + u];
  }
  [[nodiscard]] T* row(int v) const noexcept {
    return data + static_cast<std::ptrdiff_t>(v) * stride;
  }
  [[nodiscard]] bool contains(int u, int v) const noexcept {
    return u >= 0 && v >= 0 && u < width && v < height;
  }
  operator ImageView<const T>() const noexcept { return {data, width, height, stride}; }  // NOLINT
};

template <class T>
class Image {
 public:
  Image() = default;
  Image(int width, int height, const T& fill = T{})
      : width_(width),
        height_(height),
        pixels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), fill) {}

  // Changes the shape without allocating; the product must not exceed the constructed size.
  void reshape(int width, int height) noexcept { width_ = width, height_ = height; }
  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  [[nodiscard]] T* data() noexcept { return pixels_.data(); }
  [[nodiscard]] const T* data() const noexcept { return pixels_.data(); }
  [[nodiscard]] ImageView<T> view() noexcept { return {pixels_.data(), width_, height_, width_}; }
  [[nodiscard]] ImageView<const T> view() const noexcept {
    return {pixels_.data(), width_, height_, width_};
  }
  [[nodiscard]] T& at(int u, int v) noexcept { return view().at(u, v); }
  [[nodiscard]] const T& at(int u, int v) const noexcept { return view().at(u, v); }

 private:
  int width_ = 0, height_ = 0;
  std::vector<T> pixels_;
};

}  // namespace perception
