// A small TUM folder written for a test, so that each part of it can be spoilt.
#pragma once

#include <unistd.h>
#include <filesystem>
#include <fstream>
#include <string>

#include <opencv2/imgcodecs.hpp>

namespace camera_test {

class TumFolder {
 public:
  static constexpr int kWidth = 32, kHeight = 24;

  explicit TumFolder(int frames = 5, double period_s = 1.0 / 30) {
    static int serial = 0;
    path_ = std::filesystem::temp_directory_path() /
            ("teletact_tum_" + std::to_string(::getpid()) + "_" + std::to_string(serial++));
    std::filesystem::create_directories(path_ / "depth");
    std::filesystem::create_directories(path_ / "rgb");
    write("intrinsics.txt",
          "# fx fy cx cy width height depth_units_per_metre\n30 31 15.5 11.5 32 24 1000\n");
    std::string list = "# t rgb t depth\n";
    for (int i = 0; i < frames; ++i) {
      const std::string name = std::to_string(i);
      cv::Mat depth(kHeight, kWidth, CV_16UC1);
      cv::Mat colour(kHeight, kWidth, CV_8UC3, cv::Scalar(10, 20, 30 + i));
      for (int v = 0; v < kHeight; ++v) {
        for (int u = 0; u < kWidth; ++u) depth.at<std::uint16_t>(v, u) = value(i, u, v);
      }
      cv::imwrite(file("depth/" + name + ".png"), depth);
      cv::imwrite(file("rgb/" + name + ".png"), colour);
      const std::string stamp = std::to_string(100 + i * period_s);
      list.append(stamp).append(" rgb/").append(name).append(".png ");
      list.append(stamp).append(" depth/").append(name).append(".png\n");
    }
    write("associations.txt", list);
  }
  ~TumFolder() { std::filesystem::remove_all(path_); }
  TumFolder(const TumFolder&) = delete;
  TumFolder& operator=(const TumFolder&) = delete;

  // What the depth file holds: some empty, one saturated.
  static std::uint16_t value(int frame, int u, int v) {
    if (u == 3) return 0;
    if (u == 4) return 65535;
    return static_cast<std::uint16_t>(500 + 100 * frame + 10 * u + v);
  }
  [[nodiscard]] std::string path() const { return path_.string(); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path_ / name).string(); }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name)) << text;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace camera_test
