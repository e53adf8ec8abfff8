// A recording through the codecs of the link and back: what `teletact codec` does. Its options are
// told in tools/teletact/cmd_codec.cpp.
#pragma once

#include <string>

#include "tools/record/codec_chain.hpp"

namespace teletact {

struct CodecOptions {
  std::string rgbd, intrinsics, out, json;
  std::string mode, noise = "strict", colour = drivers::h264_built_in() ? "h264" : "jpeg";
  CodecChoice choice;
  int frames = 100000;
};

// Exit code 0. Throws std::runtime_error with one line; then the folder is as it was.
[[nodiscard]] int code_recording(const CodecOptions& o);

}  // namespace teletact
