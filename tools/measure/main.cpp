// teletact-measure: what `teletact bench`, `teletact accuracy` and `teletact stability` start
// (tools/teletact/measure.hpp).
#include <array>
#include <cstdio>
#include <cstring>
#include <exception>

#include "tools/measure/measure_commands.hpp"

namespace {

struct Command {
  const char* name;
  int (*run)(int, char**);
};

constexpr std::array kCommands{Command{"bench", teletact::cmd_bench},
                               Command{"accuracy", teletact::cmd_accuracy},
                               Command{"stability", teletact::cmd_stability}};

}  // namespace

int main(int argc, char** argv) {
  for (const Command& c : kCommands) {
    if (argc < 2 || std::strcmp(argv[1], c.name) != 0) continue;
    try {
      return c.run(argc - 1, argv + 1);
    } catch (const std::exception& e) {
      std::fprintf(stderr, "teletact %s: %s\n", c.name, e.what());
      return 2;
    }
  }
  std::fprintf(stderr, "usage: teletact-measure bench|accuracy|stability [OPTIONS]\n");
  return 2;
}
