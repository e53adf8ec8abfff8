# The 11-slave chain at 1 kHz: no cycle missed, none lost, its start near that of cyclictest.
bus_up
chain_up
tell /tmp/bus vm_master --iface veth0 --expect run --seconds "$BUS_SECONDS"
chain_down
holds "no frame lost" "$(value /tmp/bus ethercat.lost) == 0 && $(value /tmp/bus ethercat.short) == 0"
start=$(value /tmp/bus ethercat.start_max_us)
echo "figure vm.start_max_us $start us"
holds "start near cyclictest's" "$start <= $cyclictest_max_us + 20" "$start us, cyclictest $cyclictest_max_us us"
holds "CPU of a cycle, p99" "$(value /tmp/bus ethercat.cycle_cpu_p99_us) <= 100" \
  "$(value /tmp/bus ethercat.cycle_cpu_p99_us) us"
