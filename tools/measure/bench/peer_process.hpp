// A mapper of another project in a process of its own, asked for one frame at a time, so that
// nobody runs while another is measured. Protocol: tools/measure/bench/peer/opencv_peer.cpp.
#pragma once

#include <sys/types.h>

#include <cstdio>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

// The frames as the peers read them; removed with the object. Throws std::runtime_error.
class PeerFrames {
 public:
  explicit PeerFrames(const FusionSequence& sequence);
  ~PeerFrames();
  PeerFrames(const PeerFrames&) = delete;
  PeerFrames& operator=(const PeerFrames&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// The program that runs Open3D; it lies in the source tree.
std::string open3d_peer();

class PeerProcess {
 public:
  struct Reply {
    double cpu_ms = 0;
    bool tracked = false;
    perception::Pose X_WC = perception::Pose::Identity();
  };
  explicit PeerProcess(const std::vector<std::string>& command);
  ~PeerProcess();
  PeerProcess(const PeerProcess&) = delete;
  PeerProcess& operator=(const PeerProcess&) = delete;
  // False: it does not run (any more).
  [[nodiscard]] bool ask(int frame, Reply& reply);
  // Once it does not: how it ended.
  [[nodiscard]] std::string ending();

 private:
  pid_t pid_ = -1;
  std::FILE *to_ = nullptr, *from_ = nullptr;
};

}  // namespace teletact
