// Where the time from an exposure to the first force that knows it goes. Pure.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "rt/sched/job_record.hpp"
#include "tasks/graph/samples.hpp"

namespace teletact {

// In order of time. All stages of one image add up to its time to the force. Fusion publishes the
// patch in the midst of its job: from its start to the force is one stage.
enum class Stage : std::uint8_t { kToCapture, kCapture, kRoad, kToFusion, kFusionAndHand };
inline constexpr std::size_t kStages = 5;
inline constexpr std::array<const char*, kStages> kStageNames{
    "to capture", "capture", "road", "decoding, to fusion", "fusion, hand"};
using Stages_ms = std::array<double, kStages>;

struct StagesOf {
  std::span<const tasks::HapticSample> haptic;
  std::span<const tasks::FusionSample> fusion;
  std::span<const tasks::LinkSample> link;
  std::span<const rt::JobRecord> capture_jobs;
};
// One for each image that was felt and whose jobs are all on record. Clocks: those of one machine.
[[nodiscard]] std::vector<Stages_ms> felt_stages(const StagesOf& of);

}  // namespace teletact
