# For the cases. What they print is the rig's: "check NAME ok|FAILED DETAIL" and "figure NAME VALUE UNIT".
. /rig/settings

# Debian's, not those of busybox, which its shell prefers whatever PATH says.
ip() { /usr/bin/ip "$@"; }
tc() { /usr/bin/tc "$@"; }

verdict() {  # name, ok or FAILED, detail
  echo "check $1 $2 $3"
  [ "$2" = ok ] || : > /tmp/failed
}

# A program whose lines are the rig's; its figures stay in the file for value().
tell() {  # file, program and arguments
  local file=$1
  shift
  "$@" > "$file" 2>&1
  local code=$?
  cat "$file"
  grep -q '^check .* FAILED' "$file" && : > /tmp/failed
  [ $code -eq 0 ] || verdict "$1" FAILED "exit code $code"
}

value() {  # file, figure
  awk -v name="$2" '$1 == "figure" && $2 == name {print $3}' "$1"
}

holds() {  # name, expression of awk, detail
  if [ "$(awk "BEGIN {print ($2) ? 1 : 0}")" = 1 ]; then verdict "$1" ok "$3"; else verdict "$1" FAILED "$3"; fi
}

# veth0: the master's card. veth1: what is at the other end of its cable.
bus_up() {
  ip link show veth0 > /dev/null 2>&1 || ip link add veth0 type veth peer name veth1
  ip link set veth0 up
  ip link set veth1 up
  raise_card
}

# The thread that carries frames from one socket of the guest to another stands for the card's
# interrupt.
raise_card() {
  for thread in $(ps -o pid,comm | awk '$2 ~ /^backlog_napi/ {print $1}'); do chrt -f -p 91 "$thread" > /dev/null; done
}

chain_up() {  # arguments of vm_chain
  vm_chain --iface veth1 "$@" > /tmp/chain &
  chain=$!
  usleep 50000
}

chain_down() {
  kill -TERM $chain
  wait $chain
  cat /tmp/chain
}

under() {  # part, program and arguments: its figures and checks with the part's name before theirs
  local name=$1
  shift
  "$@" > /tmp/raw 2>&1
  local code=$?
  sed "s/^figure ethercat\./figure $name./; s/^check /check $name: /" /tmp/raw
  return $code
}

of() { value "/tmp/$1" "$1.$2"; }
