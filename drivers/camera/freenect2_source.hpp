// Kinect v2 through libfreenect2 (github.com/OpenKinect/libfreenect2; not in Debian 12). Its
// interface is C++, so it can not be loaded by name at run time. It is looked for when the program
// is configured; without it open() reports that this program was built without it.
//
// Depth is 512 x 424 in mm as the library decodes it, rounded. libfreenect2::Registration removes
// the lens distortion and registers the colour to the depth.
#pragma once

#include <memory>
#include <string>

#include "config/schema.hpp"
#include "drivers/camera/grabbed_camera.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers {

// Section [camera.freenect2].
struct Freenect2Config {
  std::string serial;  // empty: the first one that is found
  bool colour = true;
  void describe(config::Section& s);
};

// Built with libfreenect2?
[[nodiscard]] bool has_freenect2() noexcept;

// Opens and starts the device; an error is one line that says what is missing. `lens`: the
// intrinsics stated with each frame; 512 x 424.
[[nodiscard]] rt::Result<std::unique_ptr<FrameSource>> open_freenect2(
    rt::NonRealtime&, const Freenect2Config& config, const perception::Intrinsics& lens);

}  // namespace drivers
