//! The next steps after failed accesses to remotes.

crate::advice_texts! {
    /// All constants of this module.
    ALL;
    CHECK_WRITE_PROTECTION: Firmware, "check the card's jumpers for write protection; else the memory may be worn out";
    POWER_CYCLE_BEFORE_WRITING: RemotePower, "switch the remote off and on before anything else is written to it";
    CHECK_REPLY_SIZE: Remote, "check the wiring, and that the size in the reply to discovery is that of the present mode";
    CHECK_TERMINATION: Remote, "check cable, termination and shield";
}
