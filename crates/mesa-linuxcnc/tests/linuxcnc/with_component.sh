#!/bin/bash
# LinuxCNC's HAL with the component, for a session of commands: see session.sh of mesa-tools.
#
#   with_component.sh LIBRARY COMMAND...
#
# In the mount namespace of examples/linuxcnc.sh: LinuxCNC's folder of modules gets one more, and the
# installed one stays as it is.
set -e
library=$1
shift
modules=$(sed -n 's/^RTLIBDIR *:\?= *//p' /usr/share/linuxcnc/Makefile.modinc | tail -1)
modules=${modules:-/usr/lib/linuxcnc/modules}
work=$(mktemp -d)
mkdir "$work/installed" "$work/modules"
mount --bind "$modules" "$work/installed"
cp --symbolic-link "$work/installed"/*.so "$work/modules"
for name in mesa_eth mesa_pci; do
  cp "$library" "$work/modules/$name.so"
done
chmod -R a+rX "$work"
mount --bind "$work/modules" "$modules"
exec "$@"
