#include "tools/measure/bench/peer_process.hpp"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <utility>

#include "tools/files/build_info.hpp"

namespace teletact {

std::string open3d_peer() {
  return std::string(kSourceFolder) + "/tools/measure/bench/peer/open3d_peer.py";
}

PeerFrames::PeerFrames(const FusionSequence& sequence) {
  std::string name = (std::filesystem::temp_directory_path() / "teletact_frames_XXXXXX").string();
  const int fd = mkstemp(name.data());
  if (fd < 0) throw std::runtime_error(name + ": can not be written");
  close(fd);
  path_ = name;
  std::ofstream out(path_, std::ios::binary);
  const auto& k = sequence.intrinsics;
  out.precision(12);
  out << k.width << ' ' << k.height << ' ' << k.fx << ' ' << k.fy << ' ' << k.cx << ' ' << k.cy
      << ' ' << sequence.size() << '\n';
  const auto frame = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, *frame);
    out.write(reinterpret_cast<const char*>(frame->depth_mm.data()),
              std::streamsize{2} * k.width * k.height);
  }
  if (!out.flush()) throw std::runtime_error(path_ + ": can not be written");
}

PeerFrames::~PeerFrames() {
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

PeerProcess::PeerProcess(const std::vector<std::string>& command) {
  int in[2], out[2];
  if (access(command.front().c_str(), X_OK) != 0 || pipe2(in, O_CLOEXEC) != 0) return;
  if (pipe2(out, O_CLOEXEC) != 0) {
    close(in[0]), close(in[1]);
    return;
  }
  std::vector<char*> argv;
  for (const std::string& a : command) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  std::signal(SIGPIPE, SIG_IGN);  // a peer that ends is seen by ask()
  pid_ = fork();
  if (pid_ == 0) {
    dup2(in[0], STDIN_FILENO);
    dup2(out[1], STDOUT_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  close(in[0]), close(out[1]);
  to_ = fdopen(in[1], "w");
  from_ = fdopen(out[0], "r");
}

PeerProcess::~PeerProcess() {
  if (to_ != nullptr) std::fclose(to_);
  if (from_ != nullptr) std::fclose(from_);
  if (pid_ > 0) waitpid(pid_, nullptr, 0);
}

std::string PeerProcess::ending() {
  if (pid_ <= 0) return "did not start";
  if (to_ != nullptr) std::fclose(to_);
  to_ = nullptr;
  int status = 0;
  if (waitpid(std::exchange(pid_, -1), &status, 0) < 0) return "ended";
  if (WIFSIGNALED(status))
    return std::string("was ended by a signal: ") + strsignal(WTERMSIG(status));
  return "ended with " + std::to_string(WEXITSTATUS(status));
}

bool PeerProcess::ask(int frame, Reply& reply) {
  if (to_ == nullptr || from_ == nullptr) return false;
  if (std::fprintf(to_, "%d\n", frame) < 0 || std::fflush(to_) != 0) return false;
  int index = 0, tracked = 0;
  double v[12];
  if (std::fscanf(from_, "%d %lf %d", &index, &reply.cpu_ms, &tracked) != 3) return false;
  for (double& n : v)
    if (std::fscanf(from_, "%lf", &n) != 1) return false;
  reply.tracked = tracked != 0;
  for (int i = 0; i < 9; ++i) reply.X_WC.linear()(i / 3, i % 3) = v[i];
  reply.X_WC.translation() = perception::Vec3(v[9], v[10], v[11]);
  return index == frame;
}

}  // namespace teletact
