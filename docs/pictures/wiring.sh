#!/usr/bin/env bash
# Makes docs/pictures/wiring.svg, the recording of `mesa wiring` in the README: the inputs of a simulated
# 7I77 are actuated one after the other, and two of its wires are exchanged.
#
#   cargo build --release -p mesa-tools && docs/pictures/wiring.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
. docs/pictures/terminal.sh

columns=100 lines=34 frames=26 seconds=0.6
simulate --board 7i92-7i77 --remote 2=7i72
inputs='*7i77.0.0.input-0?'
show sh -c "echo \"\$ mesa wiring '$inputs' --addr $address\"; '$mesa' wiring '$inputs' --addr $address; sleep 60"
sleep 2
actuate() { echo "input 0 $1 $2" >&3; }
key() { tmux send-keys -t "$terminal" "$@" Enter; }
happens() {
  case $1 in
    2) actuate 0 on ;;
    4) actuate 0 off ;;
    7) actuate 2 on ;; # in place of input 1
    9) actuate 2 off ;;
    11) key '' ;;
    13) actuate 1 on ;;
    15) actuate 1 off ;;
    17) key '' ;;
    19) actuate 3 on ;;
    21) actuate 3 off ;;
    24) key q ;;
  esac
}
record
draw docs/pictures/wiring.svg "$frames"
