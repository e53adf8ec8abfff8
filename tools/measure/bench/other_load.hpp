// How much of the machine other processes used while something was measured. This one's children
// that have ended are not others.
#pragma once

namespace teletact {

class OtherLoad {
 public:
  OtherLoad() { restart(); }
  void restart();
  // Cores' worth of work by others since restart(); 0 where /proc/stat can not be read.
  [[nodiscard]] double cores() const;

 private:
  struct Sample {
    double busy_s = 0, own_s = 0, wall_s = 0;
  };
  [[nodiscard]] static Sample now();
  Sample begin_;
};

}  // namespace teletact
