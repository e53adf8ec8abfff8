// Files of a lab: of mode 0600, in folders of mode 0700, never overwritten by accident. Each
// refusal is
// one line that names the file.
#pragma once

#include <string>

#include "rt/result.hpp"

namespace teletact {

// Refused where the file is there.
[[nodiscard]] rt::Result<bool> write_key_file(const std::string& path, const std::string& text);
// Whole or not at all: a box may be reading it.
[[nodiscard]] rt::Result<bool> replace_key_file(const std::string& path, const std::string& text);
[[nodiscard]] rt::Result<bool> make_key_folder(const std::string& path);

}  // namespace teletact
