//! The next steps after errors of LBP16 packets.

crate::advice_texts! {
    /// All constants of this module.
    ALL;
    USE_SEVERAL_COMMANDS: Module, "use several commands";
    GIVE_MATCHING_DATA: Module, "give the count of the command times the size of its elements";
    CHECK_COUNTS: Module, "check whether the packet was cut off, the count of this command is too large, or that of the one before too small";
    LEAVE_COMMAND_OUT: Module, "ask for 1 to 127 elements, or leave the command out";
    CHECK_SPACE: Firmware, "check that this is a Mesa board, and that its firmware has the space";
}
