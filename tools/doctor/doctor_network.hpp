// Checks of what an EtherCAT bus, safety lines and the link need of the box.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

// How long a network card gathers frames before it interrupts (ethtool -c).
struct Moderation {
  std::uint32_t rx_us = 0, tx_us = 0;
  bool adaptive = false;
};
using ModerationReader = std::function<std::optional<Moderation>(const std::string& card)>;
// Of a card of this machine, by SIOCETHTOOL; empty: the card does not tell.
[[nodiscard]] std::optional<Moderation> moderation_of(const std::string& card);

[[nodiscard]] DoctorCheck raw_frames(const Tree& tree);
[[nodiscard]] DoctorCheck coalescing(const Tree& tree, const ModerationReader& read);
[[nodiscard]] DoctorCheck interrupt_threads(const Tree& tree);
// Of the link between two boxes.
[[nodiscard]] DoctorCheck congestion(const Tree& tree);

}  // namespace teletact::doctor
