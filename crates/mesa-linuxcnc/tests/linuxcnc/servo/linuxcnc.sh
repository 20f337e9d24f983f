#!/bin/bash
# All of LinuxCNC with the configuration `machine.ini` of a folder, whose screen answers on file 3.
#
#   linuxcnc.sh DIRECTORY
#
# In a copy that LinuxCNC's user may write to.
exec 3>&1
cp -r "$1" "$HOME/machine"
chmod -R a+rwX "$HOME/machine"
# With -r it prints where it is told to.
linuxcnc -r "$HOME/machine/machine.ini" > "$HOME/said" 2>&1 || sed 's/^/! /' "$HOME/said"
