// REPORT/raw, the files that a run leaves for its report, its replay and its audit. The next run into the same report
// replaces them, and nothing else: what no run wrote is the user's, and a folder that holds such a thing is refused.
//
// A run's file is known by its name. Some of the names are anybody's (notes, scene.toml): these count as a run's only
// where the folder is one, which kRunFolderMark says, or a log of a box from before there was that mark.
#pragma once

#include <string>

namespace teletact {

inline constexpr const char* kRunFolderMark = "of_teletact_demo.txt";

// Makes the folder, with its mark. Throws std::runtime_error, one line that names the folder and what is in it, when
// something there is not a run's; then nothing was changed.
void make_run_folder(const std::string& report);

// Takes an earlier run's files away; the mark stays. Throws as above, before anything is removed.
void clear_run_folder(const std::string& folder);

}  // namespace teletact
