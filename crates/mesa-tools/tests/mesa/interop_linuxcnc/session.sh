#!/bin/bash
# Commands of halcmd on standard input, one a line; each is answered by its output, its messages with
# `! ` in front, and a line `= STATUS`. The client of `examples/linuxcnc.sh` in tests.
#
#   session.sh                      LinuxCNC's HAL, empty
#   session.sh bench DIRECTORY      with what `mesa hal` writes into the directory: its bench.hal
#   session.sh linuxcnc DIRECTORY   the same: all of LinuxCNC, with the session in place of its screen
#   session.sh prepared DIRECTORY   the same, with every line that the files have prepared as a comment
#
# Options of `mesa hal` follow.
#
# What the realtime part says comes late, and from a process that stays: so through a file. What other
# programs print is not between the answers.
exec 3>&1
session=$HOME/session
cat > "$session" << 'SESSION'
#!/bin/bash
exec >&3
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
chmod +x "$session"
: > "$HOME/messages"
if [ $# -eq 0 ]; then
  echo "loadusr -w bash $session" > "$session.hal"
  exec halrun -f "$session.hal"
fi

rm -rf "$2"
"$MESA" hal --addr 10.97.0.2 --out "$2" "${@:3}" || exit
chmod -R a+rwX "$2"
cd "$2" || exit
# This is no realtime machine, and has no screen. Nothing else is changed.
sed -e 's/^WATCHDOG_NS = .*/WATCHDOG_NS = 1000000000/' \
  -e 's/^PACKET_ERROR_LIMIT = .*/PACKET_ERROR_LIMIT = 100000/' \
  -e 's/^SSERIAL_FAULT_LIMIT = .*/SSERIAL_FAULT_LIMIT = 1000000/' \
  -e "s|^DISPLAY = .*|DISPLAY = $session|" machine.ini > test.ini
[ "$1" != prepared ] || sed -i -E 's/^# (net|setp|loadrt|addf) /\1 /' board.hal motion.hal
case $1 in
  bench)
    printf 'source bench.hal\nloadusr -w bash %s\n' "$session" > "$session.hal"
    exec halrun -i test.ini -f "$session.hal"
    ;;
  linuxcnc | prepared)
    # With -r it prints where it is told to.
    linuxcnc -r "$2/test.ini" > "$HOME/said" 2>&1 || sed 's/^/! /' "$HOME/said"
    ;;
esac
