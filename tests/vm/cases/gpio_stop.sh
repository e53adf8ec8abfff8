# The emergency stop from the kernel's edge to the frame on the wire, and every other line of
# docs/gpio.md, on a simulated chip.
bus_up
chain_up --kind base --long-gap-ms 250
mount -t configfs configfs /sys/kernel/config 2> /dev/null
sim=/sys/kernel/config/gpio-sim/rig
mkdir -p $sim/bank
echo 8 > $sim/bank/num_lines
echo 1 > $sim/live
chip=$(cat $sim/bank/chip_name)
# What stands for a GPIO interrupt, and the threads that the kernel makes of it: below robot_io they
# would tell of an edge when its job has ended.
raise() {
  for thread in $(ps -o pid,comm | awk -v name="$1" '$2 ~ name {print $1}'); do chrt -f -p 93 "$thread" > /dev/null; done
}
raise '^irq_work'
(until ps -o comm | grep -q '^irq/.*teletact'; do usleep 100000; done; raise "^irq/.*teletact") &
tell /tmp/gpio vm_gpio_stop --iface veth0 --chip "$chip" --sim "/sys/devices/platform/$(cat $sim/dev_name)/$chip" \
  --live $sim/live --chain-pid $chain --presses "$PRESSES"
chain_down
