#!/usr/bin/env bash
# Makes docs/pictures/scope.svg, the picture of `mesa scope` in docs/mesa.md: an axis of the machine of
# examples/mill.toml is turned by hand into its home switch, and back.
#
#   docs/pictures/scope.sh
#
# MESA is the program, PORT a free UDP port.
set -euo pipefail
cd "$(dirname "$0")/../.."

if [ -z "${MESA:-}" ]; then
  cargo build --release -p mesa-tools
  MESA=target/release/mesa
fi
port=${PORT:-27198}
folder=$(mktemp -d)
mkfifo "$folder/console"
touch "$folder/sim.log" "$folder/scope.log"
"$MESA" sim --machine examples/mill.toml --listen 127.0.0.1 --port "$port" \
  < "$folder/console" > "$folder/sim.log" &
board=$!
exec 3> "$folder/console"
finish() {
  exec 3>&-
  kill "$board" 2> /dev/null || true
  wait "$board" 2> /dev/null || true
  rm -r "$folder"
}
trap finish EXIT

until grep -q 'listening on' "$folder/sim.log"; do
  kill -0 "$board"
  sleep 0.1
done
"$MESA" scope encoder.00.position encoder.00.velocity 7i77.0.0.fieldvoltage \
  7i77.0.0.input-00 7i77.0.0.input-01 --mode 0.0=2 \
  --trigger 7i77.0.0.input-00 --cycles 3200 --before 1200 --period 1000 --timeout 60 \
  --addr "127.0.0.1:$port" --csv "$folder/scope.csv" --plot docs/pictures/scope.svg --yes \
  2> "$folder/scope.log" &
scope=$!
until grep -q 'armed' "$folder/scope.log"; do
  kill -0 "$scope" || { cat "$folder/scope.log" >&2; exit 1; }
  sleep 0.1
done
printf '%s\n' 'turn x -30' 'at +1200ms turn x 20' 'at +2500ms turn x free' >&3
wait "$scope"
