#!/usr/bin/env bash
# Makes docs/pictures/watch.svg, the recording of `mesa watch` in the README: a simulated machine on
# which things happen, and the screen that shows them. Needs tmux and python3, and the program:
#
#   cargo build --release -p mesa-tools && docs/pictures/watch.sh
set -euo pipefail
cd "$(dirname "$0")/../.."

mesa=${MESA:-target/release/mesa}
columns=100 lines=34 frames=24
work=$(mktemp -d)
terminal=mesa-watch-$$
board=
finish() {
  tmux kill-session -t "$terminal" 2> /dev/null || true
  [ -z "$board" ] || kill "$board" 2> /dev/null || true
  rm -rf "$work"
}
trap finish EXIT

mkfifo "$work/console"
"$mesa" sim --board 7i92-7i77 --listen 127.0.0.1 --port 0 --remote 2=7i72 \
  < "$work/console" > "$work/board" &
board=$!
exec 3> "$work/console"
until grep -q 'listening on' "$work/board"; do sleep 0.1; done
address=$(sed -n 's/.*listening on //p' "$work/board")

tmux new-session -d -s "$terminal" -x "$columns" -y "$lines" \
  "$mesa" watch encoder.00 --addr "$address"
sleep 2
happens() {
  case $1 in
    3) echo "turn 0 5" ;;
    7) echo "turn 0 -3" ;;
    12) echo 'unplug 2' ;;
    18) echo 'plug 2' ;;
    20) echo 'turn 0 free' ;;
  esac
}
for frame in $(seq -w "$frames"); do
  happens "$((10#$frame))" >&3
  sleep 0.4
  tmux capture-pane -e -p -t "$terminal" > "$work/frame-$frame"
done
docs/pictures/frames_to_svg.py "$columns" "$lines" 0.4 "$work"/frame-* > docs/pictures/watch.svg
echo "docs/pictures/watch.svg: $frames frames"
