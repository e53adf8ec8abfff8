// Inside of admission: a request whose static choices are settled (admission.cpp), called once for
// each combination that admit() tries (static_choice.cpp).
#pragma once

#include "rt/sched/admission.hpp"

namespace rt::detail {

[[nodiscard]] Admission admit_levels(const AdmissionRequest& settled);

// "12.345 ms", or "unbounded".
[[nodiscard]] std::string milliseconds(Nanos d);

// With one choice in place of all of them.
[[nodiscard]] TaskSpec settled(const TaskSpec& spec, std::size_t choice);

}  // namespace rt::detail
