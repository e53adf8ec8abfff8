// OpenCV's rgbd parts as a dense mapper: FastICPOdometry against the ray cast of a Volume, which is
// what cv::kinfu does and what Debian's build of the module still offers (KinFu::create itself
// throws there).
//
//   teletact_peer_opencv FRAMES KIND VOXEL_M EDGE     KIND: tsdf or hashtsdf
//
// FRAMES: a line "width height fx fy cx cy count", then depth in mm, uint16, image after image. For
// each index on stdin one line on stdout: index, CPU ms of the whole process, 1 or 0 (tracked),
// R_WC row by row, t_WC. One thread, no OpenCL; bilateral filter on (it is part of
// FastICPOdometry).
#include <ctime>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/core/ocl.hpp>
#include <opencv2/rgbd.hpp>
#include <opencv2/rgbd/volume.hpp>

namespace {

struct Frames {
  int width = 0, height = 0, count = 0;
  float fx = 0, fy = 0, cx = 0, cy = 0;
  std::vector<std::uint16_t> depth_mm;
};

Frames read_frames(const char* path) {
  Frames f;
  std::ifstream in(path, std::ios::binary);
  std::string line;
  std::getline(in, line);
  std::istringstream words(line);
  words >> f.width >> f.height >> f.fx >> f.fy >> f.cx >> f.cy >> f.count;
  const auto pixels = static_cast<std::size_t>(f.width) * static_cast<std::size_t>(f.height) *
                      static_cast<std::size_t>(f.count);
  f.depth_mm.resize(pixels);
  if (!words || !in.read(reinterpret_cast<char*>(f.depth_mm.data()),
                         static_cast<std::streamsize>(2 * pixels))) {
    std::fprintf(stderr, "teletact_peer_opencv: %s can not be read\n", path);
    std::exit(1);
  }
  return f;
}

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

cv::Mat depth_m(const Frames& f, int i) {
  cv::Mat out(f.height, f.width, CV_32F);
  const std::uint16_t* in = f.depth_mm.data() + static_cast<std::size_t>(i) * out.total();
  auto* m = out.ptr<float>();
  for (std::size_t p = 0; p < out.total(); ++p)
    m[p] = in[p] > 5000 ? 0.0F : 1e-3F * static_cast<float>(in[p]);
  return out;
}

// z of the ray cast's points; 0 where nothing was hit.
cv::Mat z_of(const cv::Mat& points) {
  cv::Mat z(points.size(), CV_32F);
  for (int v = 0; v < points.rows; ++v) {
    const auto* p = points.ptr<cv::Vec4f>(v);
    auto* out = z.ptr<float>(v);
    for (int u = 0; u < points.cols; ++u) out[u] = p[u][2] > 0 ? p[u][2] : 0.0F;
  }
  return z;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: teletact_peer_opencv FRAMES tsdf|hashtsdf VOXEL_M EDGE\n");
    return 2;
  }
  cv::setNumThreads(1);
  cv::ocl::setUseOpenCL(false);
  const Frames frames = read_frames(argv[1]);
  const bool hash = std::strcmp(argv[2], "hashtsdf") == 0;
  const float voxel = std::stof(argv[3]);
  const int edge = std::stoi(argv[4]);
  const float side = voxel * static_cast<float>(edge);
  const cv::Matx33f K(frames.fx, 0, frames.cx, 0, frames.fy, frames.cy, 0, 0, 1);
  const cv::kinfu::Intr intrinsics(K);
  cv::Matx44f corner =
      cv::Matx44f::eye();  // the camera stands in the middle of the cube's near face
  corner(0, 3) = corner(1, 3) = -side / 2;
  constexpr float kTruncation_m = 0.05F;
  const auto volume = cv::kinfu::makeVolume(
      hash ? cv::kinfu::VolumeType::HASHTSDF : cv::kinfu::VolumeType::TSDF, voxel, corner, 0.25F,
      kTruncation_m, 64, 5.0F, cv::Vec3i(edge, edge, edge));
  const auto icp = cv::rgbd::FastICPOdometry::create(
      cv::Mat(K), 0.1F, static_cast<float>(CV_PI / 6), 0.04F, 4.5F, 7, {4, 5, 15});
  cv::Matx44f pose = cv::Matx44f::eye();
  cv::Mat model;
  const cv::Size size(frames.width, frames.height);
  for (int i = 0; std::cin >> i;) {
    const cv::Mat depth = depth_m(frames, i);
    const double begin = cpu_ms();
    bool tracked = true;
    if (!model.empty()) {
      auto live = cv::rgbd::OdometryFrame::create(cv::Mat(), depth);
      auto seen = cv::rgbd::OdometryFrame::create(cv::Mat(), model);
      cv::Mat step;
      tracked = icp->compute(live, seen, step);
      if (tracked) pose = pose * cv::Matx44f(cv::Matx44d(step));
    }
    if (tracked) {
      volume->integrate(depth, 1.0F, pose, intrinsics, i);
      cv::Mat points, normals;
      volume->raycast(pose, intrinsics, size, points, normals);
      model = z_of(points);
    }
    const double ms = cpu_ms() - begin;
    std::printf("%d %.4f %d", i, ms, tracked ? 1 : 0);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) std::printf(" %.9g", static_cast<double>(pose(r, c)));
    std::printf(" %.9g %.9g %.9g\n", static_cast<double>(pose(0, 3)),
                static_cast<double>(pose(1, 3)), static_cast<double>(pose(2, 3)));
    std::fflush(stdout);
  }
  return 0;
}
