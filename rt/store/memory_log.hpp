// A run's records in memory, at most so many: when there are more, the older half becomes counts
// and histograms (TaskLog::past). For runs without a disk.
#pragma once

#include <cstddef>

#include "rt/store/part.hpp"

namespace rt {

class MemoryLog {
 public:
  // `log` has the header's tasks, holds the records, and outlives this.
  MemoryLog(RunLog& log, std::size_t most) : log_(log), folder_(log), most_(most) {}
  void add(const JobRecord& record);

 private:
  void fold();
  RunLog& log_;
  Folder folder_;
  std::size_t most_, held_ = 0;
};

}  // namespace rt
