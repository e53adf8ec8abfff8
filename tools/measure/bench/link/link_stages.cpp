#include "tools/measure/bench/link/link_stages.hpp"

#include <algorithm>

#include "tools/measure/bench/link/link_window.hpp"

namespace teletact {

namespace {

// What a frame has on the link beside depth and colour is less.
constexpr std::uint64_t kHead = 400;

// The first job behind its exposure that coded something of its size.
const rt::JobRecord* coded_by(std::span<const rt::JobRecord> jobs, const tasks::LinkSample& s) {
  auto job = std::partition_point(jobs.begin(), jobs.end(), [&](const rt::JobRecord& j) {
    return j.start_ns < s.made_remote_ns;
  });
  for (; job != jobs.end() && job->end_ns < rt::ns_of(s.stamp); ++job) {
    if (job->work > 0 && job->work <= s.bytes && s.bytes - job->work < kHead) return &*job;
  }
  return nullptr;
}

}  // namespace

std::vector<Stages_ms> felt_stages(const StagesOf& of) {
  std::vector<Stages_ms> out;
  for (const Felt& felt : felt_images(of.haptic, of.fusion, of.link)) {
    const rt::JobRecord* coded = coded_by(of.capture_jobs, *felt.picture);
    if (coded == nullptr) continue;
    const std::array<std::int64_t, kStages + 1> at{felt.picture->made_remote_ns,
                                                   coded->start_ns,
                                                   coded->end_ns,
                                                   rt::ns_of(felt.picture->stamp),
                                                   rt::ns_of(felt.image->stamp),
                                                   rt::ns_of(felt.tick->stamp)};
    Stages_ms& ms = out.emplace_back();
    for (std::size_t i = 0; i < kStages; ++i) ms[i] = 1e-6 * static_cast<double>(at[i + 1] - at[i]);
  }
  return out;
}

}  // namespace teletact
