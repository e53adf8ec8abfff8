#include "rt/sched/real_executor-inl.hpp"

namespace rt {

#if TELETACT_FAULTS
template class RealExecutor<Planned>;
#endif

}  // namespace rt
