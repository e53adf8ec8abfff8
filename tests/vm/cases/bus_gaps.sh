# The chain is silent for 50 ms: the wheels turn on. Then for 200 ms: stopped, and so it stays until
# somebody acts.
bus_up
chain_up --gap-ms 50 --long-gap-ms 200
rm -f /tmp/gate.*
(until [ -e /tmp/gate.ready ]; do usleep 10000; done
 : > /tmp/gate.go
 usleep 1600000; kill -USR1 $chain
 usleep 400000; kill -USR2 $chain) &
tell /tmp/bus vm_master --iface veth0 --expect gaps --act-at 2.6 --seconds 3.4 --timed no --gate /tmp/gate
chain_down
holds "every frame of the gaps counted" \
  "$(value /tmp/bus ethercat.lost) == $(value /tmp/chain chain.swallowed)" \
  "$(value /tmp/bus ethercat.lost) counted, $(value /tmp/chain chain.swallowed) swallowed"
