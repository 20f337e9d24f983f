//! The next steps after the errors of this crate.

mesa_wire::advice_texts! {
    /// All constants of this module.
    ALL;
    LIST_BOARDS: Board, "`lspci -D -d 2718:` lists Mesa's boards with their addresses; a board that is missing there is not seated, has no power, or was reloaded without a restart of the computer";
    GIVE_BOARD: Board, "give the address of a 4I74, 5I24, 5I25, 6I24 or 6I25; boards behind a PLX bridge are not supported";
    CHECK_SYSFS: Board, "check that sysfs is mounted on /sys";
    UNBIND_DRIVER: Board, "end the program that uses this driver, then take the board from it, as root: `echo ADDRESS > /sys/bus/pci/drivers/DRIVER/unbind`";
    CHECK_REGION: Board, "the firmware of this board is not Mesa's, or the computer has given it no addresses: look at `lspci -vv -d 2718:` and `dmesg`";
    SWITCH_MEMORY_ON: Board, "switch it on, as root: `setpci -s ADDRESS COMMAND=0x2:0x2`";
    ALLOW_ACCESS: Board, "run it as root, or give the boards to a group that you are in, by a file /etc/udev/rules.d/50-mesa-pci.rules with the line `ACTION==\"add\", SUBSYSTEM==\"pci\", ATTR{vendor}==\"0x2718\", RUN+=\"/bin/chgrp plugdev /sys%p/resource0\", RUN+=\"/bin/chmod 0660 /sys%p/resource0\"`, and restart the computer";
    END_HOLDER: OtherProgram, "end it first";
    USE_LOCKS: Board, "use a file system with locks for a simulated board; for a real one, look at the end of `dmesg`";
    END_LINUXCNC: OtherProgram, "end LinuxCNC (`halrun -U`); if it drives other boards only, run this as root";
    UNLOCK_KERNEL: Board, "the kernel is locked down, as it is with Secure Boot: switch Secure Boot off in the BIOS";
    READ_DMESG: Board, "look at the end of `dmesg`";
    START_SIMULATOR: Board, "start `mesa sim --pci` again, or remove the folder";
    RESTART_COMPUTER: Board, "the board does not answer: it has no power, or its FPGA was loaded again without a restart of the computer";
    WRITE_HOSTMOT2: Firmware, "the FPGA has another firmware: write one with HostMot2, with mesaflash, and switch the computer off and on";
}
