# Frames doubled, overtaken by later ones, and damaged, by netem: none is taken for another, each is
# counted.
bus_up
rm -f /tmp/gate.*

# part, netem at the master's end, at the chain's end, what vm_master expects, how frames are
# checked, are jobs to be in time
part() {
  tc qdisc add dev veth0 root netem limit 1000
  tc qdisc add dev veth1 root netem limit 1000
  chain_up --check "$5"
  rm -f /tmp/gate.*
  # Words of netem, unquoted.
  (until [ -e /tmp/gate.ready ]; do usleep 10000; done
   tc qdisc change dev veth0 root netem limit 1000 $2
   tc qdisc change dev veth1 root netem limit 1000 $3
   : > /tmp/gate.go) &
  tell "/tmp/$1" under "$1" vm_master --gate /tmp/gate --iface veth0 --expect "$4" --check "$5" --timed "$6" \
    --seconds "$NETEM_SECONDS"
  chain_down > "/tmp/$1.chain"
  sed "s/^figure /figure $1./" "/tmp/$1.chain"
  # What came to the master's end, doubled ones too.
  came=$(tc -s qdisc show dev veth1 | sed -n 's/.* bytes \([0-9]*\) pkt.*/\1/p' | head -1)
  tc qdisc del dev veth0 root
  tc qdisc del dev veth1 root
}

chain_of() { value "/tmp/$1.chain" "chain.$2"; }

part duplicate "duplicate 2%" "duplicate 2%" run none yes
spare=$((came - $(of duplicate sent)))
# The last one may still wait in the socket.
holds "duplicate: each that came twice is counted, none is lost" \
  "$spare > 0 && $(of duplicate lost_in_all) == 0 && $spare - $(of duplicate foreign) <= 1 && \
   $spare - $(of duplicate foreign) >= 0" \
  "$spare more came than were sent, $(of duplicate foreign) counted, $(of duplicate lost_in_all) lost"
holds "duplicate: the chain took some frames twice" \
  "$(chain_of duplicate passed) > $(of duplicate sent)" "$(chain_of duplicate passed) passed"

# Two in a hundred wait longer than anybody waits for them, most until a later job's frames have
# overtaken them.
part reorder "delay 1200us 400us reorder 98%" "" run none yes
holds "reorder: each late frame is a lost one, and its reply a foreign one" \
  "$(of reorder lost_in_all) > 0 && $(of reorder lost_in_all) - $(of reorder foreign) <= 1 && \
   $(of reorder lost_in_all) - $(of reorder foreign) >= 0" \
  "$(of reorder lost_in_all) lost, $(of reorder foreign) foreign"

# A reply that is lost behind the chain costs its computing, on this one processor, before the
# master's patience begins: two in one job end 0.1 ms too late. No wire takes so long.
part corrupt "corrupt 1%" "corrupt 1%" run refuse no
wrong=$(($(of corrupt wrong_sequence) + $(chain_of corrupt wrong_sequence)))
# A frame whose EtherType was hit comes to no EtherCAT socket.
holds "corrupt: each damaged frame is a lost one" \
  "$wrong > 0 && $(of corrupt lost_in_all) >= $wrong && $(of corrupt lost_in_all) <= 1.1 * $wrong + 3" \
  "$wrong with a wrong check sequence, $(of corrupt lost_in_all) lost"

# Without a check sequence: what the heads of frame and datagram and the working counter find by
# themselves.
part bare "corrupt 1%" "corrupt 1%" damage count no
wrong=$(($(of bare wrong_sequence) + $(chain_of bare wrong_sequence)))
found=$(($(of bare lost_in_all) + $(of bare short)))
echo "figure bare.found $found 1"
echo "figure bare.wrong_in_all $wrong 1"
# They can not see a bit of the process data that is turned over: for these there is the check
# sequence.
holds "bare: heads and counters find a part" "$found > 0 && $found <= $wrong" "$found of $wrong"
