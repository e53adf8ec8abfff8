// Real cameras without hardware: OpenNI 2 with the library's own dummy device where it is
// installed, the Kinect v2 code against a stand-in for its library; and what is said when something
// is missing.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>

#include "drivers/camera/camera_choice.hpp"
#include "libfreenect2/libfreenect2.hpp"
#include "tests/support/tsan_libraries.hpp"
#if __has_include(<openni2/OniCAPI.h>)
#include <openni2/OniCEnums.h>
#include <openni2/OniCProperties.h>
#include <openni2/OniCTypes.h>
#include <openni2/OniVersion.h>
#define HAVE_ONI_HEADERS 1
#endif

#ifdef __SANITIZE_ADDRESS__
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libOpenNI2.so\nleak:OpenNI2/Drivers/\n";
}
#endif

namespace drivers {
namespace {

using perception::Intrinsics;
using perception::RgbdFrame;
using testing::HasSubstr;

// OpenNI 2 and the drivers it loads keep what they allocated when they are unloaded. A sanitizer
// can leave that out only while the libraries are still there to be named, so none of them is
// unloaded in these tests.
class OpenNi2 : public testing::Test {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
 protected:
  static void SetUpTestSuite() {
    void* const library = ::dlopen("libOpenNI2.so.0", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    Dl_info info{};
    if (library == nullptr || ::dladdr(::dlsym(library, "oniInitialize"), &info) == 0) return;
    const auto drivers = std::filesystem::path(info.dli_fname).parent_path() / "OpenNI2/Drivers";
    for (const auto& file : std::filesystem::directory_iterator(drivers))
      if (file.path().extension() == ".so")
        ::dlopen(file.path().c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  }
#endif
};

std::string refusal(const CameraChoice& choice) {
  rt::Startup startup;
  std::string said;
  try {
    static_cast<void>(open_camera(
        startup.token(), choice, [] { return rt::Time{}; }, said));
  } catch (const std::runtime_error& e) {
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << "one line";
    return e.what();
  }
  return "opened";
}

TEST_F(OpenNi2, SaysWhatIsMissing) {
  CameraChoice choice;
  choice.kind = "openni2";
  choice.openni2.library = "/nowhere/libOpenNI2.so";
  EXPECT_THAT(refusal(choice), HasSubstr("libopenni2-0"));
  EXPECT_THAT(refusal(choice), HasSubstr("/nowhere/libOpenNI2.so"));
  choice.openni2.library = "libm.so.6";
  EXPECT_THAT(refusal(choice), HasSubstr("libm.so.6 lacks the function oniInitialize"));
}

bool have_openni2() {
  void* handle = ::dlopen("libOpenNI2.so.0", RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) return false;
  ::dlclose(handle);
  return true;
}

CameraChoice dummy() {
  CameraChoice choice;
  choice.kind = "openni2";
  choice.openni2.uri = "Dummy";
  choice.lens.width_px = 320, choice.lens.height_px = 240;
  return choice;
}

TEST_F(OpenNi2, RefusesWhatIsNotThere) {
  if (!have_openni2()) GTEST_SKIP() << "libopenni2-0 is not installed";
  CameraChoice choice = dummy();
  choice.openni2.uri = "no such device";
  EXPECT_THAT(refusal(choice), HasSubstr("no device 'no such device'"));
  choice.openni2.uri = "/nowhere/recording.oni";
  EXPECT_THAT(refusal(choice), HasSubstr("/nowhere/recording.oni"));
  choice = dummy();
  choice.lens.width_px = 640, choice.lens.height_px = 480;
  EXPECT_THAT(refusal(choice), HasSubstr("640 x 480"));
}

// The dummy device that comes with the library: 320 x 240 at 30 Hz.
TEST_F(OpenNi2, FramesOfTheDummyDevice) {
  if (!have_openni2()) GTEST_SKIP() << "libopenni2-0 is not installed";
  for (const bool colour : {false, true}) {
    CameraChoice choice = dummy();
    choice.openni2.colour = colour;
    rt::Startup startup;
    auto opened = OpenNi2Source::open(startup.token(), choice.openni2, choice.intrinsics());
    ASSERT_TRUE(opened) << opened.error();
    FrameSource& source = *opened.value();
    std::printf("  %s\n", source.description().c_str());
    EXPECT_EQ(source.rate_hz(), 30);
    auto frame = std::make_unique<RgbdFrame>();
    int frames = 0, readings = 0;
    for (int n = 0; n < 50 && frames < 5; ++n) {
      frame->depth_mm.fill(7);
      const CameraStatus status = source.wait_frame(1000, *frame);
      ASSERT_NE(status, CameraStatus::kFault);
      if (status != CameraStatus::kFrame) continue;
      ++frames;
      EXPECT_EQ(frame->intrinsics, choice.intrinsics());
      for (std::size_t i = 0; i < 320 * 240; ++i) readings += frame->depth_mm[i] == 2000 ? 1 : 0;
      EXPECT_EQ(frame->depth_mm[320 * 240], 7) << "not beyond the image";
    }
    EXPECT_EQ(frames, 5);
    EXPECT_GT(readings, 0) << "the dummy's pattern is of 2 m";
  }
}

#ifdef HAVE_ONI_HEADERS
template <class A, class B>
constexpr bool same_layout = sizeof(A) == sizeof(B) && alignof(A) == alignof(B);

TEST_F(OpenNi2, LayoutsAreThoseOfTheLibrary) {
  namespace o = openni2;
  static_assert(same_layout<o::VideoMode, OniVideoMode>);
  static_assert(same_layout<o::Frame, OniFrame>);
  static_assert(same_layout<o::DeviceInfo, OniDeviceInfo>);
  EXPECT_EQ(offsetof(o::Frame, data), offsetof(OniFrame, data));
  EXPECT_EQ(offsetof(o::Frame, timestamp_us), offsetof(OniFrame, timestamp));
  EXPECT_EQ(offsetof(o::Frame, width), offsetof(OniFrame, width));
  EXPECT_EQ(offsetof(o::Frame, mode), offsetof(OniFrame, videoMode));
  EXPECT_EQ(offsetof(o::Frame, stride), offsetof(OniFrame, stride));
  EXPECT_EQ(offsetof(o::VideoMode, width), offsetof(OniVideoMode, resolutionX));
  EXPECT_EQ(offsetof(o::VideoMode, fps), offsetof(OniVideoMode, fps));
  EXPECT_EQ(offsetof(o::DeviceInfo, name), offsetof(OniDeviceInfo, name));
  EXPECT_EQ(o::kApiVersion, ONI_API_VERSION);
  EXPECT_EQ(o::kSensorDepth, ONI_SENSOR_DEPTH);
  EXPECT_EQ(o::kSensorColour, ONI_SENSOR_COLOR);
  EXPECT_EQ(o::kFormatDepth1mm, ONI_PIXEL_FORMAT_DEPTH_1_MM);
  EXPECT_EQ(o::kFormatDepth100um, ONI_PIXEL_FORMAT_DEPTH_100_UM);
  EXPECT_EQ(o::kFormatRgb888, ONI_PIXEL_FORMAT_RGB888);
  EXPECT_EQ(o::kStatusTimeOut, ONI_STATUS_TIME_OUT);
  EXPECT_EQ(o::kRegistrationDepthToColour, ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR);
  EXPECT_EQ(o::kDeviceImageRegistration, ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION);
  EXPECT_EQ(o::kStreamVideoMode, ONI_STREAM_PROPERTY_VIDEO_MODE);
  EXPECT_EQ(o::kStreamMirroring, ONI_STREAM_PROPERTY_MIRRORING);
  EXPECT_EQ(o::kStreamHorizontalFov, ONI_STREAM_PROPERTY_HORIZONTAL_FOV);
  EXPECT_EQ(o::kStreamVerticalFov, ONI_STREAM_PROPERTY_VERTICAL_FOV);
}
#endif

// ---- Kinect v2, against the stand-in

CameraChoice kinect2() {
  CameraChoice choice;
  choice.kind = "freenect2";
  return choice;
}

TEST(Freenect2, SaysWhatIsMissing) {
  auto& fake = libfreenect2::fake();
  fake = {};
  CameraChoice choice = kinect2();
  choice.freenect2.serial = "000815";
  EXPECT_THAT(refusal(choice), HasSubstr("no device '000815'; found: 004711"));
  fake.serials.clear();
  EXPECT_THAT(refusal(kinect2()), HasSubstr("no device; found: none"));
  fake = {};
  fake.starts = false;
  EXPECT_THAT(refusal(kinect2()), HasSubstr("004711 does not start"));
  EXPECT_EQ(fake.closed, 1) << "what was opened is closed";
  choice = kinect2();
  choice.lens.width_px = 640;
  EXPECT_THAT(refusal(choice), HasSubstr("640 x 424"));
}

TEST(Freenect2, DepthInMillimetresColourInOrder) {
  auto& fake = libfreenect2::fake();
  fake = {};
  fake.depth.assign(512 * 424, 1234.2F);  // undistorted: 1234.3
  fake.depth[0] = 0;
  fake.depth[1] = std::numeric_limits<float>::quiet_NaN();
  fake.depth[2] = std::numeric_limits<float>::infinity();
  fake.depth[3] = -5;
  fake.depth[4] = 999.45F;  // 999.55: rounds up
  for (const bool colour : {true, false}) {
    rt::Startup startup;
    CameraChoice choice = kinect2();
    choice.freenect2.colour = colour;
    auto opened = open_freenect2(startup.token(), choice.freenect2, choice.intrinsics());
    ASSERT_TRUE(opened) << opened.error();
    EXPECT_THAT(opened.value()->description(), HasSubstr("004711"));
    EXPECT_THAT(opened.value()->description(), HasSubstr("fx 366.10"));
    EXPECT_EQ(fake.listened, colour ? 5U : 4U);
    auto frame = std::make_unique<RgbdFrame>();
    frame->depth_mm.fill(7);
    ASSERT_EQ(opened.value()->wait_frame(10, *frame), CameraStatus::kFrame);
    EXPECT_EQ(frame->intrinsics, choice.intrinsics());
    EXPECT_EQ(frame->depth_mm[0], 0);
    EXPECT_EQ(frame->depth_mm[1], 0);
    EXPECT_EQ(frame->depth_mm[2], 0);
    EXPECT_EQ(frame->depth_mm[3], 0);
    EXPECT_EQ(frame->depth_mm[4], 1000);
    EXPECT_EQ(frame->depth_mm[5], 1234);
    EXPECT_EQ(frame->depth_mm[512 * 424 - 1], 1234);
    EXPECT_EQ(frame->depth_mm[512 * 424], 7);
    EXPECT_EQ(frame->has_colour, colour);
    if (colour) {
      EXPECT_EQ(frame->colour[100], (perception::Rgb{30, 20, 10}));
    }
    fake.status = 1;  // damaged on the way
    EXPECT_EQ(opened.value()->wait_frame(10, *frame), CameraStatus::kNoFrame);
    fake.status = 0;
  }
  EXPECT_EQ(fake.released, 4);
  EXPECT_EQ(fake.closed, 2);
  fake.depth.clear();
}

}  // namespace
}  // namespace drivers
