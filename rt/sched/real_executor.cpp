#include "rt/sched/real_executor-inl.hpp"

namespace rt {

template class RealExecutor<Plain>;

}  // namespace rt
