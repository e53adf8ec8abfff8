#include "tools/measure/accuracy/moving_peer.hpp"

#include <cstdio>
#include <filesystem>

#include "tools/measure/bench/peer_process.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {

namespace {

constexpr const char* kVoxel_m = "0.01";
constexpr const char* kEdge = "512";

std::string beside_us(const char* program) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? std::string(program) : (self.parent_path() / program).string();
}

MovingPeer run(const char* name, const char* package, const FusionSequence& images,
               const std::vector<std::string>& command) {
  MovingPeer peer;
  peer.name = name;
  peer.frames = images.size();
  PeerProcess process(command);
  ClaimedError error;
  for (int f = 0; f < images.size(); ++f) {
    PeerProcess::Reply reply;
    if (!process.ask(f, reply)) {
      peer.absent = f == 0 ? std::string("is not installed (Debian: ") + package + ")"
                           : process.ending() + " at frame " + std::to_string(f);
      break;
    }
    if (!reply.tracked) continue;
    ++peer.tracked;
    error.add(reply.X_WC, *images.truth(f));
  }
  peer.ate_mm = error.ate_mm(), peer.worst_mm = error.worst_mm();
  return peer;
}

}  // namespace

std::string MovingPeer::text() const {
  char line[200];
  std::snprintf(line, sizeof line, "    %-8s tracked %d of %d  ate %.1f  worst %.1f mm",
                name.c_str(), tracked, frames, ate_mm, worst_mm);
  return absent.empty() ? std::string(line) + "\n" : "    " + name + ": " + absent + "\n";
}

std::vector<MovingPeer> run_moving_peers(const MovingFilm& film) {
  const PeerFrames frames(film.with);
  std::vector<MovingPeer> peers;
  peers.push_back(
      run("open3d", "python3-open3d", film.with, {open3d_peer(), frames.path(), kVoxel_m}));
  peers.push_back(run("opencv", "libopencv-contrib-dev, then build again", film.with,
                      {beside_us("teletact_peer_opencv"), frames.path(), "tsdf", kVoxel_m, kEdge}));
  return peers;
}

}  // namespace teletact
