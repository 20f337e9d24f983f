#!/usr/bin/env bash
# Makes docs/pictures/latency.svg, the picture of `mesa latency` in docs/mesa.md: how late cycles are on
# this host, on a simulated 7I97. Needs: chrt (util-linux) and the right to use SCHED_FIFO, if there is one.
#
#   docs/pictures/latency.sh
#
# MESA is the program, SECONDS_EACH how long each pace is measured.
set -euo pipefail
cd "$(dirname "$0")/../.."

if [ -z "${MESA:-}" ]; then
  cargo build --release -p mesa-tools
  MESA=target/release/mesa
fi

# The simulated board is a thread of the same program: both get a realtime priority if that is allowed.
run=()
if chrt -f 40 true 2>/dev/null; then
  run=(chrt -f 40)
else
  echo 'without SCHED_FIFO: other programs disturb what is measured' >&2
fi
"${run[@]}" "$MESA" latency --sim 7i97 --seconds "${SECONDS_EACH:-30}" --pace both \
  --plot docs/pictures/latency.svg --yes
