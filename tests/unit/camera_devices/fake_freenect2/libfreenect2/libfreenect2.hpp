// A stand-in for libfreenect2 with the declarations that the driver uses, and a device that the
// tests command.
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace libfreenect2 {

class Frame {
 public:
  enum Type { Color = 1, Ir = 2, Depth = 4 };
  std::size_t width, height, bytes_per_pixel;
  unsigned char* data;
  std::uint32_t timestamp = 0, sequence = 0, status = 0;
  Frame(std::size_t w, std::size_t h, std::size_t bytes)
      : width(w), height(h), bytes_per_pixel(bytes), memory_(w * h * bytes + 16) {
    data = memory_.data();
  }
  virtual ~Frame() = default;
  Frame(const Frame&) = delete;
  Frame& operator=(const Frame&) = delete;

 private:
  std::vector<unsigned char> memory_;
};
using FrameMap = std::map<Frame::Type, Frame*>;

// What the tests set and look at.
struct Fake {
  std::vector<std::string> serials{"004711"};
  bool starts = true;
  int started = 0, stopped = 0, closed = 0, released = 0;
  unsigned int listened = 0;
  std::vector<float> depth;  // of the next frames, 512 x 424; empty: none comes
  std::uint32_t status = 0;
};
inline Fake& fake() {
  static Fake one;
  return one;
}

class FrameListener {
 public:
  virtual ~FrameListener() = default;
};

class SyncMultiFrameListener : public FrameListener {
 public:
  explicit SyncMultiFrameListener(unsigned int types) : types_(types) { fake().listened = types; }
  bool waitForNewFrame(FrameMap& frames, int) {
    if (fake().depth.empty()) return false;
    auto* depth = new Frame(512, 424, 4);
    std::memcpy(depth->data, fake().depth.data(), 512 * 424 * 4);
    depth->status = fake().status;
    frames[Frame::Depth] = depth;
    if ((types_ & Frame::Color) != 0) frames[Frame::Color] = new Frame(1920, 1080, 4);
    return true;
  }
  void release(FrameMap& frames) {
    for (auto& f : frames) delete f.second;
    frames.clear();
    ++fake().released;
  }

 private:
  unsigned int types_;
};

class PacketPipeline {
 public:
  virtual ~PacketPipeline() = default;
};
class CpuPacketPipeline : public PacketPipeline {};

class Freenect2Device {
 public:
  struct ColorCameraParams {
    float fx, fy, cx, cy;
  };
  struct IrCameraParams {
    float fx, fy, cx, cy, k1, k2, k3, p1, p2;
  };
  virtual ~Freenect2Device() = default;
  virtual IrCameraParams getIrCameraParams() {
    return {366.1F, 366.2F, 256.3F, 207.4F, 0, 0, 0, 0, 0};
  }
  virtual ColorCameraParams getColorCameraParams() { return {1081, 1081, 959, 539}; }
  virtual void setColorFrameListener(FrameListener*) {}
  virtual void setIrAndDepthFrameListener(FrameListener*) {}
  virtual bool startStreams(bool, bool) {
    ++fake().started;
    return fake().starts;
  }
  virtual bool stop() { return ++fake().stopped > 0; }
  virtual bool close() { return ++fake().closed > 0; }
};

class Freenect2 {
 public:
  int enumerateDevices() { return static_cast<int>(fake().serials.size()); }
  std::string getDeviceSerialNumber(int i) { return fake().serials[static_cast<std::size_t>(i)]; }
  std::string getDefaultDeviceSerialNumber() {
    return fake().serials.empty() ? "" : fake().serials.front();
  }
  Freenect2Device* openDevice(const std::string& serial, const PacketPipeline* pipeline) {
    delete pipeline;
    for (const auto& s : fake().serials)
      if (s == serial) return &device_;
    return nullptr;
  }

 private:
  Freenect2Device device_;
};

// Undistorting shifts every reading by a tenth of a millimetre, so that a test can tell.
class Registration {
 public:
  Registration(Freenect2Device::IrCameraParams, Freenect2Device::ColorCameraParams) {}
  void undistortDepth(const Frame* depth, Frame* undistorted) const {
    const auto* in = reinterpret_cast<const float*>(depth->data);
    auto* out = reinterpret_cast<float*>(undistorted->data);
    for (int i = 0; i < 512 * 424; ++i) out[i] = in[i] + 0.1F;
  }
  void apply(const Frame*, const Frame* depth, Frame* undistorted, Frame* registered) const {
    undistortDepth(depth, undistorted);
    for (int i = 0; i < 512 * 424; ++i) {
      registered->data[4 * i] = 10;      // blue
      registered->data[4 * i + 1] = 20;  // green
      registered->data[4 * i + 2] = 30;  // red
    }
  }
};

}  // namespace libfreenect2
