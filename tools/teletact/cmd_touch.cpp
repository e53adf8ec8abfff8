// teletact touch: the haptic task on plain files. The field is cut into the windows fusion would
// publish, the hand is played from a table, and the very code of the 1 kHz task makes the force.
#include "tools/teletact/commands.hpp"
#include "tools/touch/touch_options.hpp"
#include "tools/touch/touch_rerun.hpp"
#include "tools/touch/touch_run.hpp"

namespace teletact {

int cmd_touch(int argc, char** argv) {
  touch::Options o;
  if (!touch::read_options(argc, argv, o)) return 0;
  if (!o.replay.empty()) return rerun_touch({o.replay, o.method, o.out, o.json});
  touch::run(o);
  return 0;
}

}  // namespace teletact
