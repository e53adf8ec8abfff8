// Capture, 30 Hz, firm, robot box: one camera frame in, one encoded frame out.
//
//   sense    RgbdFrame              from drivers/camera  (Camera::poll, outside step)
//   reads    FrameDemand            from the link, where a codec needs its previous frame
//   writes   EncodedFrame           Remote, over the link to fusion (a slot of the edge, filled in
//            place)
//   budget   15 ms of the 33 ms period
//
// With such a codec (CaptureConfig::pictures) a demand is answered by one frame: the newest that
// the camera gave and that was not encoded yet. Without a demand nothing is encoded. Without such a
// codec each frame is, and the link takes the newest.
//
// Levels (dynamic): 0 = colour in every frame; 1 = depth in every frame, colour in every third.
//
// Firm: our own code allocates nothing; JPEG through OpenCV does (Stats::colour_coded counts the
// calls, tests/unit/tasks_capture prints the allocations of one). Method: drivers/link/*_codec.hpp
#pragma once

#include <cstdint>

#include "config/schema.hpp"
#include "drivers/link/frame_codec.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"

namespace tasks {

inline constexpr rt::FaultId kFaultCaptureBadFrame =
    0x0601;  // F-CAP-01: not an image, nothing sent
inline constexpr rt::FaultId kFaultCaptureNoColour = 0x0602;  // F-CAP-02: colour left out

// Section [capture].
struct CaptureConfig {
  drivers::ColourCodecConfig colour;
  drivers::PictureConfig pictures{};  // keys of [link]
  void describe(config::Section& s);
};

class CaptureTask {
 public:
  static constexpr int kLevels = 2;
  static constexpr std::uint64_t kColourEvery = 3;  // at level 1

  struct In {
    const perception::RgbdFrame* frame = nullptr;  // null: the camera has given none yet
    bool fresh = false;                            // it was not seen by an earlier job
    // The newest demand, null: there is none in time; and the newest that a frame was published
    // for. Unused without a codec that needs its previous frame.
    const drivers::FrameDemand* demand = nullptr;
    std::uint64_t answered = 0;
  };
  struct Out {
    drivers::EncodedFrame* slot = nullptr;  // where to encode; given by the executor
    bool written = false;                   // the slot holds a frame to be committed
  };
  struct Stats {
    std::uint64_t frames = 0;         // encoded
    std::uint64_t idle = 0;           // jobs without a fresh frame, or without a demand
    std::uint64_t unasked = 0;        // frames that a newer one replaced before they were encoded
    std::uint64_t colour_coded = 0;   // frames that went through the JPEG library
    std::uint64_t colour_failed = 0;  // F-CAP-02
    std::uint64_t bad_frames = 0;     // F-CAP-01
    std::uint64_t depth_bytes = 0, colour_bytes = 0;
  };

  // camera: of the frames, where a codec needs its previous frame.
  CaptureTask(rt::NonRealtime&, const CaptureConfig& config, rt::Box box = rt::Box::kRobot,
              const perception::Intrinsics& camera = {});

  [[nodiscard]] rt::Health step(const rt::Tick& tick, const In& in, Out& out) noexcept;
  // What the last step() encoded was not published: the next frame is a key.
  void lost() noexcept;
  [[nodiscard]] const Stats& stats() const noexcept { return stats_; }

 private:
  drivers::FrameCodecScratch scratch_;
  rt::Box box_;
  bool on_demand_;
  bool waiting_ = false;  // the newest frame was not encoded yet
  Stats stats_;
};

}  // namespace tasks
