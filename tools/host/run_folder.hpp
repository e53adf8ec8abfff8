// REPORT/raw: the files that a run leaves for its report, replay and audit. The next run into the
// same report replaces only these. A file that no run wrote belongs to the user, and a folder that
// holds one is refused.
//
// A run's file is known by its name. Some names are common (notes, scene.toml). These count as a
// run's file only if the folder has kRunFolderMark, or a box's log from before that mark existed.
#pragma once

#include <cstddef>
#include <string>

namespace teletact {

// A run's black boxes outlive it: when the next one clears the folder, they and the logs beside
// them go to REPORT/raw/before-<n>, the newest of them with the highest number. Of more than
// kKeptRuns the first and the newest stay: a box that crashes at each start loses only what lies
// between. Of an end that was asked for, without another stop, nothing is kept.
inline constexpr std::size_t kKeptRuns = 5;

inline constexpr const char* kRunFolderMark = "of_teletact_demo.txt";

// Makes the folder, with its mark. If it holds a file that is not a run's: throws
// std::runtime_error with one line that names the folder and the file; nothing was changed then.
void make_run_folder(const std::string& report);

// Removes an earlier run's files, but for its black boxes (above); the mark stays. Throws as above,
// before anything is removed.
void clear_run_folder(const std::string& folder);

}  // namespace teletact
