//! The next steps after the errors of set-up and inventory.

mesa_hal::advice::advice_texts! {
    /// All constants of this module.
    ALL;
    CHECK_ADAPTER: Remote, "check that its adapter is plugged in, and that no other program has it open";
    CHECK_SETUP_MODE: RemotePower, "check in this order: the card has power; it is in setup mode (7I77: W12 for field I/O, W4 for analog, to the right; 7I72: W6 down), and was switched off and on since; this port has the card's baud rate (115200 in setup mode); RX and TX are not swapped, and the adapter is RS-422";
    CHECK_SETUP_BAUD: Remote, "check that the baud rate is the card's (115200 in setup mode, whatever NVBaudRate is), then the cable";
    CHECK_DEVICE: Remote, "check what is connected to this port";
    CHECK_SINGLE_CARD: Remote, "check the baud rate, and that a single card, and nothing else, is connected to the port";
    UPDATE_AGAIN: Remote, "once the cause is removed, the same command finishes the update";
    UPDATE_BLINDLY: Remote, "`--no-verify` writes without, as LinuxCNC's setsserial does";
    POWER_CYCLE_AND_UPDATE: Remote, "switch the card off and on, and give the same command again";
    UPDATE_ONCE_MORE: Remote, "give the same command again; if that does not help, the memory is worn out or this offset is protected";
    RESTORE_BY_WRITER: Firmware, "restore it with the version that wrote it";
    MATCH_REPLACED: Remote, "for a card that was replaced by another of its kind, match by place";
    MATCH_BY_PLACE: Remote, "match them by place";
    CORRECT_MODE: Remote, "leave the mode out, or correct it";
    TAKE_BIN_FILE: Firmware, "take the .BIN file for the card";
    TAKE_OTHER_FILE: Firmware, "take the file for this card";
    NAME_FILE: Firmware, "if it is for this card, give it a name that begins with that of the card, as Mesa's files have";
    WRITE_BITFILE: Firmware, "`mesa flash` writes it";
    CONVERT_FILE: Firmware, "convert it to a raw binary";
    UNPACK_FILE: Firmware, "unpack it and take the file for this card";
}
