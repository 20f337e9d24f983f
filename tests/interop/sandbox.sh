#!/bin/bash
# A simulated board and LinuxCNC on a private network that exists only for one run.
#
#   sandbox.sh TO_BOARD FROM_BOARD 'BOARD COMMAND'
#
# TO_BOARD and FROM_BOARD are named pipes: standard input and output of the simulated board, which
# has a network of its own, with the address 10.97.0.2. LinuxCNC's side is 10.97.0.1.
# Lines on standard input are commands of halcmd; each is answered by its output, its messages with
# `! ` in front, and a line `= STATUS`.
# Network, IPC, mount and process namespaces are private and vanish at the end, whatever happened;
# needs root (or CAP_SYS_ADMIN).
#
# The driver of LinuxCNC wants the MAC address of the board's EEPROM on the wire, and does not take
# the loopback interface. LinuxCNC refuses plain root, hence RTAPI_UID and a home of that user.
set -u
if [ -z "${IN_SANDBOX:-}" ]; then
  IN_SANDBOX=1 exec unshare --net --ipc --mount --pid --fork --kill-child --mount-proc "$0" "$@"
fi
to_board=$1 from_board=$2 board_command=$3

home=$(mktemp -d)
chown 65534 "$home"
trap 'rm -rf "$home"' EXIT
# LinuxCNC leaves a lock behind; it must not meet those of another run.
mount -t tmpfs tmpfs /run/lock 2>/dev/null

mkfifo "$home/network"
unshare --net bash -c "read -r _ < '$home/network'; exec $board_command" \
  < "$to_board" > "$from_board" &
board=$!
ip link set lo up
# The board's process needs a moment until it has its network.
for _ in $(seq 100); do
  [ "$(readlink "/proc/$board/ns/net")" != "$(readlink /proc/self/ns/net)" ] && break
  sleep 0.02
done
ip link add pc0 type veth peer name board0 netns "$board" || exit 99
in_board=(nsenter --target "$board" --net)
"${in_board[@]}" ip link set lo up
"${in_board[@]}" ip link set board0 address 00:60:0e:1b:00:97
"${in_board[@]}" ip addr add 10.97.0.2/24 dev board0
"${in_board[@]}" ip link set board0 up
ip addr add 10.97.0.1/24 dev pc0
ip link set pc0 up
echo go > "$home/network"

cat > "$home/session" <<'SESSION'
# What the realtime part says comes late, and from a process that stays: so through a file.
messages=$HOME/messages
seen=0
while read -r line; do
  eval "halcmd $line" 2>> "$messages"
  status=$?
  mapfile -t -s "$seen" new < "$messages"
  seen=$((seen + ${#new[@]}))
  [ ${#new[@]} -eq 0 ] || printf '! %s\n' "${new[@]}"
  echo "= $status"
done
SESSION
echo "loadusr -w bash $home/session" > "$home/session.hal"
env -u DISPLAY RTAPI_UID=65534 HOME="$home" halrun -f "$home/session.hal"
status=$?
# Long enough for the watchdogs of board and remotes.
sleep 1.5
kill -TERM "$board" 2>/dev/null
wait "$board"
exit $status
