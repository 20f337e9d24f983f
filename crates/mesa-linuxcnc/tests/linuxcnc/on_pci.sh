#!/bin/bash
# LinuxCNC's HAL with the component under the name mesa_pci, for a session of commands: no network, and
# boards of a folder, which the caller serves, in the place of those of the computer.
#
#   on_pci.sh FOLDER LIBRARY SESSION
#
# Namespaces as in examples/linuxcnc.sh, so that several runs do not meet.
set -e
if [ -z "${IN_SANDBOX:-}" ]; then
  IN_SANDBOX=1 exec unshare --ipc --mount --pid --fork --kill-child --mount-proc "$0" "$@"
fi
home=$(mktemp -d)
chown 65534 "$home"
trap 'rm -rf "$home"' EXIT
mount --bind "$1/bus/pci" /sys/bus/pci
mount --bind "$1/devices" /sys/devices
shift
mount -t tmpfs tmpfs /run/lock 2> /dev/null || true
export RTAPI_UID=65534 HOME=$home
env -u DISPLAY "$(dirname "$0")/with_component.sh" "$@"
