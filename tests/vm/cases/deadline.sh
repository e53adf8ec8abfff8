# Under SCHED_DEADLINE only the thread that overruns is late.
tell /tmp/deadline vm_deadline --class deadline
tell /tmp/deadline vm_deadline --class fifo
