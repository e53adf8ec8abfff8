# The CAN driver on vcan against modules of the guest: each fault of docs/can.md, named, its
# reaction, its recovery.
ip link add vcan0 type vcan
ip link set vcan0 txqueuelen 10 up
raise_card
tell /tmp/can vm_can_bus --iface vcan0
