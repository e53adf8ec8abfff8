#include "tools/cli/option_use.hpp"

#include <stdexcept>

namespace teletact {

namespace {

constexpr OptionUse kBench[] = {
    {"--hours", "days"},
    {"--store-cap", "days"},
    {"--in-memory", "days"},
    {"--rounds", "rings, wakeup, effects"},
    {"--slice", "wakeup"},
    {"--effect", "effects"},
    {"--write", "effects, prediction, days, link, console"},
    {"--link-run", "link"},
    {"--part", "console"},
    {"--run-seconds", "link"},
    {"--span", "effects"},
    {"--rgbd", "table1, fusion, haptic --rgbd, console"},
    {"--intrinsics", "table1, fusion, haptic --rgbd"},
    {"--edges", "table1"},
    {"--isa", "table1"},
    {"--runs", "table1"},
    {"--no-fixed-voxel", "table1"},
    {"--instructions", "table1"},
    {"--data", "table2, segmentation"},
    {"--seed", "segmentation, fuzz, codec, haptic --rgbd, prediction"},
    {"--seconds", "fuzz, console"},
    {"--reader", "fuzz"},
    {"--jobs", "fuzz"},
    {"--keep", "fuzz"},
    {"--peer", "fusion"},
    {"--no-synthetic", "fusion"},
    {"--passes", "haptic"},
    {"--no-instructions", "haptic"},
    {"--runs-in", "haptic"},
    {"--virtual-seconds", "haptic --rgbd"},
    {"--paths", "haptic --rgbd"},
    {"--first-place", "haptic --rgbd"},
    {"--no-beside", "haptic --rgbd"},
    {"--record", "haptic --rgbd"},
    {"--rates", "boundary"},
    {"--dampings", "boundary"},
    {"--svg", "haptic --rgbd, boundary, prediction"},
    {"--frames", "table1, fusion, codec, drift"},
    {"--long", "codec, console"},
    {"--voxel", "drift"},
    {"--half-size", "drift"},
    {"--logs", "prediction"},
    {"--choice", "prediction"},
    {"--trace-seconds", "prediction"},
};

constexpr OptionUse kAccuracy[] = {
    {"--rgbd", "fusion --rgbd, weighting --rgbd"},
    {"--rgbd-frames", "fusion --rgbd, weighting --rgbd"},
    {"--intrinsics", "fusion --rgbd, weighting --rgbd"},
    {"--scenes", "fusion, fusion --rgbd, weighting, weighting --rgbd"},
    {"--frames", "fusion, fusion --rgbd, weighting, weighting --rgbd"},
    {"--voxels", "fusion, fusion --rgbd, weighting, weighting --rgbd"},
    {"--samples", "weighting, weighting --rgbd"},
    {"--data", "segmentation, clicks"},
    {"--clutter", "clicks"},
    {"--default-only", "clicks"},
    {"--seed", "segmentation, clicks, weighting, weighting --rgbd"},
};

bool holds(const std::string& jobs, const std::string& job) {
  return (", " + jobs + ",").find(", " + job + ",") != std::string::npos;
}

}  // namespace

void check_use(const CLI::App& app, const std::string& job, std::span<const OptionUse> table) {
  for (const OptionUse& use : table) {
    if (app.count(use.option) == 0 || holds(use.jobs, job)) continue;
    throw std::runtime_error(std::string(use.option) + " has no meaning with " + job +
                             ": it belongs to " + use.jobs);
  }
}

void check_bench_use(const CLI::App& app, const std::string& what, bool rgbd) {
  check_use(app, what == "haptic" && rgbd ? "haptic --rgbd" : what, kBench);
}

void check_accuracy_use(const CLI::App& app, const std::string& what, bool rgbd) {
  const bool of_images = what == "fusion" || what == "weighting";
  check_use(app, of_images && rgbd ? what + " --rgbd" : what, kAccuracy);
}

}  // namespace teletact
