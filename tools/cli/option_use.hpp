// For commands with several jobs (bench WHAT, accuracy WHAT): which option belongs to which job. An
// option that the job would ignore is refused.
#pragma once

#include <CLI/CLI.hpp>
#include <span>
#include <string>

namespace teletact {

struct OptionUse {
  const char *option, *jobs;  // jobs as "table1, fusion, haptic --rgbd"
};

// An option that is not in `table` belongs to every job. Throws std::runtime_error naming the first
// option given that does not belong to `job`.
void check_use(const CLI::App& app, const std::string& job, std::span<const OptionUse> table);

// Of the two commands; `rgbd`: --rgbd was given, of which more follows.
void check_bench_use(const CLI::App& app, const std::string& what, bool rgbd);
void check_accuracy_use(const CLI::App& app, const std::string& what, bool rgbd);

}  // namespace teletact
