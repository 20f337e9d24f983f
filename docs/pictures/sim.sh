#!/usr/bin/env bash
# Makes docs/pictures/sim.svg, the recording of `mesa sim --watch` in docs/mesa.md: the machine of
# examples/mill.toml, which `mesa watch` reads while an axis is turned and the emergency stop is pressed.
#
#   cargo build --release -p mesa-tools && docs/pictures/sim.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
. docs/pictures/terminal.sh

columns=124 lines=28 frames=24 seconds=0.5 port=${PORT:-27199}
show "$mesa" sim --machine examples/mill.toml --listen 127.0.0.1 --port "$port" --watch
sleep 1
reader=$terminal-reader
tmux new-session -d -s "$reader" -x 100 -y 30 "$mesa" watch --addr "127.0.0.1:$port"
trap 'tmux kill-session -t "$reader" 2> /dev/null || true; finish' EXIT
sleep 2
console() { tmux send-keys -t "$terminal" "$1" Enter; }
happens() {
  case $1 in
    2) console 'turn x -12' ;;
    9) console 'turn x free' ;;
    11) console 'estop on' ;;
    15) console 'estop off' ;;
    17) console 'turn z 8' ;;
    22) console 'turn z free' ;;
  esac
}
record
draw docs/pictures/sim.svg 7
