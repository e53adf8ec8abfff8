// Why a network card can not be used, in one line, with what to do.
#pragma once

#include <string>

namespace drivers::ethercat {

// Of a failed call (errno): the right that is missing, a name that is not there.
[[nodiscard]] std::string card_problem(const std::string& interface, int error);

// Of a card that is down: the command that sets it up. Empty: it is up, or can not be asked.
[[nodiscard]] std::string card_down(const std::string& interface);

}  // namespace drivers::ethercat
