# The cable of the motor bus is pulled while the wheels turn: named, stopped and latched; only the
# operator's act ends it.
bus_up
chain_up
tell /tmp/cable vm_cable --iface veth0 --far veth1 --pulls "$PULLS"
chain_down
back=$(($(value /tmp/cable ethercat.sent) - $(value /tmp/cable ethercat.lost_in_all)))
on_the_way=$(($(value /tmp/chain chain.passed) - back))
# A reply that was on its way at a pull did pass the chain; the master counts it as lost all the
# same.
holds "every frame is back or counted" "$on_the_way >= 0 && $on_the_way <= $(value /tmp/cable cable.pulls)" \
  "$back back, $(value /tmp/cable ethercat.lost_in_all) lost, $on_the_way of them behind the chain"
