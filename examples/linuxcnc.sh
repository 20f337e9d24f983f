#!/bin/bash
# LinuxCNC with a simulated Ethernet board, on a private network that exists only for one run.
#
#   sudo examples/linuxcnc.sh [BOARD OPTIONS] [-- CLIENT ARGS...]
#
#   sudo examples/linuxcnc.sh
#       a 7I97 with LinuxCNC's driver loaded and its cycle running, and halcmd to look around:
#       `show pin hm2_7i97.0.encoder`, `setp hm2_7i97.0.ssr.00.out-02 true`, `exit`
#   sudo examples/linuxcnc.sh --board 7i92-7i77 --remote 2=7i72
#       the same with another board; options as `mesa sim --help` lists them, also `--machine FILE`
#   sudo examples/linuxcnc.sh --firmware FILE -- halrun -f machine.hal
#       with a firmware whose identity memory FILE holds, see `mesa sim --help`
#   sudo examples/linuxcnc.sh -- halrun -f machine.hal
#       with your own HAL file, or any other program; the board has the address 10.97.0.2
#
# Needs root (or CAP_SYS_ADMIN), and the packages that have halrun, ip, iptables, unshare and
# nsenter (Debian: linuxcnc-uspace iproute2 iptables util-linux). Build the board first:
#
#   cargo build --release -p mesa-tools
#
# Environment:
#   MESA                 the program (target/release/mesa, or the installed one)
#   BOARD_IN, BOARD_OUT  the board's standard input and output, for example named pipes
#                        (nothing; a file that is shown if the client fails)
#   BOARD_LINGER         seconds of the board after LinuxCNC (1.5: long enough for the watchdogs of board
#                        and remotes, so that the board's last words are true)
#   LINUXCNC_NICE        the nice value of LinuxCNC's threads on a kernel that it does not take for a
#                        realtime one, where it gives them the normal priority (unchanged)
#
# Why it takes all this: LinuxCNC's driver (hm2_eth) does not take the loopback interface, wants the
# MAC address of the board's EEPROM on the wire, and sets up the firewall and the interface, which
# is not wanted outside of a private network. LinuxCNC refuses plain root, hence RTAPI_UID and a home
# of that user. Network, IPC, mount and process namespaces vanish at the end, whatever happened.
# Exit status: the client's; 98 if something is missing, 99 if the network cannot be made.
set -u

fail() {
  echo "linuxcnc.sh: $2" >&2
  exit "$1"
}

top=$(cd "$(dirname "$0")/.." && pwd)
mesa=${MESA:-$top/target/release/mesa}
# From a package.
[ -n "${MESA:-}" ] || [ -x "$mesa" ] || mesa=$(command -v mesa) || mesa=$top/target/release/mesa
[ -x "$mesa" ] ||
  fail 98 "no $mesa; build it: cargo build --release -p mesa-tools"
for program in halrun ip iptables unshare nsenter; do
  PATH=$PATH:/usr/sbin:/sbin command -v "$program" > /dev/null ||
    fail 98 "$program is missing; apt-get install linuxcnc-uspace iproute2 iptables util-linux"
done

if [ -z "${IN_SANDBOX:-}" ]; then
  IN_SANDBOX=1 exec unshare --net --ipc --mount --pid --fork --kill-child --mount-proc "$0" "$@"
fi

options=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
  options+=("$1")
  shift
done
[ $# -eq 0 ] || shift
case " ${options[*]-} " in
  *" --board "* | *" --firmware "* | *" --machine "*) ;;
  *) options+=(--board 7i97) ;;
esac
case " ${options[*]} " in
  *" 7i92-7i77 "* | *" 7i92-7i76 "*) hal_name=hm2_7i92.0 ;;
  *" 7i80-7i77 "*) hal_name=hm2_7i80.0 ;;
  *) hal_name=hm2_7i97.0 ;;
esac

home=$(mktemp -d)
chown 65534 "$home"
trap 'rm -rf "$home"' EXIT
# LinuxCNC leaves a lock behind; it must not meet those of another run.
mount -t tmpfs tmpfs /run/lock 2> /dev/null

# The board, in a network of its own. It waits until that is there.
log=$home/board
mkfifo "$home/network"
unshare --net bash -c 'read -r _ < "$0"; exec "$@"' "$home/network" \
  "$mesa" sim "${options[@]}" --listen 10.97.0.2 \
  < "${BOARD_IN:-/dev/null}" > "${BOARD_OUT:-$log}" &
board=$!
for _ in $(seq 100); do
  [ "$(readlink "/proc/$board/ns/net")" != "$(readlink /proc/self/ns/net)" ] && break
  sleep 0.02
done
ip link set lo up
ip link add pc0 type veth peer name board0 netns "$board" || fail 99 "no network could be made"
in_board=(nsenter --target "$board" --net)
"${in_board[@]}" ip link set lo up
"${in_board[@]}" ip link set board0 address 00:60:1b:1b:00:97
"${in_board[@]}" ip addr add 10.97.0.2/24 dev board0
"${in_board[@]}" ip link set board0 up
ip addr add 10.97.0.1/24 dev pc0
ip link set pc0 up
echo go > "$home/network"

# What is run without a client of one's own. One late packet makes hm2_eth's load fail, and this is
# no realtime machine: so it is tried several times, and packet errors are allowed in the cycle.
cat > "$home/load" << 'LOAD'
board=$1
halcmd loadrt hostmot2
for attempt in 1 2 3 4 5 6 7 8 9 10 11 12; do
  halcmd loadrt hm2_eth board_ip=10.97.0.2 config=sserial_port_0=000xxxxx && break
  [ "$attempt" != 12 ] || exit 1
  halcmd unloadrt hm2_eth 2> /dev/null
done
halcmd loadrt threads name1=servo period1=1000000
halcmd setp "$board.packet-error-limit" 100000
halcmd setp "$board.watchdog.timeout_ns" 1000000000
halcmd addf "$board.read" servo
halcmd addf "$board.write" servo
halcmd start
LOAD
cat > "$home/default.hal" << HAL
loadusr -w bash $home/load $hal_name
HAL
[ $# -gt 0 ] || set -- halrun -I -f "$home/default.hal"

if [ -n "${LINUXCNC_NICE:-}" ]; then
  while sleep 0.2; do
    for process in $(pgrep rtapi_app); do
      renice -n "$LINUXCNC_NICE" -p $(ls "/proc/$process/task")
    done
  done > /dev/null 2>&1 &
fi
env -u DISPLAY RTAPI_UID=65534 HOME="$home" "$@"
status=$?
sleep "${BOARD_LINGER:-1.5}"
kill -TERM "$board" 2> /dev/null
wait "$board"
[ "$status" = 0 ] || [ -n "${BOARD_OUT:-}" ] || { echo "--- the board:" && tail -20 "$log"; } >&2
exit "$status"
