// Instructions of one function of a counting program that lies beside this one, by valgrind's
// callgrind.
#pragma once

#include <string>
#include <vector>

namespace teletact {

// The folder of this program, in which the counting programs lie.
[[nodiscard]] std::string own_folder();
[[nodiscard]] bool have_valgrind();
// As a word of a shell.
[[nodiscard]] std::string shell_quoted(const std::string& text);

// Inside of functions that match `pattern` (callgrind's --toggle-collect), over one run of
// `program` with `arguments`. Bound at the start: a first call through the linker costs a thousand
// instructions. `scratch`: an existing folder. Throws std::runtime_error with the last line of what
// was said.
[[nodiscard]] double callgrind_count(const std::string& program,
                                     const std::vector<std::string>& arguments,
                                     const std::string& pattern, const std::string& scratch);
// The same of each round: from one call of a function that matches `round` to the next, and to the
// end of the program. What is before the first is left out.
[[nodiscard]] std::vector<double> callgrind_rounds(const std::string& program,
                                                   const std::vector<std::string>& arguments,
                                                   const std::string& pattern,
                                                   const std::string& round,
                                                   const std::string& scratch);
// The same of each span that the program itself ends: it starts and stops the instrumentation and
// dumps in between (valgrind/callgrind.h). The rest of it runs ten times as fast.
[[nodiscard]] std::vector<double> callgrind_dumps(const std::string& program,
                                                  const std::vector<std::string>& arguments,
                                                  const std::string& pattern,
                                                  const std::string& scratch);

}  // namespace teletact
