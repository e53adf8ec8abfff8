#include "rt/sched/virtual_executor-inl.hpp"

namespace rt {

template class VirtualExecutor<Plain>;

}  // namespace rt
