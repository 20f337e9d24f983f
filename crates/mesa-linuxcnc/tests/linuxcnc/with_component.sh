#!/bin/bash
# LinuxCNC's HAL with the component, for a session of commands: see session.sh of mesa-tools.
#
#   with_component.sh LIBRARY COMMAND...
#
# In a mount namespace of its own, the component takes the place of an installed one. The installed
# files are behind a read-only mount: a LinuxCNC that runs on this computer uses them.
set -e
if [ -z "${IN_MODULES:-}" ]; then
  IN_MODULES=1 exec unshare --mount bash "$0" "$@"
fi
library=$1
shift
modules=$(sed -n 's/^RTLIBDIR *:\?= *//p' /usr/share/linuxcnc/Makefile.modinc | tail -1)
modules=${modules:-/usr/lib/linuxcnc/modules}
installed=$modules/installed
aside=$(mktemp -d)
mount --bind "$modules" "$aside"
mount -t tmpfs -o mode=755 tmpfs "$modules"
mkdir "$installed"
mount --move "$aside" "$installed"
rmdir "$aside"
mount -o remount,bind,ro "$installed"
ln --symbolic "$installed"/*.so "$modules"
for name in mesa_eth mesa_pci; do
  # Without this option, a copy goes through the link to the installed component.
  cp --remove-destination "$library" "$modules/$name.so"
  chmod a+rX "$modules/$name.so"
done
unset IN_MODULES
exec "$@"
