// What the words of `teletact ethercat` share.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "drivers/ethercat/state_control.hpp"
#include "tools/bus/ethercat_command.hpp"

namespace teletact {

// To --json, where it is asked for.
void write_json(const EtherCatOptions&, const char* what, const nlohmann::ordered_json& content);
// 0x and at least so many digits.
[[nodiscard]] std::string hex(std::uint64_t, int digits);
// Throws CouldNotDo.
void must(const rt::Result<bool>&);
// From INIT up to the state.
void bring_to(EtherCatSession&, drivers::ethercat::AlState wanted);

}  // namespace teletact
