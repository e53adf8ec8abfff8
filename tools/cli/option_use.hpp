// Commands of several jobs (bench WHAT, accuracy WHAT): which option is of which job. One that would be passed over in
// silence is refused.
#pragma once

#include <CLI/CLI.hpp>
#include <span>
#include <string>

namespace teletact {

struct OptionUse {
  const char *option, *jobs;  // jobs as "table1, fusion, haptic --rgbd"
};

// What is not in `table` is of every job. Throws std::runtime_error naming the first option given that is not of `job`.
void check_use(const CLI::App& app, const std::string& job, std::span<const OptionUse> table);

// Of the two commands; `rgbd`: --rgbd was given, of which more follows.
void check_bench_use(const CLI::App& app, const std::string& what, bool rgbd);
void check_accuracy_use(const CLI::App& app, const std::string& what, bool rgbd);

}  // namespace teletact
