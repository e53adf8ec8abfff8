# cmake -DMODEL=... -DWORK=... -DSPIN=... -DCC=... -DEXPECT=clean|error [-DVARIANT=...] -P check.cmake
# Verifies one Promela model exhaustively: spin writes the verifier, the compiler builds it, it
# runs.
if(NOT SPIN)
  message(FATAL_ERROR "spin is not installed: the Promela models are not checked (apt install spin)")
endif()
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
set(define "")
if(VARIANT)
  set(define -D${VARIANT})
endif()
execute_process(COMMAND ${SPIN} -a ${define} ${MODEL} WORKING_DIRECTORY ${WORK}
  RESULT_VARIABLE rc OUTPUT_VARIABLE out ERROR_VARIABLE out)
if(NOT rc EQUAL 0 OR NOT EXISTS ${WORK}/pan.c)
  message(FATAL_ERROR "spin failed:\n${out}")
endif()
execute_process(COMMAND ${CC} -O2 -w -DSAFETY -DCOLLAPSE -o pan pan.c WORKING_DIRECTORY ${WORK}
  RESULT_VARIABLE rc OUTPUT_VARIABLE out ERROR_VARIABLE out)
if(NOT rc EQUAL 0)
  message(FATAL_ERROR "the verifier does not compile:\n${out}")
endif()
execute_process(COMMAND ${WORK}/pan -m1000000 -w22 WORKING_DIRECTORY ${WORK}
  RESULT_VARIABLE rc OUTPUT_VARIABLE out ERROR_VARIABLE out)
message("${out}")
if(NOT out MATCHES "errors: ([0-9]+)")
  message(FATAL_ERROR "the verifier gave no verdict (exit ${rc})")
endif()
set(errors ${CMAKE_MATCH_1})
if(EXPECT STREQUAL "clean")
  # A search that was cut short proves nothing.
  if(NOT errors EQUAL 0 OR out MATCHES "max search depth too small|out of memory|Search not completed")
    message(FATAL_ERROR "expected a complete search without error")
  endif()
elseif(errors EQUAL 0 OR NOT out MATCHES "assertion violated")
  message(FATAL_ERROR "the broken model was not caught")
endif()
