# The admitted set of tasks as loads: no job is late, dropped or aborted.
tell /tmp/loads vm_loads --case admitted --seconds "$LOAD_SECONDS" --costs /rig/costs
