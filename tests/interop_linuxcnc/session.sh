#!/bin/bash
# Commands of halcmd on standard input, one a line; each is answered by its output, its messages with
# `! ` in front, and a line `= STATUS`. The client of `examples/linuxcnc.sh` in tests.
#
# What the realtime part says comes late, and from a process that stays: so through a file.
session=$HOME/session
cat > "$session" << 'SESSION'
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
: > "$messages"
echo "loadusr -w bash $session" > "$session.hal"
exec halrun -f "$session.hal"
