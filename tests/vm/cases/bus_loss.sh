# One frame in a hundred lost by netem: each is counted, and nothing else happens.
bus_up
tc qdisc add dev veth0 root netem limit 1000
chain_up
rm -f /tmp/gate.*
(until [ -e /tmp/gate.ready ]; do usleep 10000; done
 tc qdisc change dev veth0 root netem limit 1000 loss 1%
 : > /tmp/gate.go) &
tell /tmp/bus vm_master --gate /tmp/gate --iface veth0 --expect run --seconds "$BUS_SECONDS"
tc -s qdisc show dev veth0 > /tmp/qdisc
cat /tmp/qdisc
dropped=$(sed -n 's/.*(dropped \([0-9]*\),.*/\1/p' /tmp/qdisc | head -1)
tc qdisc del dev veth0 root
chain_down
echo "figure vm.injected_losses $dropped 1"
holds "every loss counted, none more" "$(value /tmp/bus ethercat.lost_in_all) == $dropped && $dropped > 0" \
  "$(value /tmp/bus ethercat.lost_in_all) counted, $dropped injected"
