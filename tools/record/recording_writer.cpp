#include "tools/record/recording_writer.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <utility>

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

void write_text(const std::string& path, const std::string& text) {
  std::ofstream out(path);
  out << text;
  if (!out.flush()) throw std::runtime_error(path + ": can not be written");
}

}  // namespace

RecordingWriter::RecordingWriter(std::string folder) : folder_(std::move(folder)) {
  std::filesystem::create_directories(folder_ + "/depth");
  std::filesystem::create_directories(folder_ + "/rgb");
}

void RecordingWriter::add(const perception::RgbdFrame& frame, const std::string& stamp) {
  intrinsics_ = frame.intrinsics;
  const auto& k = intrinsics_;
  char name[40];
  std::snprintf(name, sizeof name, "%06d.png", count_++);
  lists_ += stamp + " rgb/" + name + " " + stamp + " depth/" + name + "\n";
  write_image(
      folder_ + "/depth/" + name,
      cv::Mat(k.height, k.width, CV_16UC1, const_cast<std::uint16_t*>(frame.depth_mm.data())));
  cv::Mat colour(k.height, k.width, CV_8UC3, cv::Scalar(128, 128, 128));
  for (int v = 0; frame.has_colour && v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const perception::Rgb c = frame.rgb().at(u, v);
      colour.at<cv::Vec3b>(v, u) = {c.b, c.g, c.r};
    }
  }
  write_image(folder_ + "/rgb/" + name, colour);
}

void RecordingWriter::finish() {
  const auto& k = intrinsics_;
  char lens[200];
  std::snprintf(lens, sizeof lens, "%.17g %.17g %.17g %.17g %d %d 1000\n", k.fx, k.fy, k.cx, k.cy,
                k.width, k.height);
  write_text(folder_ + "/associations.txt", lists_);
  write_text(folder_ + "/intrinsics.txt", lens);
}

void write_recording(const FusionSequence& sequence, const std::string& folder, bool backwards) {
  RecordingWriter writer(folder);
  auto frame = std::make_unique<perception::RgbdFrame>();
  std::string poses;
  bool all_known = true;
  for (int i = 0; i < sequence.size(); ++i) {
    const int shown = backwards ? sequence.size() - 1 - i : i;
    sequence.frame(shown, *frame);
    const double t_s = 1e-9 * static_cast<double>(rt::ns_of(sequence.exposure(i)));
    char stamp[40];
    std::snprintf(stamp, sizeof stamp, "%.6f", t_s);
    writer.add(*frame, stamp);
    const perception::Pose* truth = sequence.truth(shown);
    all_known = all_known && truth != nullptr;
    if (truth != nullptr) poses += pose_line(t_s, *truth);
  }
  writer.finish();
  if (all_known && !poses.empty()) write_text(folder + "/groundtruth.txt", poses);
}

}  // namespace teletact
