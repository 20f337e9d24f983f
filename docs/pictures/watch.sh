#!/usr/bin/env bash
# Makes docs/pictures/watch.svg, the recording of `mesa watch` in docs/mesa.md: a simulated machine on
# which things happen, and the screen that shows them.
#
#   cargo build --release -p mesa-tools && docs/pictures/watch.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
. docs/pictures/terminal.sh

columns=112 lines=34 frames=24 seconds=0.4
simulate --board 7i92-7i77 --remote 2=7i72
show "$mesa" watch encoder.00 --addr "$address"
sleep 2
happens() {
  case $1 in
    3) echo 'turn 0 5' ;;
    7) echo 'turn 0 -3' ;;
    12) echo 'unplug 2' ;;
    18) echo 'plug 2' ;;
    20) echo 'turn 0 free' ;;
  esac >&3
}
record
draw docs/pictures/watch.svg 7
