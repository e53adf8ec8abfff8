# Frames are delayed by netem, each differently: none is late for its cycle.
bus_up
chain_up
tc qdisc add dev veth0 root netem limit 1000 delay 100us 50us
tell /tmp/bus vm_master --iface veth0 --expect run --seconds "$SHORT_BUS_SECONDS"
tc -s qdisc show dev veth0
tc qdisc del dev veth0 root
chain_down
holds "no frame lost" "$(value /tmp/bus ethercat.lost) == 0 && $(value /tmp/bus ethercat.short) == 0"
