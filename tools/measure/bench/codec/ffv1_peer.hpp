// FFV1 through libavcodec, one thread, 16-bit grey: the lossless codec that others would take for
// depth, coded beside ours in the same run.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

namespace teletact {

class Ffv1Peer {
 public:
  // Throws std::runtime_error when libavcodec can not do it.
  Ffv1Peer(int width, int height);
  ~Ffv1Peer();
  Ffv1Peer(const Ffv1Peer&) = delete;
  Ffv1Peer& operator=(const Ffv1Peer&) = delete;
  struct Coded {
    std::size_t bytes = 0;
    double encode_ms = 0, decode_ms = 0;  // thread CPU
  };
  // Throws std::runtime_error when what comes back is another image.
  Coded pass(std::span<const std::uint16_t> depth_mm);
  [[nodiscard]] static bool built_in() noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace teletact
