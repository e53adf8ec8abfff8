// The readers of outside files that `teletact bench fuzz` feeds: images, recordings, odometry,
// fields, maps, job records; the link's messages, colour pictures and frames of the depth stream;
// the road's frames and certificates; what comes over the robot's bus; what a page sends and asks
// for.
#pragma once

#include <filesystem>
#include <vector>

#include "tools/measure/bench/fuzz.hpp"

namespace teletact {

// Readers that open files by name get theirs in a folder of this object's, which it removes.
class FuzzReaders {
 public:
  FuzzReaders();
  ~FuzzReaders();
  FuzzReaders(const FuzzReaders&) = delete;
  FuzzReaders& operator=(const FuzzReaders&) = delete;
  [[nodiscard]] const std::vector<FuzzReader>& all() const { return readers_; }

 private:
  void add_images();
  void add_recording();
  void add_layouts();
  void add_tables();
  void add_map();
  void add_colour();
  void add_depth_stream();
  void add_depth_lossless();
  void add_store();
  void add_link();
  void add_road();
  void add_bus();
  void add_bus_replies();
  void add_desk();
  void add_console();
  std::filesystem::path folder_;
  std::vector<FuzzReader> readers_;
};

}  // namespace teletact
