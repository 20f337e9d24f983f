# Functions for the scripts that record a terminal; they are sourced from the root of the project.
# Needs tmux and python3, and the program (MESA, otherwise target/release/mesa).

mesa=${MESA:-target/release/mesa}
work=$(mktemp -d)
terminal=mesa-picture-$$
board=
finish() {
  tmux kill-session -t "$terminal" 2> /dev/null || true
  [ -z "$board" ] || kill "$board" 2> /dev/null || true
  rm -rf "$work"
}
trap finish EXIT

# Starts a simulated board with these options; `address` is where it listens, descriptor 3 its console.
simulate() {
  mkfifo "$work/console"
  "$mesa" sim "$@" --listen 127.0.0.1 --port 0 < "$work/console" > "$work/board" &
  board=$!
  exec 3> "$work/console"
  until grep -q 'listening on' "$work/board"; do sleep 0.1; done
  address=$(sed -n 's/.*listening on //p' "$work/board")
}

# Starts a command in a terminal of $columns and $lines.
show() {
  tmux new-session -d -s "$terminal" -x "$columns" -y "$lines" "$@"
  tmux set-option -t "$terminal" status off
  tmux resize-window -t "$terminal" -x "$columns" -y "$lines"
}

# Records $frames screens, one each $seconds, and calls `happens NUMBER` before each.
record() {
  local frame
  for frame in $(seq -w "$frames"); do
    happens "$((10#$frame))"
    sleep "$seconds"
    tmux capture-pane -e -p -t "$terminal" > "$work/frame-$frame"
  done
}

# Writes what was recorded: draw FILE STILL
draw() {
  docs/pictures/frames_to_svg.py "$columns" "$lines" "$seconds" "$2" "$work"/frame-* > "$work/picture"
  mv "$work/picture" "$1"
  chmod 644 "$1"
  echo "$1: $frames frames"
}
