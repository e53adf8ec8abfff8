#include <algorithm>

#include "tools/doctor/doctor_network.hpp"
#include "tools/doctor/doctor_tree.hpp"

namespace teletact {

std::vector<DoctorCheck> run_doctor(const std::string& root) {
  using namespace doctor;
  const Tree tree(root);
  // A folder of files has no cards to ask.
  const ModerationReader cards =
      root.empty() ? ModerationReader(moderation_of) : ModerationReader();
  return {preemption(tree),
          rtprio(tree),
          memlock(tree),
          cores(tree),
          quota(tree),
          governor(tree),
          idle_states(tree),
          interrupts(tree),
          clock_source(tree),
          smt(tree),
          throttling(tree),
          fair_server(tree),
          virtualisation(tree),
          can_bus(tree),
          gpio_chips(tree),
          raw_frames(tree),
          coalescing(tree, cards),
          interrupt_threads(tree),
          congestion(tree)};
}

DoctorCheck::Level doctor_verdict(const std::vector<DoctorCheck>& checks) {
  auto worst = DoctorCheck::Level::kFine;
  for (const auto& c : checks) worst = std::max(worst, c.level);
  return worst;
}

}  // namespace teletact
