// Clicks on a picture become a proposed object (perception/segmentation/click_segmenter.hpp), by a
// thread of its own: one click takes tenths of a second, which neither the console's thread nor any
// task may wait for. What is proposed is shown and moves nothing. Only what is accepted becomes an
// input of a task (desk_objects.hpp), so a replay needs no clicks.
//
// Bounded: kMostWaiting clicks wait. Before the first click nothing is allocated, no thread runs.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "perception/geometry/rgbd_frame.hpp"
#include "perception/objects/given_object.hpp"
#include "perception/segmentation/click_segmenter.hpp"
#include "tools/desk/desk_thread.hpp"

namespace teletact {

struct ClickRequest {
  std::uint32_t session = 0;
  std::int64_t id = 0;
  std::uint64_t round = 0;  // given back in the answer
  // With the first click of an object: its picture, and where the camera was.
  std::shared_ptr<const perception::RgbdFrame> frame;
  perception::Pose X_WC = perception::Pose::Identity();
  bool claimed = false;  // that place is trusted
  double u = 0, v = 0;   // 0 to 1 of the picture
  bool add = true;
};

// Of one picture: what the clicks on it say so far.
struct Proposal {
  std::uint32_t number = 0;  // from 1 on, never used again
  rt::Time exposure{};
  int width = 0, height = 0;
  std::vector<std::uint8_t> mask;  // a byte a pixel, row-major; 1: of the object
  int pixels = 0, clicks = 0;
  bool claimed = false;
  perception::GivenObject object;  // no boxes: hardly anything of it was measured
};

struct ClickAnswered {
  std::uint32_t session = 0;
  std::int64_t id = 0;
  std::uint64_t round = 0;
  std::string why;  // empty: proposed
  std::shared_ptr<const Proposal> proposal;
};

class ClickWorker {
 public:
  static constexpr std::size_t kMostWaiting = 8;

  // `at_once`: put() itself does the work. For runs that must be the same each time.
  explicit ClickWorker(bool at_once)
      : thread_(kMostWaiting, at_once, AtEnd::kDropped,
                [this](ClickRequest request) { return answer(request); }) {}
  ClickWorker(const ClickWorker&) = delete;
  ClickWorker& operator=(const ClickWorker&) = delete;

  // As many wait as may. One thread asks and puts.
  [[nodiscard]] bool full() { return thread_.full(); }
  // Lost when full().
  void put(ClickRequest request) { static_cast<void>(thread_.put(std::move(request))); }
  [[nodiscard]] std::vector<ClickAnswered> take() { return thread_.take(); }

 private:
  [[nodiscard]] ClickAnswered answer(const ClickRequest& request);
  [[nodiscard]] std::string segment(const ClickRequest& request);
  [[nodiscard]] std::shared_ptr<const Proposal> propose();

  // By the thread alone.
  std::unique_ptr<perception::ClickSegmenter> segmenter_;
  std::shared_ptr<const perception::RgbdFrame> frame_;
  perception::Pose X_WC_ = perception::Pose::Identity();
  bool claimed_ = false;
  int width_ = 0, height_ = 0;  // that the segmenter was made for
  std::vector<perception::Click> clicks_;
  std::uint32_t number_ = 0;
  DeskThread<ClickRequest, ClickAnswered> thread_;
};

}  // namespace teletact
