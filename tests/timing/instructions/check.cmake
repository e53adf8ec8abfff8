# cmake -DVALGRIND=... -DCLOCK=real|virtual -DFAULTS=program -DNOFAULTS=program -DWORK=folder -P check.cmake
# Instructions per job = difference of a long and a short run / difference of their jobs: start and
# end of the program cancel out.
if(NOT VALGRIND)
  message(FATAL_ERROR "valgrind is not installed: instructions are not counted (apt install valgrind)")
endif()
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
# What runs the jobs, with all that it calls. On the real clock the other threads wait and drain for
# as long as the clock says, so only the task's thread counts.
if(CLOCK STREQUAL "real")
  set(short 50)
  set(collect "*RealExecutor*::task_loop*")
else()
  set(short 1000)
  set(collect "*VirtualExecutor*::run*")
endif()
math(EXPR long "2 * ${short}")

function(count program jobs out)
  # A release that is dropped spoils the count; the program says so with 75, and we try again.
  foreach(attempt RANGE 1 5)
    # Bound at the start: a first call through the linker costs a thousand instructions, in a job or
    # not.
    execute_process(COMMAND ${CMAKE_COMMAND} -E env LD_BIND_NOW=1 ${VALGRIND} --tool=callgrind --callgrind-out-file=${WORK}/callgrind.out
      "--toggle-collect=${collect}" ${program} ${CLOCK} ${jobs} ${ARGN}
      RESULT_VARIABLE rc OUTPUT_VARIABLE text ERROR_VARIABLE text)
    if(NOT rc EQUAL 75)
      break()
    endif()
  endforeach()
  if(NOT rc EQUAL 0)
    message(FATAL_ERROR "${program} ${CLOCK} ${jobs} ${ARGN} under callgrind: exit ${rc}\n${text}")
  endif()
  file(STRINGS ${WORK}/callgrind.out lines REGEX "^(totals|summary): [0-9]+")
  list(GET lines -1 line)
  string(REGEX REPLACE "^[a-z]+: ([0-9]+).*" "\\1" n "${line}")
  set(${out} ${n} PARENT_SCOPE)
endfunction()

# per_job(<program> <out> [planned]): 1000 x the instructions of one job
function(per_job program out)
  count(${program} ${short} a ${ARGN})
  count(${program} ${long} b ${ARGN})
  math(EXPR milli "(${b} - ${a}) * 1000 / ${short}")
  get_filename_component(name ${program} NAME)
  message("${CLOCK}: ${name} ${ARGN}: ${milli} / 1000 instructions a job (${a}, ${b})")
  # A plausible job: a toggle that matched nothing would count 0 everywhere.
  if(milli LESS 100000)
    message(FATAL_ERROR "that is less than 100 instructions a job: nothing was counted")
  endif()
  set(${out} ${milli} PARENT_SCOPE)
endfunction()

# equal(<a> <b> <out>): do they differ by no more than 0.1 %?
function(equal a b out)
  math(EXPR d "${a} - ${b}")
  if(d LESS 0)
    math(EXPR d "-(${d})")
  endif()
  math(EXPR d "${d} * 1000")
  if(d GREATER b)
    set(${out} FALSE PARENT_SCOPE)
  else()
    set(${out} TRUE PARENT_SCOPE)
  endif()
endfunction()

per_job(${NOFAULTS} without)
per_job(${FAULTS} no_plan)
per_job(${FAULTS} with_plan planned)
equal(${no_plan} ${without} same)
if(NOT same)
  message(FATAL_ERROR "a build with faults and without a plan costs ${no_plan} / 1000 instructions a "
    "job, one without faults ${without} / 1000: more than 0.1 % apart")
endif()
equal(${with_plan} ${without} same)
if(same OR with_plan LESS without)
  message(FATAL_ERROR "a job with a plan costs no more than one without: the count tells nothing")
endif()
