# Two processors, true concurrency, the host's clock: nothing is judged by time, the books must
# balance.
bus_up
chain_up
tell /tmp/bus vm_master --iface veth0 --expect books --seconds "$PLAIN_SECONDS" --timed no --reply-us 500000 \
  --watchdog-ms 5000
chain_down
holds "every frame came back" \
  "$(value /tmp/bus ethercat.lost) == 0 && $(value /tmp/bus ethercat.short) == 0 && \
   $(value /tmp/bus ethercat.cycles) > 0"
