//! The next steps after the errors of set-up and inventory.

mesa_hal::advice::advice_texts! {
    /// All constants of this module.
    ALL;
    CHECK_ADAPTER: Line, "check that its adapter is plugged in, and that no other program has it open";
    CHECK_SETUP_MODE: RemotePower, "check in this order: the card has power; it is in setup mode (7I77: W12 for field I/O, W4 for analog, to the right; 7I72: W6 down), and was switched off and on since; this port has the card's baud rate (115200 in setup mode); RX and TX are not swapped, and the adapter is RS-422";
    CHECK_SETUP_BAUD: Line, "check that the baud rate is the card's (115200 in setup mode, whatever NVBaudRate is), then the cable";
    CHECK_DEVICE: Line, "check what is connected to this port";
    CHECK_SINGLE_CARD: Line, "check the baud rate, and that a single card, and nothing else, is connected to the port";
    UPDATE_AGAIN: RemoteFirmware, "once the cause is removed, the same command finishes the update";
    UPDATE_BLINDLY: RemoteFirmware, "`--no-verify` writes without, as LinuxCNC's setsserial does";
    POWER_CYCLE_AND_UPDATE: RemoteFirmware, "switch the card off and on, and give the same command again";
    UPDATE_ONCE_MORE: RemoteFirmware, "give the same command again; if that does not help, the memory is worn out or this offset is protected";
    RESTORE_BY_WRITER: File, "restore it with the version that wrote it";
    MATCH_REPLACED: Cards, "for a card that was replaced by another of its kind, match by place";
    MATCH_BY_PLACE: Cards, "match them by place";
    CORRECT_MODE: RemoteMode, "leave the mode out, or correct it";
    TAKE_BIN_FILE: File, "take the .BIN file for the card";
    TAKE_OTHER_FILE: File, "take the file for this card";
    NAME_FILE: File, "if it is for this card, give it a name that begins with that of the card, as Mesa's files have";
    WRITE_BITFILE: File, "`mesa flash` writes it";
    CONVERT_FILE: File, "convert it to a raw binary";
    UNPACK_FILE: File, "unpack it and take the file for this card";
}
