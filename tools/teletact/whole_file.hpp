// A file appears whole or not at all: written beside its place, then renamed.
#pragma once

#include <string>

namespace teletact {

// Throws std::runtime_error naming the file and the reason; then nothing is left behind.
void write_whole_file(const std::string& path, const std::string& content);

}  // namespace teletact
