#include "tools/record/recording_writer.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "rt/clock/box_time.hpp"

namespace teletact {

namespace {

void write_image(const std::string& path, const cv::Mat& image) {
  // A low level: the images are read once or twice.
  if (!cv::imwrite(path, image, {cv::IMWRITE_PNG_COMPRESSION, 2}))
    throw std::runtime_error(path + ": can not be written");
}

std::string pose_line(double t_s, const perception::Pose& X_WC) {
  const Eigen::Quaterniond q(X_WC.linear());
  const perception::Vec3 p = X_WC.translation();
  char line[240];
  std::snprintf(line, sizeof line, "%.6f %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", t_s, p.x(), p.y(),
                p.z(), q.x(), q.y(), q.z(), q.w());
  return line;
}

}  // namespace

void write_recording(const FusionSequence& sequence, const std::string& folder, bool backwards) {
  namespace fs = std::filesystem;
  fs::create_directories(folder + "/depth");
  fs::create_directories(folder + "/rgb");
  const auto& k = sequence.intrinsics;
  auto frame = std::make_unique<perception::RgbdFrame>();
  std::string lists, poses;
  bool all_known = true;
  for (int i = 0; i < sequence.size(); ++i) {
    const int shown = backwards ? sequence.size() - 1 - i : i;
    sequence.frame(shown, *frame);
    const double t_s = 1e-9 * static_cast<double>(rt::ns_of(sequence.exposure(i)));
    char name[40], line[160];
    std::snprintf(name, sizeof name, "%06d.png", i);
    std::snprintf(line, sizeof line, "%.6f rgb/%s %.6f depth/%s\n", t_s, name, t_s, name);
    lists += line;
    write_image(folder + "/depth/" + name,
                cv::Mat(k.height, k.width, CV_16UC1, frame->depth_mm.data()));
    cv::Mat colour(k.height, k.width, CV_8UC3, cv::Scalar(128, 128, 128));
    for (int v = 0; frame->has_colour && v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const perception::Rgb c = frame->rgb().at(u, v);
        colour.at<cv::Vec3b>(v, u) = {c.b, c.g, c.r};
      }
    }
    write_image(folder + "/rgb/" + name, colour);
    const perception::Pose* truth = sequence.truth(shown);
    all_known = all_known && truth != nullptr;
    if (truth != nullptr) poses += pose_line(t_s, *truth);
  }
  char lens[200];
  std::snprintf(lens, sizeof lens, "%.17g %.17g %.17g %.17g %d %d 1000\n", k.fx, k.fy, k.cx, k.cy,
                k.width, k.height);
  const auto write = [&](const char* name, const std::string& text) {
    std::ofstream out(folder + name);
    out << text;
    if (!out.flush()) throw std::runtime_error(folder + name + ": can not be written");
  };
  write("/associations.txt", lists);
  write("/intrinsics.txt", lens);
  if (all_known && !poses.empty()) write("/groundtruth.txt", poses);
}

}  // namespace teletact
