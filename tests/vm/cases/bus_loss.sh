# One frame in a hundred lost by netem: each is counted, and nothing else happens. In the first half
# of the time on its way to the chain, in the second one in a hundred of the replies too: of those
# the slaves have taken the setpoints.
bus_up
half=$(awk "BEGIN {print $BUS_SECONDS / 2}")
for end in veth0 veth1; do tc qdisc add dev $end root netem limit 1000; done

dropped_at() {
  tc -s qdisc show dev "$1" > "/tmp/qdisc.$1"
  cat "/tmp/qdisc.$1" >&2
  sed -n 's/.*(dropped \([0-9]*\),.*/\1/p' "/tmp/qdisc.$1" | head -1
}

lose_from_gate_on() {  # ends whose frames are lost
  rm -f /tmp/gate.*
  (until [ -e /tmp/gate.ready ]; do usleep 10000; done
   for end in "$@"; do tc qdisc change dev $end root netem limit 1000 loss 1%; done
   : > /tmp/gate.go) &
}

chain_up
lose_from_gate_on veth0
tell /tmp/bus vm_master --gate /tmp/gate --iface veth0 --expect run --seconds "$half"
dropped=$(dropped_at veth0)
echo "figure vm.injected_losses $dropped 1"
holds "every loss counted, none more" "$(value /tmp/bus ethercat.lost_in_all) == $dropped && $dropped > 0" \
  "$(value /tmp/bus ethercat.lost_in_all) counted, $dropped injected"
tc qdisc change dev veth0 root netem limit 1000
chain_down

# A reply that is lost behind the chain costs its computing, on this one processor, before the
# master's patience begins: two in one job end 0.1 ms too late. Of a job's two frames both are lost
# in 4 of 10,000 jobs.
chain_up
lose_from_gate_on veth0 veth1
tell /tmp/replies under replies vm_master --gate /tmp/gate --iface veth0 --expect run --timed no --seconds "$half"
out=$(($(dropped_at veth0) - dropped))
back=$(dropped_at veth1)
for end in veth0 veth1; do tc qdisc del dev $end root; done
chain_down | sed 's/^figure /figure replies./'
echo "figure replies.injected_out $out 1"
echo "figure replies.injected_back $back 1"
holds "replies: every loss of either way counted, none more" \
  "$(of replies lost_in_all) == $out + $back && $out > 0 && $back > 0" \
  "$(of replies lost_in_all) counted, $out and $back injected"
holds "replies: late are at most the jobs that lose both frames" \
  "$(of replies missed) <= 3 + 0.001 * $(of replies cycles)" "$(of replies missed) missed of $(of replies cycles)"
