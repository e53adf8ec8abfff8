#include "rt/sched/virtual_executor-inl.hpp"

namespace rt {

#if TELETACT_FAULTS
template class VirtualExecutor<Planned>;
#endif

}  // namespace rt
